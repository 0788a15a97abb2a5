"""A test whose store goes away under it: it goes on, limits are watched, and nothing is lost."""

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from errormodel.errors import InputError
from tests.thermo.station.running import run_test
from tests.thermo.station.test_faults import SEQUENCE
from tests.thermo.store.outages import away
from thermo.launch.emulated import run_emulated
from thermo.planning.sequence import parse_sequence
from thermo.station.job import make_job
from thermo.station.runs import RunSeries
from thermo.store.files import open_existing_store
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool.spooled_store import open_spooled_store
from thermo.store.store import open_store

PATIENCE_S = 0.3


class Outage:
    """Takes the store away with one scan of the multimeter and gives it back with another.

    A test that waited for it would wait for ever: the scan that gives it back would not come.
    """

    def __init__(self, world, url: str, begin: int, end: int | None = None) -> None:
        self._url, self._begin, self._end = url, begin, end
        self._stack = ExitStack()
        self._scans = 0
        self.readings_while_away = 0
        world.hook = self

    def __call__(self, name: str) -> None:
        if name != "digitiser.scan":
            return
        self._scans += 1
        if self._scans == self._end:
            self.end()
        elif self._scans > self._begin:
            self.readings_while_away += self._end is None or self._scans < self._end
        elif self._scans == self._begin:
            self._stack.enter_context(away(self._url))

    def end(self) -> None:
        self._stack.close()

    def __enter__(self) -> "Outage":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


