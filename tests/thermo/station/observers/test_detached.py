"""Observers in a thread of their own: never waited for, told what they missed."""

import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from thermo.launch.emulated import run_emulated
from thermo.planning.default_station import default_station
from thermo.planning.plan import make_plan
from thermo.planning.sequence import load_sequence
from thermo.station.job import make_job
from thermo.station.observers.detached import MOST, DetachedObserver, ObserverWorker
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import Event, Observers, Progress
from thermo.store.records import ReadingRow
from thermo.store.store import open_store

SHORT = Path(__file__).parents[4] / "examples/sequences/short.toml"
PATIENCE_S = 60.0


def progress(number: int) -> Progress:
    return Progress(
        test_id="t", run=1, runs=1, phase="run", slot=number, slots=9, segment=0,
        time_s=0.0, left_s=0.0, commanded_c=20.0, chamber_c=None,
    )  # fmt: skip


def event(text: str) -> Event:
    return Event(run=1, time_s=0.0, kind="fault", text=text)


class Slow:
    """Stands still in the first thing it is told until it is let go on."""

    def __init__(self) -> None:
        self.reached, self.go_on = threading.Event(), threading.Event()
        self.seen: list[tuple[str, object]] = []

    def wait(self) -> None:
        self.reached.set()
        assert self.go_on.wait(PATIENCE_S)

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        self.wait()
        self.seen.append(("reading", len(rows)))

    def on_progress(self, progress: Progress) -> None:
        self.wait()
        self.seen.append(("progress", progress.slot))

    def on_event(self, event: Event) -> None:
        self.wait()
        self.seen.append((event.kind, event.text))


def test_of_progress_the_newest_is_kept_and_of_events_as_many_as_there_is_room_for():
    slow = Slow()
    detached = DetachedObserver(slow)
    detached.on_event(event("first"))
    assert slow.reached.wait(PATIENCE_S)
    most = MOST["event"]
    assert most is not None
    for k in range(most + 3):
        detached.on_event(event(str(k)))
        detached.on_progress(progress(k))
    slow.go_on.set()
    assert detached.close(PATIENCE_S)
    told = [text for kind, text in slow.seen if kind == "fault"]
    assert told == ["first", *(str(k) for k in range(3, most + 3))]
    assert [n for kind, n in slow.seen if kind == "progress"] == [most + 2]
    assert slow.seen[1] == ("display", "not shown, it took too long: 3 events")


def test_what_nobody_takes_is_given_up():
    slow = Slow()
    detached = DetachedObserver(slow)
    detached.on_progress(progress(1))
    assert slow.reached.wait(PATIENCE_S)
    assert not detached.worker.drain(0.05)
    slow.go_on.set()
    assert detached.close(PATIENCE_S)


def test_a_handler_of_a_signal_may_hand_something_over_while_it_interrupts_just_that():
    worker = ObserverWorker("test", lambda _: None)
    done: list[int] = []
    with worker._changed:  # where the handler finds the main thread
        worker.post(lambda: done.append(1), "line")
    assert worker.close(PATIENCE_S)
    assert done == [1]


class Broken(Slow):
    def on_event(self, event: Event) -> None:
        raise RuntimeError("no paper")


def test_a_display_that_fails_is_lost_once():
    detached = DetachedObserver(Broken())
    observers = Observers([LiveEstimate({}), detached])
    assert observers.newly_lost() == []
    for text in ("one", "two"):
        observers.tell(lambda observer, text=text: observer.on_event(event(text)))
    assert detached.close(PATIENCE_S)
    assert observers.newly_lost() == ["RuntimeError: no paper"]
    assert observers.newly_lost() == []


@pytest.mark.parametrize("observer", [Slow(), Broken()])
def test_an_observer_that_stands_still_or_fails_takes_no_reading_from_a_test(tmp_path, observer):
    sequence = load_sequence(SHORT)
    plan = make_plan(sequence, default_station(sequence))
    detached = DetachedObserver(observer)
    outcome = run_emulated(make_job(sequence, tmp_path / "s.sqlite"), observers=[detached])
    assert outcome.clean
    assert (outcome.readings, outcome.skipped) == (
        plan.runs * plan.slots * len(sequence.accelerometers),
        0,
    )
    with open_store(tmp_path / "s.sqlite") as store:
        told = [e.text for e in store.events(outcome.test_id) if e.kind == "display lost"]
    if isinstance(observer, Broken):
        assert told == ["RuntimeError: no paper; the test continues without it"]
    else:
        assert told == []
        assert observer.seen == []  # it stood still all the while
    observer.go_on.set()
    assert detached.close(PATIENCE_S)
