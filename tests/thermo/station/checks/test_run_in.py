"""A run-in on a station: it stops by itself, and a resumed one decides as if nothing had been."""

from pathlib import Path

import pytest

from errormodel.errors import InputError, StoreError
from tests.thermo.station.running import run_test
from thermo.planning.sequence import load_sequence, parse_sequence, sequence_toml
from thermo.station.checks.run_in import decide_run_in, judge_stored
from thermo.station.outcome import Decision, RunControl
from thermo.twin.plant import make_plant

FILE = Path(__file__).parents[2] / "run-in.toml"


@pytest.fixture
def sequence():
    return load_sequence(FILE)


@pytest.fixture
def world(world):
    world.plant = make_plant(world.config, new_from_assembly=True)
    return world


def limited(within=15.0, **keys):
    text = FILE.read_text(encoding="utf-8")
    made = "\n".join(f"{name} = {value}" for name, value in keys.items())
    text = text.replace("_ug = 15.0", f"_ug = {within}")
    return parse_sequence(text.replace("_ppm = 15.0", f"_ppm = {within}\n{made}"))


# within 15 µg it takes some twenty cycles and within 40 µg fifteen; to decide after a cycle takes
# as long as to run it
@pytest.mark.slow  # through the command by default, tests/accelbench/commands/run_in
@pytest.mark.parametrize(("within", "first"), [(40.0, 12), (15.0, 4)])
def test_it_stops_by_itself_as_soon_as_the_stored_readings_say_so(
    station, store, world, within, first
):
    sequence = limited(within, min_cycles=first)
    outcome = run_test(sequence, station, store, world.clock)
    assert outcome.clean
    runs = store.test(outcome.test_id).runs
    assert outcome.reason == f"run-in: all accelerometers settled after {len(runs)} cycles"
    assert 6 <= len(runs) < 25  # 300 µg over some 2.5 cycles to 15 µg: not before the sixth
    (verdict,) = judge_stored(store, outcome.test_id, sequence.run_in)
    assert verdict.settled
    before = [
        decide_run_in(store, outcome.test_id, sequence, k).stop for k in range(1, len(runs) + 1)
    ]
    assert before == [False] * (len(runs) - 1) + [True]
    told = [e.text for e in store.events(outcome.test_id) if e.kind == "run-in"]
    assert len(told) == len(runs) - first + 1
    assert "cycles still needed" in told[0]
    with pytest.raises(StoreError, match="is finished"):
        run_test(None, station, store, world.clock, resume=outcome.test_id)


def test_an_interrupted_run_in_goes_on_and_stops_by_itself(station, store, world):
    sequence = limited(min_cycles=18)
    control = RunControl()

    def hook(name):
        if name == "digitiser.scan" and world.calls.count(name) == 5 * 88 + 30:
            control.abort("interrupted")

    world.hook = hook
    outcome = run_test(sequence, station, store, world.clock, control=control)
    assert outcome.status == "interrupted"
    world.hook = lambda _: None
    again = run_test(None, station, store, world.clock, resume=outcome.test_id)
    assert again.clean
    runs = store.test(outcome.test_id).runs
    assert again.reason == f"run-in: all accelerometers settled after {len(runs)} cycles"
    assert all(run.status == "finished" for run in runs)


def test_a_run_in_that_ended_between_the_cycle_and_the_decision_decides_first(
    sequence, station, store, world, monkeypatch
):
    """No cycle is run that the stored ones make needless."""

    def at_the_second(store, test_id, sequence, cycles):
        return Decision(stop=cycles == 2, reason="enough", lines=(f"{cycles}",))

    monkeypatch.setattr("thermo.station.runs.decide_run_in", at_the_second)

    class Ender:
        def on_reading(self, run, rows): ...
        def on_progress(self, progress): ...
        def on_event(self, event):
            if event.kind == "run finished" and event.run == 2:
                raise KeyboardInterrupt

    outcome = run_test(sequence, station, store, world.clock, observers=[Ender()])
    assert outcome.status == "interrupted"
    scans = world.calls.count("digitiser.scan")
    again = run_test(None, station, store, world.clock, resume=outcome.test_id)
    assert again.clean
    assert again.reason == "enough"
    assert world.calls.count("digitiser.scan") == scans
    assert len(store.test(outcome.test_id).runs) == 2


def test_at_the_most_cycles_it_ends_and_says_who_has_not_settled(station, store, world):
    outcome = run_test(limited(max_cycles=4), station, store, world.clock)
    assert outcome.clean
    assert outcome.reason == "4 cycles done, not settled: QA-001"


def test_a_section_that_contradicts_itself_is_refused():
    with pytest.raises(InputError, match="min_cycles 9 is above max_cycles 5"):
        limited(min_cycles=9, max_cycles=5)
    text = FILE.read_text(encoding="utf-8").replace("start_c", "repeats = 3\nstart_c", 1)
    with pytest.raises(InputError, match="repeats"):
        parse_sequence(text)


def test_the_section_goes_through_the_store_unchanged(sequence):
    assert parse_sequence(sequence_toml(sequence)) == sequence
