"""What every chamber driver does, whatever the controller and the wire."""

import contextlib
import itertools
import random

import pytest

from drivers.chambers import watch as chamber_watch
from drivers.chambers.models import CHAMBER_MODELS
from drivers.chambers.open import open_chamber
from drivers.clock import SteppedClock
from drivers.devices import Chamber
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import REPLY_KINDS, FaultPlan
from drivers.errors import (
    DeviceError,
    InstrumentError,
    LimitError,
    LinkError,
    ProtocolError,
    RecognitionError,
)
from drivers.station import ChamberConfig
from tests.drivers.ideal_plant import IdealPlant

MODELS = tuple(CHAMBER_MODELS)
TRANSPORTS = ("tcp", "rtu", "rtu+tcp")
PATIENT_S = 2.0  # where no time limit is to run out, however busy the machine
TIMEOUT_S = 0.08
LATE_S = 0.12  # after the asker gave up, before the line has been quiet for another time limit
VERY_LATE_S = 0.3  # after that too
RESOLUTION_C = 0.051  # of a controller with one decimal, and rounding


class Bench:
    """An emulated chamber with everything that belongs to it."""

    def __init__(
        self,
        model: str,
        transport: str,
        *,
        lag_s: float = 0.0,
        late_s: float = LATE_S,
        decimals: int = 1,
    ) -> None:
        self.decimals = decimals
        self.clock = SteppedClock(1000.0)
        self.plant = IdealPlant(air_c=23.4, lag_s=lag_s)
        self.faults = FaultPlan([], "chamber", self.clock, late_s=late_s)
        self.emulator = ChamberEmulator(
            model, self.plant, self.clock, self.faults, transport=transport, decimals=decimals
        )
        self.emulator.start()
        self.model = model
        self.opened: list[Chamber] = []
        self.chamber = self.recognised()

    def recognised(self, **more) -> Chamber:
        chamber = self.open(**more)
        sooner_or_later(chamber.identify)
        return chamber

    def open(self, **more) -> Chamber:
        settings = {"timeout_s": PATIENT_S, "baud": 115200, "decimals": self.decimals} | more
        config = ChamberConfig(model=self.model, url=self.emulator.url, **settings)
        self.opened.append(open_chamber(config))
        return self.opened[-1]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until_s(self.clock.now_s() + seconds)

    def reopen(self, **more) -> None:
        self.chamber.close()
        self.chamber = self.recognised(**more)

    def close(self) -> None:
        for chamber in self.opened:
            chamber.close()
        self.emulator.close()


@pytest.fixture(params=itertools.product(MODELS, TRANSPORTS), ids="-".join)
def bench(request):
    bench = Bench(*request.param)
    yield bench
    bench.close()


@pytest.fixture(params=MODELS)
def tcp_bench(request):
    bench = Bench(request.param, "tcp")
    yield bench
    bench.close()


@pytest.fixture(params=MODELS)
def lagging_bench(request):
    bench = Bench(request.param, "tcp", lag_s=120.0)
    yield bench
    bench.close()


def test_identifies_itself_and_tells_its_settings(bench):
    said = bench.chamber.identify()
    assert "23.4 °C" in said
    assert "-55 to 85 °C" in said
    settings = bench.chamber.read_settings()
    assert all(isinstance(v, str | float) for v in settings.values())
    assert len(settings) >= 5
    assert bench.chamber.counters.retries == 0
    assert bench.chamber.counters.reconnects == 0


def test_hold_goes_there_and_is_read_back(bench):
    for temp_c in (40.0, -40.5, 0.0):
        bench.chamber.hold_temp_c(temp_c)
        bench.wait(1.0)
        assert bench.chamber.read_setpoint_c() == pytest.approx(temp_c, abs=RESOLUTION_C)
        assert bench.chamber.read_temp_c() == pytest.approx(temp_c, abs=RESOLUTION_C)


def test_ramp_is_uniform_from_the_present_temperature(bench):
    bench.chamber.ramp_to_c(33.4, 1.0)
    bench.wait(0.0)
    seen = []
    for _ in range(12):
        seen.append((bench.chamber.read_setpoint_c(), bench.chamber.read_temp_c()))
        bench.wait(60.0)
    for minute, (setpoint_c, temp_c) in enumerate(seen):
        expected_c = min(23.4 + minute, 33.4)
        assert setpoint_c == pytest.approx(expected_c, abs=RESOLUTION_C)
        assert temp_c == pytest.approx(expected_c, abs=RESOLUTION_C)


def test_ramp_down_through_zero_at_a_fractional_rate(tcp_bench):
    rate = 0.7 if tcp_bench.model == "eurotherm_3504" else 0.73
    tcp_bench.chamber.ramp_to_c(-20.0, rate)
    for minute in range(0, 80, 10):
        expected_c = max(23.4 - rate * minute, -20.0)
        # a step of whole seconds: ± 0.5 s of 3567 s over the ramp's 43.4 °C is 6 mK
        assert tcp_bench.chamber.read_setpoint_c() == pytest.approx(expected_c, abs=0.06)
        tcp_bench.wait(600.0)


