import dataclasses
import json
import math
from itertools import pairwise

import numpy as np
import pytest

from drivers.devices import ChannelReading
from drivers.errors import LinkError
from errormodel.errors import InputError, StoreError
from tests.thermo.station.running import run_test
from thermo.planning.plan import make_plan
from thermo.station.outcome import RunControl

HEAD_ENCODER_DEG = 0.01  # the twin's head stops closer than this to where it was sent


def test_every_slot_is_read_on_time_in_its_place(short, station, store, world):
    outcome = run_test(short, station, store, world.clock)
    assert outcome.clean
    frame = store.readings(outcome.test_id)
    plan = make_plan(short, world.config)
    assert len(frame) == plan.readings == outcome.readings
    assert (frame.flag == "").all()
    assert (frame.lateness_s == 0).all()  # the clock stands still while nobody waits
    for number, run in frame[frame.serial == "QA-001"].groupby("run"):
        expected = plan.run(int(number))
        # the output is the first channel of the scan
        np.testing.assert_allclose(run.time_s, expected.time_s, atol=1e-6)
        np.testing.assert_allclose(run.position_deg, expected.position_deg, atol=HEAD_ENCODER_DEG)
        assert run.segment.tolist() == expected.segment.tolist()
    second = frame[frame.serial == "QA-002"].time_s.to_numpy()
    first = frame[frame.serial == "QA-001"].time_s.to_numpy()
    np.testing.assert_allclose(second - first, 0.04, atol=1e-9)  # two channels later


def test_the_ramp_is_uniform_and_commanded_once(short, station, store, world):
    outcome = run_test(short, station, store, world.clock)
    assert world.calls.count("chamber.ramp_to_c") == 2  # one ramp in each of two runs
    frame = store.readings(outcome.test_id, 1)
    ramp = frame[(frame.segment == 1) & (frame.serial == "QA-001")]
    slope = np.polyfit(ramp.time_s[4:], ramp.chamber_c[4:], 1)[0] * 60
    # 2 °C/min behind the air's lag of 60 s: exp(-1) to exp(-3) of it is still missing
    assert 1.5 < slope < 2.0


def test_what_is_stored_is_what_the_plant_did(short, station, store, world):
    outcome = run_test(short, station, store, world.clock)
    frame = store.readings(outcome.test_id)
    wiring = {i.serial: i for i in world.config.inputs}
    sin = np.sin(np.radians(frame.position_deg.to_numpy()))
    # mA per g of 1.3, bias, misalignment and their temperature terms are below 5 % of it
    np.testing.assert_allclose(frame.output, 1.3 * sin, atol=0.065)
    assert wiring["QA-001"].output_unit == "mA"


def test_sequence_versions_and_settings_are_kept(short, station, store, world):
    outcome = run_test(short, station, store, world.clock)
    record = store.test(outcome.test_id)
    assert record.status == "finished"
    assert [run.status for run in record.runs] == ["finished", "finished"]
    assert record.settings["identity"] == {n: f"fake {n}" for n in ("chamber", "digitiser", "head")}
    assert "numpy" in record.versions
    assert json.loads(record.station_json)["name"] == "f4t"
    assert json.loads(record.safe_result_json)["verified"] is True


@pytest.mark.parametrize(
    ("channel", "spoilt", "empty", "kept", "flag"),
    [
        (101, {"value": math.nan, "ok": False}, "output", "temp_c", "overload"),
        (101, {"value": math.inf}, "output", "temp_c", "overload"),
        (111, {"value": math.nan, "ok": False}, "temp_c", "output", "thermistor"),
        (111, {"value": 0.0}, "temp_c", "output", "thermistor"),  # shorted
        (111, {"value": 1e9}, "temp_c", "output", "thermistor"),  # open
    ],
)
def test_a_bad_channel_leaves_an_empty_flagged_value(
    edit_sequence, station, store, world, channel, spoilt, empty, kept, flag
):
    def spoil(reading: ChannelReading) -> ChannelReading:
        return dataclasses.replace(reading, **spoilt) if reading.channel == channel else reading

    station.digitiser.spoil = spoil
    text = "[limits]\nmax_thermistor_losses = 1000\n[after_gap]"
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert outcome.status == "finished"
    assert not outcome.clean
    assert outcome.complaints == (
        "accelerometer QA-001: 56 of 56 slots missed or flagged, 10% are allowed",
    )
    frame = store.readings(outcome.test_id)
    bad = frame[frame.serial == "QA-001"]
    assert bad[empty].isna().all()
    assert bad[kept].notna().all()
    assert (bad.flag == flag).all()
    good = frame[frame.serial == "QA-002"]
    assert good[["temp_c", "output"]].notna().all().all()
    assert (good.flag == "").all()
    assert outcome.flagged == len(bad)


def test_a_head_still_turning_is_flagged_and_has_no_position(edit_sequence, station, store, world):
    station.head.speed_deg_per_s = 10.0  # slower than the station file says: 270° take 27 s of 15
    outcome = run_test(edit_sequence(), station, store, world.clock)
    frame = store.readings(outcome.test_id)
    late = frame[frame.flag == "moving"]
    assert len(late) > 0
    assert late.position_deg.isna().all()
    rest = frame[frame.flag == ""]
    sent = np.round(rest.position_deg / 90) * 90
    np.testing.assert_allclose(rest.position_deg, sent, atol=HEAD_ENCODER_DEG)