def test_a_test_goes_on_without_its_store_and_nothing_is_lost(
    short, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:
        # from the first run's ramp into the second run's, and so over the end of a run
        with Outage(world, store_url, begin=12, end=50) as outage:
            outcome = run_test(short, station, store, world.clock)
        assert store.settle(60.0) == ""
    assert outcome.status == "finished", outcome
    assert outcome.skipped == outcome.flagged == 0
    assert outage.readings_while_away == 37
    with open_existing_store(store_url) as store:
        test = store.test(outcome.test_id)
        frame = store.readings(outcome.test_id)
        events = store.events(outcome.test_id)
    assert (test.status, [r.status for r in test.runs]) == ("finished", ["finished"] * 2)
    assert len(frame) == outcome.readings == 2 * 2 * 28
    assert not frame.duplicated(["run", "slot", "serial"]).any()
    assert len(events) == len({(e.kind, e.text, e.time_s, e.logged_utc) for e in events})
    said = [e.text for e in events if e.kind == "ramp"]
    assert sum("run 1 has no verdict yet" in text for text in said) == 1


def test_a_test_that_is_done_while_its_store_is_away_is_finished_with_a_complaint(
    short, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:
        with Outage(world, store_url, begin=40):
            outcome = run_test(short, station, store, world.clock)
        assert store.settle(60.0) == ""
    assert outcome.status == "finished"
    assert not outcome.clean
    (complaint,) = outcome.complaints
    assert "not checked" in complaint
    assert world.is_safe
    with open_existing_store(store_url) as store:
        assert store.test(outcome.test_id).status == "finished"
        assert len(store.readings(outcome.test_id)) == outcome.readings == 2 * 2 * 28


def test_the_chamber_is_made_safe_before_a_store_that_does_not_answer_is_asked(
    short, station, world, store_url
):
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:
        with Outage(world, store_url, begin=40) as outage:
            hook = world.hook

            def give_back(name: str) -> None:
                hook(name)
                if name == "chamber.make_safe":
                    outage.end()

            world.hook = give_back
            outcome = run_test(short, station, store, world.clock)
        # asked before the clean-up it would have been given up, and the readings not be judged
        assert outcome.clean, outcome
        said = [e.text for e in store.events(outcome.test_id) if e.kind == "ramp"]
    assert len(said) == 2 * 2  # both runs of both accelerometers
    assert not any("not checked" in text for text in said)


def test_between_two_questions_to_a_store_that_does_not_answer_the_chamber_is_looked_at(
    short, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    asked: list[tuple[str, int]] = []

    def note(name: str) -> Callable[..., object]:
        real = getattr(RunSeries, name)

        def noted(*given: object) -> object:
            result = real(*given)
            asked.append((name, world.calls.count("chamber.read_temp_c")))
            return result

        return noted

    for name in ("_judge_ramps", "_decide"):
        monkeypatch.setattr(RunSeries, name, note(name))
    with (
        open_spooled_store(store_url, patience_s=PATIENCE_S) as store,
        Outage(world, store_url, begin=12),
    ):
        run_test(short, station, store, world.clock)
    (_, before), (_, after), *_ = asked
    assert [name for name, _ in asked[:2]] == ["_judge_ramps", "_decide"]
    assert after == before + 1


def test_a_limit_ends_the_test_while_the_store_is_away(
    edit_sequence, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    sequence = edit_sequence(("[after_gap]", "[limits]\nchamber_c = [0.0, 40.0]\n[after_gap]"))
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:
        with Outage(world, store_url, begin=12) as outage:
            hook = world.hook

            def run_away(name: str) -> None:
                hook(name)
                if outage.readings_while_away == 5:
                    station.chamber.stuck_c = 60.0

            world.hook = run_away
            outcome = run_test(sequence, station, store, world.clock)
            assert outcome.status == "failed"
            assert "60" in outcome.reason
            assert "not stored" not in outcome.reason
            assert outcome.safe.verified
            assert world.is_safe
            assert "entries wait in" in store.note()
        assert store.settle(60.0) == ""
    with open_existing_store(store_url) as store:
        test = store.test(outcome.test_id)
        assert (test.status, test.outcome) == ("failed", outcome.reason)
        assert [r.status for r in test.runs] == ["failed"]
        assert test.safe_result_json
        assert len(store.readings(outcome.test_id)) == outcome.readings


def test_nothing_is_commanded_when_the_store_does_not_take_the_test(
    short, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:
        with away(store_url):
            outcome = run_test(short, station, store, world.clock)
        assert (outcome.test_id, outcome.status) == ("", "failed")
        assert "no answer in 0.5 s" in outcome.reason
        assert not {"chamber.hold_temp_c", "chamber.ramp_to_c"} & set(world.calls)


def test_an_interrupted_test_resumes_with_what_was_left_in_the_spool(
    short, station, world, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    url = f"sqlite:///{tmp_path / 'night.sqlite'}"
    store = open_spooled_store(url, patience_s=PATIENCE_S)
    with Outage(world, url, begin=12) as outage:
        hook = world.hook

        def end(name: str) -> None:
            hook(name)
            if outage.readings_while_away == 5:
                raise KeyboardInterrupt

        world.hook = end
        first = run_test(short, station, store, world.clock)
        assert first.status == "interrupted"
        # as if the process ended here: its spool is left
        store._worker.idle = lambda: None
        assert store._spool is not None
        store._spool.close()
    world.hook = lambda _: None
    for claim in store._claims._held.values():
        claim.release()
    with open_store(url) as plain:
        assert plain.test(first.test_id).status == "running"
    with open_spooled_store(url) as again:
        assert len(again.readings(first.test_id)) == first.readings
        assert again.test(first.test_id).status == "interrupted"
        second = run_test(None, station, again, world.clock, resume=first.test_id)
        assert second.status == "finished", second
        frame = again.readings(first.test_id)
    valid = frame[frame["voided"] == ""]
    assert len(valid) == 2 * 2 * 28
    assert not valid.duplicated(["run", "slot", "serial"]).any()


class Deleting:
    """An observer under whose hands the store's file goes."""

    def __init__(self, file) -> None:
        self._file = file

    def on_reading(self, run, rows) -> None:
        if rows[0].slot == 9:
            self._file.unlink()

    def on_progress(self, progress) -> None:
        pass

    def on_event(self, event) -> None:
        pass


def test_the_outcome_says_where_the_readings_of_a_deleted_store_are(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    file = tmp_path / "night.sqlite"
    outcome = run_emulated(make_job(parse_sequence(SEQUENCE), file), observers=[Deleting(file)])
    assert outcome.status == "finished", outcome
    copy = tmp_path / f"state/accelbench/spool/night.{outcome.test_id}.sqlite"
    assert f"everything is in {copy}" in outcome.store_note
    with open_existing_store(copy) as store:
        assert len(store.readings(outcome.test_id)) == outcome.readings > 20
        assert store.test(outcome.test_id).status == "finished"
    with pytest.raises(InputError, match=f"no such store; copied when .*{copy.name}"):
        open_existing_store(file)