def test_ramp_starts_where_the_chamber_is_and_not_where_it_was_sent(lagging_bench):
    chamber = lagging_bench.chamber
    chamber.hold_temp_c(60.0)
    lagging_bench.wait(60.0)
    present_c = chamber.read_temp_c()
    assert 30.0 < present_c < 45.0, "on its way"
    chamber.ramp_to_c(-10.0, 2.0)
    assert chamber.read_setpoint_c() == pytest.approx(present_c, abs=2 * RESOLUTION_C)
    lagging_bench.wait(300.0)
    assert chamber.read_setpoint_c() == pytest.approx(present_c - 10.0, abs=2 * RESOLUTION_C)


def test_ramp_follows_ramp_and_hold_follows_ramp(tcp_bench):
    chamber = tcp_bench.chamber
    chamber.ramp_to_c(70.0, 2.0)
    tcp_bench.wait(300.0)
    chamber.ramp_to_c(-40.0, 3.0)
    tcp_bench.wait(600.0)
    assert chamber.read_setpoint_c() == pytest.approx(33.4 - 30.0, abs=2 * RESOLUTION_C)
    chamber.hold_temp_c(20.0)
    assert chamber.read_setpoint_c() == pytest.approx(20.0, abs=RESOLUTION_C)
    tcp_bench.wait(7200.0)
    assert chamber.read_temp_c() == pytest.approx(20.0, abs=RESOLUTION_C)


