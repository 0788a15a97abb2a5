"""Lost thermistors, heads that stay, meters that repeat, readings that are missing."""

import dataclasses
import math

import pytest

from drivers.devices import ChannelReading
from drivers.errors import LinkError
from tests.thermo.station.running import run_test
from thermo.launch.emulated import run_emulated
from thermo.planning.sequence import parse_sequence
from thermo.station.checks.quality import HeadWatch, Repetition
from thermo.station.job import make_job
from thermo.station.outcome import RunControl
from thermo.store.store import open_store


def alarms(store, test_id):
    return [event.text for event in store.events(test_id) if event.kind == "alarm"]


def open_after(station, world, scans, channel=111):
    def spoil(reading: ChannelReading) -> ChannelReading:
        lost = reading.channel == channel and world.calls.count("digitiser.scan") > scans
        return dataclasses.replace(reading, value=math.nan, ok=False) if lost else reading

    station.digitiser.spoil = spoil


def frozen_after(station, world, scans, channel):
    kept: list[float] = []

    def spoil(reading: ChannelReading) -> ChannelReading:
        if reading.channel != channel or world.calls.count("digitiser.scan") <= scans:
            return reading
        kept.append(reading.value)
        return dataclasses.replace(reading, value=kept[0])

    station.digitiser.spoil = spoil


# ---- thermistors ----


def test_a_thermistor_lost_three_times_in_a_row_ends_the_test(short, station, store, world):
    open_after(station, world, 12)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert outcome.reason == (
        "accelerometer QA-001: its thermistor gave no reading, 3 times in a row; its temperature "
        "limit no longer protects"
    )
    assert store.readings(outcome.test_id).slot.max() == 14
    assert world.is_safe


def test_a_thermistor_that_comes_back_is_no_loss(short, station, store, world):
    def spoil(reading: ChannelReading) -> ChannelReading:
        lost = reading.channel == 111 and world.calls.count("digitiser.scan") in {5, 6, 20, 21}
        return dataclasses.replace(reading, value=math.nan, ok=False) if lost else reading

    station.digitiser.spoil = spoil
    outcome = run_test(short, station, store, world.clock)
    assert outcome.clean  # 4 of 56 flagged


def test_a_lost_thermistor_pauses_until_the_operator_resumes(edit_sequence, station, store, world):
    open_after(station, world, 12)
    control = RunControl()
    looks: list[int] = []

    class Operator:
        def on_reading(self, run, rows):
            pass

        def on_event(self, event):
            pass

        def on_progress(self, progress):
            if progress.phase == "pause":
                looks.append(progress.slot)
                if len(looks) == 3:
                    station.digitiser.spoil = lambda reading: reading  # mended
                    control.resume()

    text = '[limits]\non_thermistor_lost = "pause"\n[after_gap]'
    outcome = run_test(
        edit_sequence(("[after_gap]", text)),
        station,
        store,
        world.clock,
        control=control,
        observers=[Operator()],
    )
    assert looks == [15, 15, 15]
    assert outcome.clean  # the segment was repeated
    assert "gave no reading" in alarms(store, outcome.test_id)[0]


def test_a_thermistor_that_repeats_itself_in_a_ramp_is_lost(short, station, store, world):
    frozen_after(station, world, 9, channel=111)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "failed"
    assert "while the chamber moves" in outcome.reason


# ---- head ----


def test_a_head_that_stays_is_told_at_once_and_is_a_complaint(short, station, store, world):
    real = station.head.move_to_deg

    def move_to_deg(angle_deg: float) -> None:
        if world.calls.count("digitiser.scan") < 12:
            real(angle_deg)

    station.head.move_to_deg = move_to_deg
    told_at: list[int] = []

    class Watcher:
        def on_reading(self, run, rows):
            pass

        def on_progress(self, progress):
            pass

        def on_event(self, event):
            if event.kind == "alarm" and "head stays" in event.text:
                told_at.append(world.calls.count("digitiser.scan"))

    outcome = run_test(short, station, store, world.clock, observers=[Watcher()])
    assert outcome.status == "finished"
    assert not outcome.clean
    assert any("although it was sent elsewhere" in text for text in outcome.complaints)
    assert told_at[0] <= 16  # it stands where it should at one slot of four
    assert len(told_at) <= 2  # once a run
    assert outcome.reason == f"all runs done, with {len(outcome.complaints)} complaints"
    assert store.test(outcome.test_id).outcome == outcome.reason
    assert [e.text for e in store.events(outcome.test_id) if e.kind == "complaint"] == list(
        outcome.complaints
    )