def test_a_failed_scan_is_skipped_and_counted(short, station, store, world):
    scans = iter(range(10_000))

    def hook(name: str) -> None:
        if name == "digitiser.scan" and next(scans) in {3, 4, 20}:
            raise LinkError("digitiser: no reply in 10 s")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "finished"
    assert outcome.skipped == 3
    frame = store.readings(outcome.test_id, 1)
    assert sorted(set(range(28)) - set(frame.slot)) == [3, 4, 20]
    kinds = [event.kind for event in store.events(outcome.test_id)]
    assert kinds.count("skipped") == kinds.count("fault") == 3


def test_a_chamber_that_cannot_be_read_leaves_its_column_empty(short, station, store, world):
    reads = iter(range(10_000))

    def hook(name: str) -> None:
        if name == "chamber.read_temp_c" and world.calls.count("digitiser.scan") in {5, 6}:
            next(reads)
            raise LinkError("chamber: no reply")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "finished"
    frame = store.readings(outcome.test_id, 1)
    assert frame[frame.chamber_c.isna()].slot.unique().tolist() == [4, 5]
    assert frame.output.notna().all()


def test_slots_overtaken_by_the_time_are_left_out_never_bunched(short, station, store, world):
    def hook(name: str) -> None:
        if name == "chamber.read_temp_c" and world.calls.count("digitiser.scan") == 5:
            world.hook = lambda _: None
            world.clock.sleep_until_s(world.clock.now_s() + 50)  # a driver's long retries

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    frame = store.readings(outcome.test_id, 1)
    one = frame[frame.serial == "QA-001"]
    # slot 4 at 60 s took until 110 s; 75 and 90 are missed wholly, the head needs to turn for 105
    assert sorted(set(range(28)) - set(one.slot)) == [5, 6, 7]
    assert (np.diff(one.time_s) > 14.9).all()
    assert outcome.skipped == 3
    assert any(e.kind == "missed" for e in store.events(outcome.test_id))


def test_lateness_does_not_add_up(edit_sequence, station, store, world):
    """Every scan takes 0.7 s of the clock: each slot begins on its own absolute deadline."""

    def hook(name: str) -> None:
        if name == "digitiser.scan":
            world.clock.sleep_until_s(world.clock.now_s() + 0.7)

    world.hook = hook
    outcome = run_test(edit_sequence(), station, store, world.clock)
    frame = store.readings(outcome.test_id)
    assert (frame.lateness_s.abs() < 1e-6).all()


class Watcher:
    def __init__(self, world=None) -> None:
        self.rows, self.events, self.progress = [], [], []
        self.world = world

    def on_reading(self, run, rows):
        self.rows += [(run, row) for row in rows]

    def on_progress(self, progress):
        self.progress.append(progress)

    def on_event(self, event):
        self.events.append(event)


def test_observers_see_stored_readings_and_falling_time_left(short, station, store, world):
    class Checks(Watcher):
        def on_reading(self, run, rows):
            super().on_reading(run, rows)
            (test,) = store.tests()
            last = store.last_reading(test.id, run)
            assert last is not None
            assert last.slot == rows[-1].slot

    watcher = Checks()
    outcome = run_test(short, station, store, world.clock, observers=[watcher])
    assert len(watcher.rows) == outcome.readings  # no assertion in it has failed
    running = [p.left_s for p in watcher.progress if p.phase == "run" and p.run == 1]
    assert all(b < a for a, b in pairwise(running))
    assert watcher.progress[-1].left_s < 30
    assert {p.phase for p in watcher.progress} == {"approach", "run", "rest"}


def test_a_failing_observer_never_stops_the_test(short, station, store, world):
    class Broken(Watcher):
        def on_reading(self, run, rows):
            raise RuntimeError("screen is gone")

        on_progress = on_event = on_reading

    watcher = Watcher()
    outcome = run_test(short, station, store, world.clock, observers=[Broken(), watcher])
    assert outcome.clean
    assert len(watcher.rows) == outcome.readings


def test_nothing_is_touched_when_the_station_cannot_do_it(edit_sequence, station, store, world):
    with pytest.raises(InputError, match="outside"):
        run_test(edit_sequence(("to_c = 26.0", "to_c = 99.0")), station, store, world.clock)
    assert world.calls == []
    assert store.tests() == ()


def test_an_instrument_missing_from_the_start_stores_nothing(short, station, store, world):
    def hook(name: str) -> None:
        if name == "head.identify":
            raise LinkError("head: no reply in 1 s")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert (outcome.status, outcome.test_id) == ("failed", "")
    assert "head: no reply" in outcome.reason
    assert not outcome.safe.verified
    assert not outcome.safe.commanded
    assert "chamber.make_safe" not in world.calls
    assert "head.stop" not in world.calls
    assert store.tests() == ()


def test_an_unknown_test_cannot_be_resumed(station, store, world):
    with pytest.raises(StoreError, match="nosuch"):
        run_test(None, station, store, world.clock, resume="nosuch")
    assert world.calls == []


def test_control_is_fit_for_signal_handlers():
    control = RunControl()
    control.abort("first")
    control.abort("second")
    with pytest.raises(Exception, match=r"^first$"):
        control.check()
