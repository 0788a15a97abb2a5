"""Somebody else changes the chamber while a test runs: it ends, pauses or goes on, and tells."""

import pytest

from drivers.errors import LinkError, RecognitionError
from tests.thermo.station.commanding import ACCEPT, WRITES, kinds, with_rule
from tests.thermo.station.running import run_test
from thermo.station.outcome import RunControl


class Meddler:
    """Changes the chamber at its panel after some scans; what is commanded next undoes it."""

    def __init__(self, world, station, at, change="set point 80 °C, commanded 26 °C"):
        self.world, self.station, self.at, self.change = world, station, at, change
        self.seen_s = 0.0

    def __call__(self, call: str) -> None:
        if call == "digitiser.scan" and self.world.calls.count(call) == self.at:
            self.station.chamber.foreign = (self.change,)
            self.seen_s = self.world.clock.now_s()
        elif call in {"chamber.hold_temp_c", "chamber.ramp_to_c", "chamber.make_safe"}:
            self.station.chamber.foreign = ()


class Resumer:
    """The operator, who resumes some looks after a pause; counts the commands before that."""

    def __init__(self, world, control, looks=30):
        self.world, self.control, self.looks = world, control, looks
        self.paused_at = self.resumed_at = -1

    def on_reading(self, run, rows):
        pass

    def on_event(self, event):
        if event.kind == "pause":
            self.paused_at = len(self.world.calls)

    def on_progress(self, progress):
        if progress.phase == "pause" and self.looks:
            self.looks -= 1
            if not self.looks:
                self.resumed_at = len(self.world.calls)
                self.control.resume()


def test_a_foreign_change_ends_the_test_at_once(short, station, store, world):
    meddler = Meddler(world, station, at=12)
    world.hook = meddler
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert outcome.reason == f"somebody else changed the chamber: {meddler.change}"
    assert kinds(store, outcome.test_id).count("foreign change") == 1
    assert world.is_safe
    frame = store.readings(outcome.test_id)
    assert set(frame.flag[frame.slot == 11]) == {"foreign"}
    assert set(frame.flag[frame.slot < 11]) == {""}


@pytest.mark.parametrize("rule", ["end", "tell"])
def test_a_command_of_the_programme_does_not_hide_a_foreign_change_that_no_look_saw(
    short, station, store, world, rule
):
    # the chamber fails to answer from the change at the ramp's end to the hold that undoes it
    with_rule(station, rule)
    meddler = Meddler(world, station, at=20)

    def hook(call: str) -> None:
        meddler(call)
        if call == "chamber.read_temp_c" and station.chamber.foreign:
            raise LinkError("no reply")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == ("failed" if rule == "end" else "finished")
    assert not outcome.clean
    assert kinds(store, outcome.test_id).count("foreign change") == 1
    assert world.is_safe


def test_an_instrument_that_is_no_longer_recognised_ends_the_test_at_once(
    short, station, store, world
):
    def hook(call: str) -> None:
        if call == "chamber.read_temp_c" and world.calls.count("digitiser.scan") == 12:
            raise RecognitionError("chamber: not recognised: decimals 2, was 1")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert outcome.reason == "chamber: not recognised: decimals 2, was 1"
    assert world.calls.count("digitiser.scan") == 12


def test_a_foreign_change_between_far_slots_is_seen_within_seconds(
    edit_sequence, station, store, world
):
    sequence = edit_sequence(("period_s = 15.0", "period_s = 120.0"))
    first_scan_s: list[float] = []

    def hook(call: str) -> None:
        if call == "digitiser.scan":
            first_scan_s.append(world.clock.now_s())

    def read_foreign_changes() -> tuple[str, ...]:
        changed = first_scan_s and world.clock.now_s() > first_scan_s[0] + 35.0
        return ("the loop is off",) if changed else ()

    world.hook = hook
    station.chamber.read_foreign_changes = read_foreign_changes
    outcome = run_test(sequence, station, store, world.clock)
    assert outcome.reason == "somebody else changed the chamber: the loop is off"
    assert len(first_scan_s) == 1
    # a look each 10 s, and none is begun in the 2 s before a slot
    assert world.clock.now_s() - (first_scan_s[0] + 35.0) <= 12.0


