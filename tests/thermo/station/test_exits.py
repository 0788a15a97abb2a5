"""However a test ends, the chamber stands in its safe condition, and that was read back."""

import dataclasses
import json

import pytest

from drivers.devices import ChannelReading, SafeResult
from drivers.digitisers.thermistor import ohm_from_temp_c
from drivers.errors import DeviceError, LinkError, ProtocolError
from errormodel.errors import StoreError
from tests.thermo.station.running import run_test
from thermo.station.outcome import RunControl

MOMENTS = {
    "approach": lambda world: world.calls.count("chamber.read_temp_c") == 4,
    "first slot": lambda world: world.calls.count("digitiser.scan") == 1,
    "ramp": lambda world: world.calls.count("digitiser.scan") == 12,
    "ramp command": lambda world: world.calls[-1] == "chamber.ramp_to_c",
    "rest": lambda world: world.calls.count("digitiser.scan") == 28 and world.clock.now_s() > 700,
    "last slot": lambda world: world.calls.count("digitiser.scan") == 56,
}
ERRORS = {
    "Ctrl-C": KeyboardInterrupt(),
    "exit": SystemExit(3),
    "bug": ZeroDivisionError("division by zero"),
    "disk full": StoreError("store.sqlite: disk full"),
}


def check_safe(outcome, world, store):
    assert world.is_safe
    assert outcome.safe.verified
    assert outcome.head_stopped
    assert "\n" not in outcome.reason
    assert outcome.reason
    if outcome.test_id:
        record = store.test(outcome.test_id)
        assert record.status == outcome.status
        assert record.outcome == outcome.reason
        assert json.loads(record.safe_result_json)["verified"] is True


class ChangingAfter:
    """An observer under whose eyes somebody changes the chamber after a reading."""

    def __init__(self, chamber, run: int, slot: int) -> None:
        self._chamber, self._after = chamber, (run, slot)

    def on_reading(self, run, rows) -> None:
        if (run, rows[0].slot) == self._after:
            self._chamber.foreign = ("set point 57 °C, commanded 26 °C",)

    def on_progress(self, progress) -> None:
        pass

    def on_event(self, event) -> None:
        pass


def test_a_change_after_the_last_reading_is_no_clean_end(short, station, store, world):
    last = ChangingAfter(station.chamber, 2, 27)
    outcome = run_test(short, station, store, world.clock, observers=[last])
    assert outcome.status == "failed", outcome
    assert "somebody else changed the chamber: set point 57 °C" in outcome.reason
    assert world.is_safe


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("kind", ERRORS)
def test_an_exception_at_any_moment(short, station, store, world, kind, moment):
    def hook(name: str) -> None:
        if MOMENTS[moment](world):
            world.hook = lambda _: None
            raise ERRORS[kind]

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert world.hook is not hook  # the moment came
    assert outcome.status == ("interrupted" if kind in {"Ctrl-C", "exit"} else "failed")
    check_safe(outcome, world, store)


@pytest.mark.parametrize("moment", MOMENTS)
def test_abort_at_any_moment(short, station, store, world, moment):
    control = RunControl()

    def hook(name: str) -> None:
        if MOMENTS[moment](world):
            control.abort("stopped by SIGTERM")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock, control=control)
    if moment != "last slot":  # there is nothing left to stop then
        assert outcome.status == "interrupted"
        assert outcome.reason == "stopped by SIGTERM"
    check_safe(outcome, world, store)


@pytest.mark.parametrize("name", ["chamber", "digitiser", "head"])
@pytest.mark.parametrize(
    "error", [LinkError("no reply"), ProtocolError("noise"), DeviceError("no")]
)
def test_an_instrument_lost_in_the_ramp(short, station, store, world, name, error):
    def hook(call: str) -> None:
        lost = world.calls.count("digitiser.scan") >= 12
        ending = call in {"chamber.make_safe", "head.stop"} or "head.stop" in world.calls
        if lost and call.startswith(name) and not ending:
            raise error

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert name in outcome.reason
    assert "lost: 5 failures in a row" in outcome.reason
    check_safe(outcome, world, store)


def test_a_set_point_that_is_never_taken_ends_the_test(short, station, store, world):
    def hook(call: str) -> None:
        if call == "chamber.ramp_to_c":
            raise DeviceError("chamber: exception 4")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert "chamber set point lost" in outcome.reason
    check_safe(outcome, world, store)


@pytest.mark.parametrize(
    "errors",
    [
        [LinkError("no reply")],
        [KeyboardInterrupt()],  # the second Ctrl-C
        [KeyboardInterrupt(), KeyboardInterrupt(), LinkError("gone"), ZeroDivisionError()],
    ],
)
def test_a_disturbed_clean_up_is_tried_again(short, station, store, world, errors):
    pending = iter(errors)

    def hook(call: str) -> None:
        if call == "digitiser.scan" and world.calls.count(call) == 12:
            raise KeyboardInterrupt
        if call == "chamber.make_safe":
            for error in pending:
                raise error

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "interrupted"
    assert world.calls.count("chamber.make_safe") == len(errors) + 1
    check_safe(outcome, world, store)
    steps = "; ".join(outcome.safe.steps)
    assert f"attempt {len(errors)}" in steps or f"to {len(errors)}:" in steps
    assert all(str(error) in steps for error in errors)