def test_a_head_between_two_angles_is_seen_too() -> None:
    watch = HeadWatch()
    seen = [watch.see(0.0, sent) for sent in (0.0, 180.0, 0.0, 180.0, 0.0, 180.0)]
    assert seen == [False] * 5 + [True]


def test_a_head_that_is_slow_but_moves_is_not_stuck() -> None:
    watch = HeadWatch()
    assert not any(watch.see(10.0 * k, 200.0) for k in range(20))


# ---- outputs ----


def test_an_output_that_is_repeated_over_positions_is_told_and_is_a_complaint(
    short, station, store, world
):
    frozen_after(station, world, 12, channel=101)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.status == "finished"
    assert not outcome.clean
    assert any("repeated to the last digit" in text for text in alarms(store, outcome.test_id))
    assert any("QA-001: output" in text for text in outcome.complaints)
    assert not any("QA-002" in text for text in outcome.complaints)


@pytest.mark.parametrize("angles", [[90.0], [0.0, 180.0, 360.0], [30.0, 150.0]])
def test_a_quiet_output_where_gravity_is_the_same_is_no_repetition(angles) -> None:
    repetition = Repetition(0.01)
    forces = [math.sin(math.radians(angle)) for angle in angles * 100]
    assert not any(repetition.see(1.0, force) for force in forces)


def test_one_old_answer_is_no_repetition() -> None:
    repetition = Repetition(0.01)
    pairs = [(1.0, 0.0), (1.0, 1.0), (2.0, 0.0), (2.0, 1.0), (3.0, 0.0)]
    assert not any(repetition.see(value, cause) for value, cause in pairs)
    assert [repetition.see(3.0, cause) for cause in (1.0, math.nan, 0.0, 1.0)][-1]


# ---- shares ----


def test_too_many_missed_slots_are_told_at_once_and_are_a_complaint(
    edit_sequence, station, store, world
):
    def hook(call: str) -> None:
        if call == "digitiser.scan" and world.calls.count(call) % 4 == 0:
            raise LinkError("digitiser: no reply")

    world.hook = hook
    outcome = run_test(edit_sequence(), station, store, world.clock)
    assert outcome.status == "finished"
    assert not outcome.clean
    assert outcome.complaints[0] == (
        "accelerometer QA-001: 14 of 56 slots missed or flagged, 10% are allowed"
    )
    assert "of the last 20 slots" in alarms(store, outcome.test_id)[0]


def test_a_share_that_the_sequence_allows_is_clean(edit_sequence, station, store, world):
    def hook(call: str) -> None:
        if call == "digitiser.scan" and world.calls.count(call) % 4 == 0:
            raise LinkError("digitiser: no reply")

    world.hook = hook
    text = "[limits]\nmax_bad_share = 0.3\n[after_gap]"
    outcome = run_test(edit_sequence(("[after_gap]", text)), station, store, world.clock)
    assert outcome.skipped == 14
    assert outcome.clean


def test_thirty_emulated_accelerometers_are_read(tmp_path):
    serials = [f"X{k}" for k in range(30)]
    under_test = ", ".join(f'{{serial = "{s}", nominal_scale = 1.3}}' for s in serials)
    sequence = parse_sequence(
        f"""
name = "many"
accelerometers = [{under_test}]
[temperature]
start_c = 25.0
segments = [{{kind = "hold", duration_min = 1.0}}]
[positions]
angles_deg = [0.0, 90.0]
[sampling]
period_s = 15.0
"""
    )
    outcome = run_emulated(make_job(sequence, tmp_path / "s.sqlite"))
    assert outcome.clean, outcome
    with open_store(tmp_path / "s.sqlite") as store:
        frame = store.readings(outcome.test_id)
    assert set(frame.serial) == set(serials)
    up = frame[frame.slot == 1]
    # at 90° each shows its nominal 1.3 mA, bias and scale within 5 %
    assert (abs(up.output - 1.3) < 0.065).all()
    assert (abs(frame.temp_c - 25.0) < 1.0).all()


def test_one_accelerometer_of_several_is_enough(short, station, store, world):
    open_after(station, world, 45, channel=102)
    outcome = run_test(short, station, store, world.clock)
    assert outcome.complaints == (
        "accelerometer QA-002: 11 of 56 slots missed or flagged, 10% are allowed",
    )
