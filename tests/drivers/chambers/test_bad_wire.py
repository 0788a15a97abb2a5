"""A wire that misbehaves under every chamber driver: a right value or an error, never another."""

import itertools
import random

import pytest

from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import REPLY_KINDS, FaultPlan
from drivers.errors import DeviceError, InstrumentError, LinkError, ProtocolError
from tests.drivers.chambers.emulated_chamber import (
    MODELS,
    RESOLUTION_C,
    TIMEOUT_S,
    TRANSPORTS,
    VERY_LATE_S,
    Bench,
    sooner_or_later,
)
from tests.drivers.ideal_plant import IdealPlant


def expect_right_values(bench: Bench, setpoint_c: float, temp_c: float) -> None:
    """Ask twice for two things of the same shape; each must get its own answer."""
    chamber = bench.chamber
    for _ in range(2):
        for ask, expected_c in (
            (chamber.read_setpoint_c, setpoint_c),
            (chamber.read_temp_c, temp_c),
        ):
            assert sooner_or_later(ask) == pytest.approx(expected_c, abs=RESOLUTION_C)


@pytest.fixture(params=itertools.product(MODELS, TRANSPORTS), ids="-".join)
def apart_bench(request):
    """A chamber on its way, where set point and temperature are far apart."""
    bench = Bench(*request.param, lag_s=1e9)
    bench.chamber.hold_temp_c(60.0)
    yield bench
    bench.close()


@pytest.mark.parametrize("kind", sorted((*REPLY_KINDS, "very_late_reply")))
def test_after_every_fault_each_question_gets_its_own_answer(apart_bench, kind):
    if kind == "very_late_reply":
        apart_bench.faults.late_s = VERY_LATE_S
    if kind not in ("exception", "split_frame"):
        apart_bench.reopen(timeout_s=TIMEOUT_S, retries=10)
    apart_bench.chamber.read_temp_c()  # the line is in step: it is a question that is spoiled
    apart_bench.faults.inject("late_reply" if kind == "very_late_reply" else kind)
    if kind == "exception":
        with pytest.raises(DeviceError, match="device failure"):
            apart_bench.chamber.read_setpoint_c()
    expect_right_values(apart_bench, 60.0, 23.4)
    counters = apart_bench.chamber.counters
    if kind not in ("exception", "split_frame"):
        assert counters.retries >= 1
        assert counters.reconnects >= 1
        assert counters.last_fault
    else:
        assert counters.retries == counters.reconnects == 0


@pytest.mark.parametrize("kind", ["silence", "late_reply", "broken_crc", "dropped_connection"])
def test_without_retries_the_error_is_told_and_the_next_answer_is_right(bench, kind):
    bench.chamber.hold_temp_c(60.0)
    bench.reopen(timeout_s=TIMEOUT_S, retries=0)
    sooner_or_later(bench.chamber.read_temp_c)  # the line is in step
    bench.faults.inject(kind)
    with pytest.raises((LinkError, ProtocolError)) as caught:
        bench.chamber.read_setpoint_c()
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("chamber: read ")
    expect_right_values(bench, 60.0, 60.0)


@pytest.mark.parametrize("kind", ["silence", "broken_crc", "dropped_connection", "split_frame"])
def test_a_ramp_is_started_once_whatever_reply_is_lost(tcp_bench, kind):
    """Spoil each reply of the whole command in turn."""
    tcp_bench.reopen(timeout_s=TIMEOUT_S, retries=10)
    chamber = tcp_bench.chamber
    for nth in range(0, 40, 5):
        chamber.hold_temp_c(20.0)
        tcp_bench.wait(10.0)
        replies = chamber.counters.exchanges
        plan = tcp_bench.faults
        plan.clear()
        spoil_nth_reply(plan, nth, kind)
        chamber.ramp_to_c(30.0, 1.0)
        plan.clear()
        assert chamber.counters.exchanges > replies
        tcp_bench.wait(300.0)
        assert chamber.read_setpoint_c() == pytest.approx(25.0, abs=RESOLUTION_C)
    profiles = getattr(tcp_bench.emulator.controller, "profiles", {1: None})
    assert len(profiles) == 1, "the F4's memory does not fill with the same profile"