def test_an_unverified_result_is_tried_again(short, station, store, world):
    real, answers = station.chamber.make_safe, iter([False, False])

    def make_safe(temp_c: float) -> SafeResult:
        result = real(temp_c)
        return dataclasses.replace(result, verified=next(answers, True))

    station.chamber.make_safe = make_safe
    outcome = run_test(short, station, store, world.clock)
    assert outcome.clean
    assert "attempts 1 to 2: not verified" in outcome.safe.steps


def test_a_clean_up_that_fails_is_its_own_result(short, station, store, world):
    def hook(call: str) -> None:
        if call == "chamber.make_safe":
            raise LinkError("chamber: connection refused")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "finished"
    assert not outcome.safe.verified
    assert not outcome.clean
    (tried,) = (step for step in outcome.safe.steps if "connection refused" in step)
    assert tried.startswith("attempts 1 to ")
    assert int(tried.split()[3].rstrip(":")) > 10  # for 120 s, and told in one line
    record = store.test(outcome.test_id)
    assert json.loads(record.safe_result_json)["verified"] is False
    assert any(event.kind == "not safe" for event in store.events(outcome.test_id))


def test_a_head_that_cannot_be_stopped_is_said(short, station, store, world):
    def hook(call: str) -> None:
        if call == "head.stop":
            raise LinkError("head: no reply")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.safe.verified
    assert not outcome.head_stopped
    assert not outcome.clean


def test_a_chamber_lost_and_found_is_made_safe(short, station, store, world):
    gone_since: list[float] = []

    def hook(call: str) -> None:
        if world.calls.count("digitiser.scan") >= 12 and call.startswith("chamber"):
            gone_since.append(world.clock.now_s())
            if call != "chamber.make_safe" or world.calls.count(call) < 4:
                raise LinkError("chamber: connection lost")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert "chamber lost" in outcome.reason
    check_safe(outcome, world, store)


# ---- limits ----


def test_a_stuck_reading_trips(edit_sequence, station, store, world):
    def hook(call: str) -> None:
        if world.calls.count("digitiser.scan") == 12 and station.chamber.stuck_c is None:
            station.chamber.stuck_c = world.plant.air_temp_c(world.clock.now_s())

    world.hook = hook
    outcome = run_test(edit_sequence(), station, store, world.clock)
    assert "stuck at" in outcome.reason
    check_safe(outcome, world, store)


def test_a_runaway_chamber_trips(edit_sequence, station, store, world):
    text = "[limits]\nchamber_c = [0.0, 40.0]\n[after_gap]"

    def hook(call: str) -> None:
        if call == "digitiser.scan" and world.calls.count(call) == 12:
            world.plant.break_away(world.clock.now_s(), 10 / 60)

    world.hook = hook
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert outcome.status == "failed"
    assert "more than 5 °C outside 0…40 °C" in outcome.reason
    check_safe(outcome, world, store)


def test_a_chamber_off_the_programme_trips_after_the_stated_time(
    edit_sequence, station, store, world
):
    text = "[limits]\nmax_deviation_c = 1.0\nmax_deviation_min = 0.5\nstuck_c = 30.0\n[after_gap]"
    station.chamber.ramp_to_c = lambda temp_c, rate: world.call("chamber.ramp_to_c")
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert outcome.status == "failed"
    assert "from the programme's" in outcome.reason
    check_safe(outcome, world, store)


def test_an_alarm_trips(short, station, store, world):
    def hook(call: str) -> None:
        if world.calls.count("digitiser.scan") == 12:
            station.chamber.alarms = ("over-temperature limit",)

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.reason == "chamber alarm: over-temperature limit"
    check_safe(outcome, world, store)


def test_an_accelerometer_too_hot_trips_and_is_stored(edit_sequence, station, store, world):
    text = "[limits]\naccelerometer_c = [0.0, 26.0]\n[after_gap]"
    hot_ohm = ohm_from_temp_c(40.0, world.config.inputs[0].thermistor)

    def spoil(reading: ChannelReading) -> ChannelReading:
        hot = reading.channel == 111 and world.calls.count("digitiser.scan") > 12
        return dataclasses.replace(reading, value=hot_ohm) if hot else reading

    station.digitiser.spoil = spoil
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert "outside 0…26 °C" in outcome.reason
    check_safe(outcome, world, store)
    assert store.readings(outcome.test_id).temp_c.max() > 39.0


def test_a_start_that_is_never_reached(edit_sequence, station, store, world):
    station.chamber.stuck_c = 25.0
    text = "start_c = 20.0\nstart_timeout_min = 30.0"
    outcome = run_test(edit_sequence(("start_c = 20.0", text)), station, store, world.clock)
    assert "did not come within" in outcome.reason
    check_safe(outcome, world, store)


def test_a_store_that_fails_at_the_end_is_said(short, station, store, world, monkeypatch):
    def refuse(*_: object) -> None:
        raise StoreError("disk full")

    monkeypatch.setattr(store, "finish_test", refuse)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.reason == "all runs done; not stored: disk full"
    assert world.is_safe
    store.claim(outcome.test_id).release()
