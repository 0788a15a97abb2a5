import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import SteppedClock
from errormodel.errors import StoreError
from tests.thermo.station.running import run_test
from thermo.planning.plan import make_plan
from thermo.station.outcome import RunControl
from thermo.station.resume_point import find_resume_point
from thermo.store.store import open_store

OLD_STORE = Path(__file__).parents[1] / "store/cases/version-1.sql"
ACCEPT = ('gap_rule = "resoak"', 'gap_rule = "accept"')


def interrupt_after(world, control, scans):
    def hook(name: str) -> None:
        if name == "digitiser.scan" and world.calls.count(name) == scans:
            control.abort("interrupted")

    world.hook = hook


def interrupted(sequence, station, store, world, scans):
    control = RunControl()
    interrupt_after(world, control, scans)
    outcome = run_test(sequence, station, store, world.clock, control=control)
    assert outcome.status == "interrupted"
    world.hook = lambda _: None
    return outcome.test_id


@pytest.mark.parametrize("scans", [1, 7, 8, 9, 13, 20, 21, 27, 28, 29, 40, 55])
def test_resoak_repeats_the_segment(short, station, store, world, scans):
    test_id = interrupted(short, station, store, world, scans)
    before = store.readings(test_id)
    world.clock.sleep_until_s(world.clock.now_s() + 5000)
    outcome = run_test(None, station, store, world.clock, resume=test_id)
    assert outcome.clean
    assert outcome.test_id == test_id
    frame = store.readings(test_id)
    kept = frame.merge(before, how="inner", on=["run", "serial", "slot", "attempt", "time_s"])
    assert len(kept) == len(before)  # nothing that was there has gone or changed
    valid = frame[frame.voided == ""]
    for _, one in valid.groupby(["run", "serial"]):
        assert sorted(one.slot) == list(range(28))  # every slot counts once
        assert (np.diff(one.time_s) > 14.9).all()
    # the repeated segment was begun from its own temperature
    for _, segment in valid.groupby(["run", "segment", "attempt"]):
        first = segment.sort_values("time_s").iloc[0]
        assert first.chamber_c == pytest.approx({0: 20, 1: 20, 2: 26}[first.segment], abs=2.5)


def test_the_time_axis_goes_on(short, station, store, world):
    test_id = interrupted(short, station, store, world, 12)
    last = store.last_reading(test_id, 1)
    world.clock.sleep_until_s(world.clock.now_s() + 5000)
    run_test(None, station, store, world.clock, resume=test_id)
    again = store.readings(test_id, 1)
    repeated = again[(again.segment == 1) & (again.attempt == 2)]
    # the gap, the way back and 3 min of soak lie between
    assert repeated.time_s.min() > last.time_s + 5000 + 180


def test_another_clock_never_goes_back_behind_the_last_reading(short, station, store, world):
    test_id = interrupted(short, station, store, world, 12)
    last = store.last_reading(test_id, 1)
    world.clock = SteppedClock(world.clock.now_s() + 3.0)  # another object: another time base
    outcome = run_test(None, station, store, world.clock, resume=test_id)
    assert outcome.clean
    again = store.readings(test_id, 1)
    assert again[again.attempt == 2].time_s.min() > last.time_s


def test_accept_goes_on_with_the_gap_marked(edit_sequence, station, store, world):
    test_id = interrupted(edit_sequence(ACCEPT), station, store, world, 12)
    world.clock.sleep_until_s(world.clock.now_s() + 50)
    outcome = run_test(None, station, store, world.clock, resume=test_id)
    assert outcome.clean
    frame = store.readings(test_id, 1)
    one = frame[frame.serial == "QA-001"].sort_values("time_s")
    assert (one.voided == "").all()
    assert (one.attempt == 1).all()
    missing = sorted(set(range(28)) - set(one.slot))
    assert missing
    assert missing == list(range(missing[0], missing[-1] + 1))
    after = one[one.slot > missing[-1]].iloc[0]
    assert after.flag == "gap"
    # the schedule was not moved: every slot is where it was planned
    np.testing.assert_allclose(one.time_s, 15.0 * one.slot, atol=1e-6)
    assert any(e.kind == "gap" for e in store.events(test_id))


def test_a_gap_too_long_to_accept_is_resoaked(edit_sequence, station, store, world):
    test_id = interrupted(edit_sequence(ACCEPT), station, store, world, 12)
    world.clock.sleep_until_s(world.clock.now_s() + 601)
    assert run_test(None, station, store, world.clock, resume=test_id).clean
    frame = store.readings(test_id, 1)
    assert (frame[frame.attempt == 2].segment == 1).all()
    assert (frame[(frame.segment == 1) & (frame.attempt == 1)].voided == "superseded").all()


def test_interrupted_again_and_again(short, station, store, world):
    test_id = interrupted(short, station, store, world, 12)
    for scans in (3, 1, 15, 30):
        control = RunControl()
        interrupt_after(world, control, world.calls.count("digitiser.scan") + scans)
        run_test(None, station, store, world.clock, resume=test_id, control=control)
    world.hook = lambda _: None
    assert run_test(None, station, store, world.clock, resume=test_id).clean
    frame = store.readings(test_id)
    valid = frame[frame.voided == ""]
    assert len(valid) == 2 * 2 * 28
    assert frame.attempt.max() >= 3


def test_interrupted_while_it_resoaks(short, station, store, world):
    test_id = interrupted(short, station, store, world, 12)
    control = RunControl()
    reads = world.calls.count("chamber.read_temp_c")

    def hook(name: str) -> None:
        if world.calls.count("chamber.read_temp_c") == reads + 5:
            control.abort()

    world.hook = hook
    run_test(None, station, store, world.clock, resume=test_id, control=control)
    world.hook = lambda _: None
    assert run_test(None, station, store, world.clock, resume=test_id).clean
    frame = store.readings(test_id)
    assert len(frame[frame.voided == ""]) == 2 * 2 * 28