@pytest.mark.parametrize("nth", range(0, 40, 3))
def test_a_ramp_refused_halfway_leaves_no_rubbish_and_works_the_next_time(nth):
    bench = Bench("watlow_f4", "tcp")
    try:
        spoil_nth_reply(bench.faults, nth, "exception")
        with pytest.raises(DeviceError, match="device failure"):
            bench.chamber.ramp_to_c(30.0, 1.0)
        bench.chamber.ramp_to_c(30.0, 1.0)
        bench.wait(120.0)
        assert bench.chamber.read_setpoint_c() == pytest.approx(25.4, abs=RESOLUTION_C)
        # one may be left, empty: refused after it was made and before its number was learnt
        profiles = bench.emulator.controller.profiles
        assert sum(len(steps) > 1 for steps in profiles.values()) == 1
        assert len(profiles) <= 2
    finally:
        bench.close()


def spoil_nth_reply(plan: FaultPlan, nth: int, kind: str) -> None:
    """Let `nth` replies pass, then spoil one."""
    take = FaultPlan.take_reply_fault

    def counted():
        nonlocal nth
        nth -= 1
        if nth == -1:
            plan.inject(kind)
        return take(plan)

    plan.take_reply_fault = counted


def ask_under_random_faults(bench: Bench, questions: int, often: float, seed: int) -> int:
    """Ask at random while replies are spoiled at random; return how many were answered."""
    rng = random.Random(seed)
    kinds = sorted(REPLY_KINDS)
    answered = 0
    for _ in range(questions):
        if rng.random() < often:
            bench.faults.inject(rng.choice(kinds), count=rng.choice((1, 1, 2)))
        ask, expected_c = rng.choice(
            ((bench.chamber.read_setpoint_c, 60.0), (bench.chamber.read_temp_c, 23.4))
        )
        try:
            value_c = ask()
        except InstrumentError:
            continue
        answered += 1
        assert value_c == pytest.approx(expected_c, abs=RESOLUTION_C)
    return answered


@pytest.mark.parametrize(
    ("model", "transport", "questions"),
    [
        (m, t, 500 if (m, t) == ("watlow_f4t", "tcp") else 40)
        for m, t in itertools.product(MODELS, TRANSPORTS)
    ],
)
def test_under_random_faults_no_value_is_ever_wrong(model, transport, questions):
    bench = Bench(model, transport, lag_s=1e9, late_s=0.04)
    try:
        bench.chamber.hold_temp_c(60.0)
        bench.reopen(timeout_s=0.03)
        answered = ask_under_random_faults(bench, questions, 0.15, seed=len(model + transport))
        assert answered > questions / 4
    finally:
        bench.close()


@pytest.mark.slow
@pytest.mark.parametrize(("model", "transport"), list(itertools.product(MODELS, TRANSPORTS)))
def test_under_many_random_faults_no_value_is_ever_wrong(model, transport):
    bench = Bench(model, transport, lag_s=1e9, late_s=0.15)
    try:
        bench.reopen(timeout_s=0.1)
        bench.chamber.hold_temp_c(60.0)
        assert ask_under_random_faults(bench, 500, 0.2, seed=1) > 250
    finally:
        bench.close()


def test_two_masters_on_one_serial_line_are_refused():
    bench = Bench("watlow_f4", "rtu")
    try:
        bench.chamber.read_temp_c()
        with pytest.raises(LinkError, match="lock"):
            bench.open(retries=0).read_temp_c()
    finally:
        bench.close()


def test_an_emulator_does_not_take_the_place_of_a_real_port(tmp_path):
    port = tmp_path / "ttyUSB0"
    port.touch()
    clock = SteppedClock()
    emulator = ChamberEmulator(
        "watlow_f4", IdealPlant(), clock, FaultPlan([], "chamber", clock),
        transport="rtu", path=port,
    )  # fmt: skip
    with pytest.raises(FileExistsError, match="no link left by an emulator"):
        emulator.start()
    emulator.close()
    assert port.is_file()
