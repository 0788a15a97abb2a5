"""A store that comes and goes against a plain one that is always there."""

import random
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.thermo.store.outages import locked
from tests.thermo.store.spool.spooling import GENEROUS_S, NEW, START, scan, wait_for
from thermo.store import queries
from thermo.store.records import EventRecord
from thermo.store.spool.spooled_store import open_spooled_store
from thermo.store.store import open_store


class Pair:
    """The same operations on a spooled store that comes and goes, and on a plain one."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.luck = random.Random(seed)
        self.file = folder / "a.sqlite"
        self.plain = open_store(folder / "b.sqlite")
        self.store = open_spooled_store(self.file, patience_s=0.02)
        self.ids = (self.store.begin_test(NEW), self.plain.begin_test(NEW))
        self.outage = ExitStack()
        self.run, self.slot, self.segment, self.attempt = 0, 0, 0, 1
        self.begin_run()

    def both(self, method: str, *arguments: object) -> None:
        one, other = (
            getattr(store, method)(test_id, *arguments)
            for store, test_id in zip((self.store, self.plain), self.ids, strict=True)
        )
        assert one == other

    def begin_run(self) -> None:
        self.run, self.slot, self.segment, self.attempt = self.run + 1, 0, 0, 1
        self.both("begin_run", self.run, START, 5.0)

    def next_run(self) -> None:
        self.both("finish_run", self.run, "finished")
        self.begin_run()

    def append(self) -> None:
        self.both("append", self.run, scan(self.slot, self.attempt, self.segment))
        self.slot += 1

    def log_event(self) -> None:
        self.both("log_event", self.run, float(self.luck.randrange(3)), "note", "again")

    def next_segment(self) -> None:
        self.segment, self.attempt = self.segment + 1, 1

    def mark_attempt(self) -> None:
        only = self.luck.choice([None, self.attempt])
        self.both("mark_attempt", self.run, self.segment, "superseded", only)
        self.attempt += 1
        while self.is_void():
            self.attempt += 1

    def is_void(self) -> bool:
        with self.plain._engine.connect() as connection:
            made = queries.voided_attempts(connection, self.ids[1], self.run, self.segment)
        return self.attempt in made

    def go_away(self) -> None:
        self.come_back()
        # behind a write of the store's own that is on its way
        self.outage.enter_context(locked(self.file))

    def come_back(self) -> None:
        self.outage.close()

    def reopen(self) -> None:
        self.come_back()
        self.store.close()
        self.store = open_spooled_store(self.file, patience_s=0.02)
        self.store.claim(self.ids[0])
        self.store.reopen_test(self.ids[0])
        self.plain.reopen_test(self.ids[1])
        self.both("begin_run", self.run, START)

    def take_away(self) -> None:
        self.come_back()
        assert self.store.settle(GENEROUS_S) == ""
        kept = self.file.with_name("moved.sqlite")
        self.file.rename(kept)
        self.append()
        wait_for(lambda: self.store.path != self.file)
        path = self.store.path
        assert path is not None
        self.file = path
        self.reopen()

    def check(self) -> None:
        self.come_back()
        self.store.settle(GENEROUS_S)
        self.both("finish_test", "failed", "at its end", "{}")
        self.store.settle(GENEROUS_S)
        (a, b), stores = self.ids, (self.store, self.plain)
        assert self.store.readings(a).equals(self.plain.readings(b))
        one, other = (
            [e[:4] for e in map(_words, s.events(i)) if e[2] != "store"]
            for s, i in zip(stores, self.ids, strict=True)
        )
        assert one == other
        assert self.store.test(a).runs == self.plain.test(b).runs
        self.store.close()
        self.plain.close()


def _words(event: EventRecord) -> tuple[object, ...]:
    return event.run, event.time_s, event.kind, event.text


def same_in_the_end(folder: Path, seed: int, steps: int) -> None:
    pair = Pair(folder, seed)
    weights = {
        pair.append: 10, pair.log_event: 6, pair.next_segment: 1, pair.mark_attempt: 2,
        pair.next_run: 1, pair.go_away: 2, pair.come_back: 1, pair.reopen: 0.3,
        pair.take_away: 0.1,
    }  # fmt: skip
    try:
        for step in pair.luck.choices([*weights], [*weights.values()], k=steps):
            step()
        pair.check()
    finally:
        pair.come_back()


@pytest.mark.parametrize("seed", range(3))
def test_a_store_that_comes_and_goes_holds_in_the_end_what_one_holds_that_was_always_there(
    tmp_path, folder, seed
):
    same_in_the_end(tmp_path, seed, steps=80)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", range(10, 50))
def test_many_stores_that_come_and_go(tmp_path, folder, seed):
    same_in_the_end(tmp_path, seed, steps=150)