def test_interrupted_before_the_first_run(short, station, store, world):
    control = RunControl()

    def hook(name: str) -> None:
        if world.calls.count("chamber.read_temp_c") == 3:
            control.abort()

    world.hook = hook
    outcome = run_test(short, station, store, world.clock, control=control)
    assert outcome.readings == 0
    world.hook = lambda _: None
    assert run_test(None, station, store, world.clock, resume=outcome.test_id).clean


def test_interrupted_in_the_rest_the_whole_rest_is_repeated(short, station, store, world):
    control = RunControl()

    def hook(name: str) -> None:
        if world.calls.count("digitiser.scan") == 28 and world.clock.now_s() > 700:
            control.abort()

    world.hook = hook
    outcome = run_test(short, station, store, world.clock, control=control)
    world.hook = lambda _: None
    assert run_test(None, station, store, world.clock, resume=outcome.test_id).clean
    kinds = [e.kind for e in store.events(outcome.test_id)]
    assert kinds.count("power off") == 2
    assert kinds.count("power on") == 1


def test_a_finished_test_cannot_be_resumed(short, station, store, world):
    outcome = run_test(short, station, store, world.clock)
    before = len(world.calls)
    with pytest.raises(StoreError, match="finished"):
        run_test(None, station, store, world.clock, resume=outcome.test_id)
    assert len(world.calls) == before


def test_another_sequence_is_refused(short, edit_sequence, station, store, world):
    test_id = interrupted(short, station, store, world, 5)
    other = edit_sequence(("period_s = 15.0", "period_s = 20.0"))
    with pytest.raises(StoreError, match="different sequence"):
        run_test(other, station, store, world.clock, resume=test_id)


class Pauser:
    """Pauses at one reading and goes on after some looks at the chamber."""

    def __init__(self, control, at, looks):
        self.control, self.at, self.looks = control, at, looks

    def on_reading(self, run, rows):
        self.at -= 1
        if self.at == 0:
            self.control.pause()

    def on_progress(self, progress):
        if progress.phase == "pause":
            self.looks -= 1
            if self.looks == 0:
                self.control.resume()

    def on_event(self, event):
        pass


def test_a_pause_accepted_moves_the_schedule(edit_sequence, station, store, world):
    control = RunControl()
    pauser = Pauser(control, at=12, looks=20)
    outcome = run_test(
        edit_sequence(ACCEPT), station, store, world.clock, observers=[pauser], control=control
    )
    assert outcome.clean
    frame = store.readings(outcome.test_id, 1)
    one = frame[frame.serial == "QA-001"]
    assert one.slot.tolist() == list(range(28))
    gaps = np.diff(one.time_s)
    assert np.count_nonzero(gaps > 15.1) == 1
    assert gaps.max() == pytest.approx(15 + 200, abs=15)  # 20 looks, one each 10 s
    assert one[one.flag == "gap"].slot.tolist() == [12]
    # held at the temperature of the pause and taken further from there
    # (the air was 2 °C/min × 60 s behind the programme, and caught up in the pause)
    assert one.chamber_c.iloc[12] == pytest.approx(one.chamber_c.iloc[11], abs=2.1)
    assert one.chamber_c.iloc[-1] == pytest.approx(26, abs=1.0)


def test_a_pause_resoaked_repeats_the_segment(short, station, store, world):
    control = RunControl()
    pauser = Pauser(control, at=12, looks=5)
    outcome = run_test(short, station, store, world.clock, observers=[pauser], control=control)
    assert outcome.clean
    frame = store.readings(outcome.test_id, 1)
    assert len(frame[frame.voided == ""]) == 2 * 28
    assert set(frame[frame.attempt == 2].segment) == {1}


def test_abort_in_a_pause(short, station, store, world):
    control = RunControl()

    class Aborts(Pauser):
        def on_progress(self, progress):
            if progress.phase == "pause":
                control.abort("enough")

    pauser = Aborts(control, at=12, looks=5)
    outcome = run_test(short, station, store, world.clock, observers=[pauser], control=control)
    assert (outcome.status, outcome.reason) == ("interrupted", "enough")
    assert world.is_safe


def test_a_test_in_a_store_of_an_earlier_version_goes_on(short, station, world, tmp_path):
    # interrupted while segment 1 was soaked again for its third attempt: only the mark tells that
    with closing(sqlite3.connect(tmp_path / "old.sqlite")) as db:
        db.executescript(OLD_STORE.read_text(encoding="utf-8"))
    with open_store(tmp_path / "old.sqlite") as store:
        (test,) = store.tests()
        before = store.readings(test.id)
        point = find_resume_point(store, test.id, make_plan(short, world.config), world.clock)
        assert (point.run, point.slot, point.segment, point.attempt) == (1, 0, 1, 3)
        assert (point.shift_s, point.mid_segment) == (325.5, False)
        assert run_test(None, station, store, world.clock, resume=test.id).clean
        frame = store.readings(test.id)
    kept = frame.merge(before, how="inner", on=["run", "serial", "slot", "attempt", "time_s"])
    assert len(kept) == len(before)
    valid = frame[frame.voided == ""]
    for _, one in valid.groupby(["run", "serial"]):
        assert sorted(one.slot) == list(range(28))
    assert set(valid[(valid.run == 1) & (valid.segment == 1)].attempt) == {3}  # 3 had none yet