def test_after_the_ramp_it_holds(tcp_bench):
    tcp_bench.chamber.ramp_to_c(30.0, 1.0)
    tcp_bench.wait(36000.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(30.0, abs=RESOLUTION_C)
    assert tcp_bench.chamber.read_setpoint_c() == pytest.approx(30.0, abs=RESOLUTION_C)


@pytest.mark.parametrize("decimals", [0, 1, 2])
@pytest.mark.parametrize("model", ["watlow_f4", "eurotherm_3504"])
def test_scaling_goes_by_the_decimals_both_ways(model, decimals):
    bench = Bench(model, "tcp", decimals=decimals)
    try:
        for temp_c in (-40.0, 25.0, 84.0):
            bench.chamber.hold_temp_c(temp_c)
            assert bench.chamber.read_temp_c() == temp_c
            assert bench.plant.air_temp_c(bench.clock.now_s()) == temp_c
    finally:
        bench.close()


def test_decimals_that_disagree_are_found_out():
    bench = Bench("watlow_f4", "tcp", decimals=2)
    try:
        bench.opened.append(
            open_chamber(ChamberConfig(model="watlow_f4", url=bench.emulator.url, decimals=1))
        )
        with pytest.raises(RecognitionError, match="shows 2 decimals, expected 1"):
            bench.opened[-1].identify()
    finally:
        bench.close()


@pytest.mark.parametrize("temp_c", [85.1, -55.1, float("nan"), float("inf"), float("-inf")])
def test_set_points_outside_the_limits_send_nothing(tcp_bench, temp_c):
    chamber = tcp_bench.open()
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.hold_temp_c(temp_c)
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.ramp_to_c(temp_c, 1.0)
    assert chamber.counters.exchanges == 0


@pytest.mark.parametrize("rate", [0.0, -1.0, 0.04, 5.1, float("nan"), float("inf")])
def test_rates_outside_the_limits_send_nothing(tcp_bench, rate):
    chamber = tcp_bench.open()
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.ramp_to_c(30.0, rate)
    assert chamber.counters.exchanges == 0


def test_the_tighter_limits_apply_after_identify(tcp_bench):
    tcp_bench.emulator.controller.limits_c = (-30.0, 120.0)
    limits = tcp_bench.recognised().limits_c
    # the 3504's map has no set point limits, so the station's stay in force
    low = -55.0 if tcp_bench.model == "eurotherm_3504" else -30.0
    assert (limits.lo, limits.hi) == (low, 85.0)


def test_a_controller_whose_limits_exclude_the_station_is_refused():
    bench = Bench("watlow_f4t", "tcp")
    try:
        bench.emulator.controller.limits_c = (100.0, 120.0)
        with pytest.raises(RecognitionError, match="set points"):
            bench.open().identify()
    finally:
        bench.close()


def test_a_controller_that_cannot_be_made_safe_is_refused_beforehand():
    bench = Bench("watlow_f4t", "tcp")
    try:
        bench.emulator.controller.limits_c = (30.0, 120.0)
        with pytest.raises(RecognitionError, match="safe temperature 25 °C is outside 30 to 85 °C"):
            bench.open().identify()
    finally:
        bench.close()


def test_make_safe_ends_a_ramp_verifies_and_can_be_repeated(bench):
    bench.chamber.ramp_to_c(70.0, 1.0)
    bench.wait(600.0)
    for _ in range(2):
        result = bench.chamber.make_safe(25.0)
        assert result.verified, result.steps
        bench.wait(600.0)
        assert bench.chamber.read_setpoint_c() == pytest.approx(25.0, abs=RESOLUTION_C)
        assert bench.chamber.read_temp_c() == pytest.approx(25.0, abs=RESOLUTION_C)


def test_make_safe_works_from_a_fresh_link_when_the_first_was_left_lying(bench):
    bench.chamber.ramp_to_c(70.0, 1.0)
    bench.wait(60.0)
    bench.chamber.close()  # as the kernel does for a process that was killed
    fresh = bench.open()
    assert fresh.make_safe(25.0).verified
    bench.wait(60.0)
    assert fresh.read_temp_c() == pytest.approx(25.0, abs=RESOLUTION_C)


def test_make_safe_reports_and_does_not_raise_when_nobody_answers(bench):
    never_recognised = bench.open(retries=0)
    bench.emulator.close()
    result = bench.chamber.make_safe(25.0)
    assert not result.verified
    assert len(result.steps) >= 2
    assert all("failed" in step and "\n" not in step for step in result.steps)
    fresh = never_recognised.make_safe(25.0)
    assert (fresh.verified, fresh.commanded, len(fresh.steps)) == (False, False, 1)
    assert "not commanded: chamber: " in fresh.steps[0]


def test_make_safe_tries_every_step_when_one_is_refused(tcp_bench):
    tcp_bench.chamber.ramp_to_c(70.0, 1.0)
    tcp_bench.faults.inject("exception")
    result = tcp_bench.chamber.make_safe(25.0)
    assert result.verified, "the second pass succeeds"
    assert "once more:" in result.steps


def test_make_safe_recognises_and_lives_through_a_refusal_of_that(tcp_bench):
    fresh = tcp_bench.open()
    tcp_bench.faults.inject("exception")
    assert fresh.make_safe(25.0).verified


def test_make_safe_outside_the_limits_still_ends_the_ramp(tcp_bench, monkeypatch):
    monkeypatch.setattr(chamber_watch, "FOLLOW_S", 0.05)  # it will not go there, so why wait
    tcp_bench.chamber.ramp_to_c(70.0, 1.0)
    tcp_bench.wait(60.0)
    result = tcp_bench.chamber.make_safe(200.0)
    assert not result.verified
    before_c = tcp_bench.chamber.read_setpoint_c()
    # the F4 ends a profile at the static set point, where the ramp began
    here_c = 23.4 if tcp_bench.model == "watlow_f4" else 24.4
    assert before_c == pytest.approx(here_c, abs=RESOLUTION_C), "and not the ramp's target"
    tcp_bench.wait(600.0)
    assert tcp_bench.chamber.read_setpoint_c() == before_c


def test_sensor_break_is_an_alarm_and_no_temperature(bench):
    assert bench.chamber.read_alarms() == ()
    bench.faults.inject("sensor_break")
    with pytest.raises(DeviceError):
        bench.chamber.read_temp_c()
    assert bench.chamber.read_alarms() != ()
    bench.faults.clear()
    assert bench.chamber.read_alarms() == ()
    assert bench.chamber.read_temp_c() == pytest.approx(23.4, abs=RESOLUTION_C)


def test_over_temperature_is_an_alarm(tcp_bench):
    tcp_bench.faults.inject("over_temperature")
    tcp_bench.chamber.read_temp_c()
    tcp_bench.wait(740.0)  # 74 °C at 0.1 °C/s
    alarms = tcp_bench.chamber.read_alarms()
    assert any("over-temperature" in a for a in alarms)
    tcp_bench.wait(3600.0)
    tcp_bench.chamber.read_alarms()
    cut_off_c = tcp_bench.plant.air_temp_c(tcp_bench.clock.now_s())
    tcp_bench.wait(3600.0)
    assert tcp_bench.plant.air_temp_c(tcp_bench.clock.now_s()) == cut_off_c


def test_stuck_temperature_stays_and_comes_loose(tcp_bench):
    tcp_bench.faults.inject("stuck_temperature", duration_s=100.0)
    tcp_bench.chamber.read_temp_c()
    tcp_bench.chamber.hold_temp_c(50.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(23.4, abs=RESOLUTION_C)
    tcp_bench.wait(101.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(50.0, abs=RESOLUTION_C)


# ---- the wire misbehaves


def sooner_or_later(ask):
    """Ask until there is an answer: a busy machine is no fault of the link's."""
    for _ in range(10):
        with contextlib.suppress(LinkError, ProtocolError):
            return ask()
    return ask()


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