def test_a_foreign_change_on_the_way_to_the_start_is_seen(short, station, store, world):
    def hook(call: str) -> None:
        if world.calls.count("chamber.read_temp_c") == 5:
            station.chamber.foreign = ("the loop is off",)

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert outcome.readings == 0
    assert "the loop is off" in outcome.reason


def test_a_foreign_change_that_is_only_told_flags_and_fails_the_test(short, station, store, world):
    with_rule(station, "tell")
    world.hook = Meddler(world, station, at=10)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "finished"
    assert not outcome.clean
    assert any("somebody else changed the chamber" in c for c in outcome.complaints)
    assert kinds(store, outcome.test_id).count("foreign change") == 1
    frame = store.readings(outcome.test_id)
    first, second = frame[frame.run == 1], frame[frame.run == 2]
    assert (first.flag[first.slot >= 9] == "foreign").all()
    assert (first.flag[first.slot < 9] == "").all()
    # the second run begins at a temperature of its own
    assert (second.flag == "").all()


@pytest.mark.parametrize("rule", ["resoak", "accept"])
def test_a_foreign_change_pauses_and_is_left_alone_until_the_operator_resumes(
    edit_sequence, station, store, world, rule
):
    with_rule(station, "pause")
    world.hook = Meddler(world, station, at=12)
    control = RunControl()
    operator = Resumer(world, control)
    outcome = run_test(
        edit_sequence(*((ACCEPT,) if rule == "accept" else ())),
        station,
        store,
        world.clock,
        control=control,
        observers=[operator],
    )
    assert outcome.status == "finished", outcome.reason
    assert not outcome.clean
    assert 0 < operator.paused_at < operator.resumed_at
    paused = world.calls[operator.paused_at : operator.resumed_at]
    assert not set(paused) & set(WRITES)
    assert paused.count("chamber.read_temp_c") >= 30  # its limits are watched all the while
    frame = store.readings(outcome.test_id, 1)
    valid = frame[(frame.voided == "") & (frame.serial == "QA-001")]
    assert sorted(valid.slot) == list(range(28))  # nothing twice, nothing lost
    if rule == "resoak":
        assert (valid.flag == "").all()
        assert set(frame[frame.voided != ""].segment) == {1}
    else:
        assert valid.flag[valid.slot > 11].str.contains("foreign").all()


def test_a_foreign_change_in_the_approach_pauses_and_the_approach_begins_anew(
    short, station, store, world
):
    with_rule(station, "pause")
    meddler = Meddler(world, station, at=0)
    control = RunControl()
    operator = Resumer(world, control)

    def hook(call: str) -> None:
        if world.calls.count("chamber.read_temp_c") == 5:
            station.chamber.foreign = (meddler.change,)
        meddler(call)

    world.hook = hook
    outcome = run_test(short, station, store, world.clock, control=control, observers=[operator])
    assert outcome.status == "finished"
    assert operator.resumed_at > 0
    assert world.calls[operator.resumed_at :].index("chamber.hold_temp_c") < 5
    frame = store.readings(outcome.test_id)
    assert (frame.flag == "").all()
    assert len(frame) == 2 * 2 * 28


def test_the_limits_hold_while_the_chamber_is_left_to_somebody_else(
    edit_sequence, station, store, world
):
    with_rule(station, "pause")
    meddler = Meddler(world, station, at=12)

    def hook(call: str) -> None:
        meddler(call)
        if station.chamber.foreign and call == "digitiser.scan":
            world.plant.break_away(world.clock.now_s(), 10 / 60)

    world.hook = hook
    text = "[limits]\nchamber_c = [0.0, 40.0]\n[after_gap]"
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert outcome.status == "failed"
    assert "outside 0…40 °C" in outcome.reason
    assert "chamber.make_safe" in world.calls


def test_a_read_back_that_fails_is_counted_like_any_other(short, station, store, world):
    def hook(call: str) -> None:
        if call == "chamber.read_foreign_changes" and world.calls.count("digitiser.scan") >= 12:
            raise LinkError("chamber: no reply")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert "chamber's set point and mode lost: 5 failures in a row" in outcome.reason
    assert world.is_safe
