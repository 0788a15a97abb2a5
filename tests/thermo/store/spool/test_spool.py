"""The store of a running test, with the real one stopped, locked, taken away or full."""

import random
import sqlite3
import stat
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import psycopg
import pytest

from drivers.clock import ScaledClock, SteppedClock
from errormodel.errors import StoreError
from tests.thermo.store.outages import away, locked
from thermo.store import queries
from thermo.store.database import StoreAwayError
from thermo.store.files import open_existing_store
from thermo.store.records import EventRecord, NewTest, ReadingRow, reading_values
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool import spooled_store as store_spool
from thermo.store.spool.log import Operation, SpoolFile, replay, spool_path
from thermo.store.spool.recover import recover, spools
from thermo.store.spool.spooled_store import SpooledStore, open_spooled_store, write_patience_s
from thermo.store.store import Store, open_store

NEW = NewTest("night", 'name = "night"\n', "{}")
START = "2026-11-22T22:15:00+00:00"
PATIENCE_S = 0.3
GENEROUS_S = 60.0  # for a condition that comes at once on an idle machine


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state/accelbench/spool"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "night.sqlite"


def scan(slot: int, attempt: int = 1, segment: int = 0) -> list[ReadingRow]:
    return [
        ReadingRow(serial=s, slot=slot, attempt=attempt, segment=segment, time_s=10.0 * slot,
                   temp_c=20 + slot / 7, position_deg=None, output=1 / 3 + slot)
        for s in "ABC"
    ]  # fmt: skip


def opened(url: object) -> SpooledStore:
    return open_spooled_store(str(url), patience_s=PATIENCE_S)


def begun(store: Store) -> str:
    test_id = store.begin_test(NEW)
    store.begin_run(test_id, 1, START, 5.0)
    return test_id


def slots(store: Store, test_id: str) -> list[int]:
    frame = store.readings(test_id)
    assert (frame.groupby(["slot", "attempt"]).size() == 3).all()
    np.testing.assert_array_equal(frame["output"], 1 / 3 + frame["slot"])
    return sorted(frame.drop_duplicates(["slot", "attempt"])["slot"])


def wait_for(condition: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + GENEROUS_S
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


def test_what_goes_in_comes_out_without_any_spool(store_url, folder):
    with opened(store_url) as store:
        test_id = begun(store)
        for slot in range(5):
            store.append(test_id, 1, scan(slot))
        store.append(test_id, 1, [])
        assert store.mark_attempt(test_id, 1, 0) == 2
        store.append(test_id, 1, scan(5, attempt=2))
        with pytest.raises(StoreError, match="slot 5 attempt 2 is there already"):
            store.append(test_id, 1, scan(5, attempt=2))
        with pytest.raises(StoreError, match="run 7: has not begun"):
            store.append(test_id, 7, scan(5))
        assert slots(store, test_id) == [0, 1, 2, 3, 4, 5]
        store.finish_run(test_id, 1, "finished")
        store.finish_test(test_id, "finished", "done")
        assert store.settle() == ""
    assert list(folder.iterdir()) == []


def test_a_store_that_does_not_answer_keeps_nobody_waiting_and_gets_everything(store_url, folder):
    with opened(store_url) as store:
        test_id = begun(store)
        store.append(test_id, 1, scan(0))
        with away(store_url):
            for slot in range(1, 20):  # would wait for the server without the spool
                store.append(test_id, 1, scan(slot))
            assert store.mark_attempt(test_id, 1, 0) == 2
            store.append(test_id, 1, scan(20, attempt=2))
            store.log_event(test_id, 1, 5.0, "note", "the same")
            store.log_event(test_id, 1, 5.0, "note", "the same")
            assert "entries wait in" in store.note()
            (spool,) = spools(folder)
            assert stat.S_IMODE(spool.stat().st_mode) == 0o600
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert store.settle(GENEROUS_S) == ""
        store.append(test_id, 1, scan(21, attempt=2))
        assert slots(store, test_id) == list(range(22))
        events = [(e.kind, e.text) for e in store.events(test_id)]
        assert events.count(("note", "the same")) == 2
        assert [text for kind, text in events if kind == "store" and "readings go into" in text]
        frame = store.readings(test_id)
        assert (frame["voided"] != "").tolist() == [True] * 60 + [False] * 6
        store.finish_run(test_id, 1, "finished")
        store.finish_test(test_id, "finished", "done")
    assert spools(folder) == ()
    with open_existing_store(store_url) as store:
        assert store.test(test_id).status == "finished"


def test_a_test_that_ends_while_the_store_is_away_flows_in_when_it_is_opened_next(
    file, folder, monkeypatch, caplog
):
    monkeypatch.setattr(store_spool, "END_PATIENCE_S", 0.1)
    store = opened(file)
    test_id = begun(store)
    with locked(file):
        for slot in range(3):
            store.append(test_id, 1, scan(slot))
        store.finish_run(test_id, 1, "finished")
        store.finish_test(test_id, "finished", "all runs done")
        note = store.settle(0.1)
        (spool,) = spools(folder)
        assert str(spool) in note
        assert f"accelbench runs --store {file}" in note
        store.close()
        # this process still has the spool open and the worker goes on with it
        with pytest.raises(StoreError, match="locked"):
            SpoolFile(spool)
    wait_for(lambda: not spools(folder))
    with open_existing_store(file) as again:
        assert again.test(test_id).status == "finished"
        assert slots(again, test_id) == [0, 1, 2]


def test_a_test_does_not_begin_in_a_store_that_does_not_answer(store_url, folder, monkeypatch):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    with opened(store_url) as store:
        with away(store_url), pytest.raises(StoreAwayError, match=r"no answer in 0\.5 s"):
            store.begin_test(NEW)
        wait_for(lambda: _begins(store))


def _begins(store: Store) -> bool:
    try:
        begun(store)
    except StoreAwayError:
        return False
    return True


def test_reading_back_is_refused_in_time_while_the_store_is_away(file, folder, monkeypatch):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    with opened(file) as store:
        test_id = begun(store)
        with locked(file):
            store.append(test_id, 1, scan(0))
            with pytest.raises(StoreAwayError, match="wait in a spool"):
                store.readings(test_id)
        assert store.settle(GENEROUS_S) == ""
        assert slots(store, test_id) == [0]


def test_what_comes_into_the_spool_as_it_runs_dry_is_not_lost(file, folder, monkeypatch):
    late = [scan(8), scan(9)]

    def replayed(store: SpooledStore, spool: SpoolFile, after: Callable[[], None]) -> None:
        replay(store, spool, after)
        if late:  # between the last look into the spool and its end
            values = [reading_values(test_id, 1, row) for row in late.pop()]
            arguments = {"test_id": test_id, "run": 1, "values": values}
            assert store._keep(Operation(call="append", arguments=arguments))

    monkeypatch.setattr(store_bypass, "replay", replayed)
    with opened(file) as store:
        test_id = begun(store)
        with locked(file):
            store.append(test_id, 1, scan(0))
        assert store.settle(GENEROUS_S) == ""
        assert slots(store, test_id) == [0, 8, 9]


def test_a_spool_that_was_taken_away_while_it_was_waited_for_is_made_anew(tmp_path):
    path = tmp_path / "x.T.spool"
    first = SpoolFile(path, "somewhere")
    waiting: list[SpoolFile] = []
    thread = threading.Thread(target=lambda: waiting.append(SpoolFile(path, patience_s=GENEROUS_S)))
    thread.start()
    time.sleep(0.2)  # it waits for the lock; were it slower, there would be nothing to see
    first.close(delete=True)
    thread.join()
    waiting[0].add(Operation(call="finish_test", arguments={"test_id": "T"}))
    assert path.exists()
    waiting[0].close()
    with sqlite3.connect(path) as db:
        assert db.execute("SELECT count(*) FROM log").fetchone() == (1,)
    db.close()


def test_two_stores_in_one_process_do_not_share_a_spool(tmp_path, folder):
    files = [tmp_path / "a.sqlite", tmp_path / "b.sqlite"]
    with opened(files[0]) as a, opened(files[1]) as b:
        ids = [begun(a), begun(b)]
        with locked(files[0]):
            for slot in range(5):
                a.append(ids[0], 1, scan(slot))
                b.append(ids[1], 1, scan(slot))
            assert a.note()
            assert not b.note()
            assert slots(b, ids[1]) == [0, 1, 2, 3, 4]
        assert a.settle(GENEROUS_S) == ""
        assert slots(a, ids[0]) == [0, 1, 2, 3, 4]


# ---- the file ----


@pytest.mark.parametrize("how", ["deleted", "moved", "replaced", "folder", "log"])
def test_a_file_taken_away_is_noticed_at_the_next_reading_and_nothing_is_lost(
    tmp_path, folder, how
):
    home = tmp_path / "home"
    home.mkdir()
    file = home / "night.sqlite"
    with opened(file) as store:
        test_id = begun(store)
        for slot in range(10):
            store.append(test_id, 1, scan(slot))
        if how == "deleted":
            file.unlink()
        elif how == "moved":
            file.rename(tmp_path / "moved.sqlite")
        elif how == "replaced":
            with open_store(tmp_path / "other.sqlite") as other:
                other_id = begun(other)
            (tmp_path / "other.sqlite").replace(file)
        elif how == "folder":
            home.rename(tmp_path / "elsewhere")
        else:
            file.with_name("night.sqlite-wal").unlink()
        store.append(test_id, 1, scan(10))
        wait_for(lambda: "was deleted, moved or replaced" in store.note())
        copy = folder / f"night.{test_id}.sqlite"
        assert str(copy) in store.note()
        store.append(test_id, 1, scan(11))
        assert slots(store, test_id) == list(range(12))
        store.finish_test(test_id, "interrupted", "stopped")
        assert str(copy) in store.settle()
    assert stat.S_IMODE(copy.stat().st_mode) == 0o600
    with open_existing_store(copy) as again:
        assert slots(again, test_id) == list(range(12))
        assert [e for e in again.events(test_id) if str(copy) in e.text]
    if how == "moved":  # whole up to there
        with open_existing_store(tmp_path / "moved.sqlite") as again:
            assert slots(again, test_id) == list(range(11))
    if how == "replaced":
        with open_existing_store(file) as again:
            assert [t.id for t in again.tests()] == [other_id]


def test_a_spool_is_not_taken_into_a_copy_of_its_store_but_into_the_moved_file(
    file, folder, tmp_path, caplog
):
    with opened(file) as store:
        test_id = begun(store)
        store.finish_test(test_id, "interrupted", "stopped")
    copy = tmp_path / "copy.sqlite"
    copy.write_bytes(file.read_bytes())
    with open_store(file) as store:
        left(store, folder, test_id, [0, 1])
    with open_existing_store(copy) as store:
        assert store.readings(test_id).empty
    assert f"wait for the store {file}; not stored in this one" in caplog.text
    file.rename(tmp_path / "moved.sqlite")
    with open_existing_store(tmp_path / "moved.sqlite") as store:
        assert slots(store, test_id) == [0, 1]
    assert spools(folder) == ()


def left(store: Store, folder: Path, test_id: str, numbers: list[int]) -> None:
    """Leave a spool as a killed process does."""
    spool = SpoolFile(spool_path(folder, store.url, test_id), str(store.path))
    for slot in numbers:
        values = [reading_values(test_id, 1, row) for row in scan(slot)]
        arguments = {"test_id": test_id, "run": 1, "values": values}
        spool.add(Operation(call="append", arguments=arguments))
    spool.close()


def test_what_the_store_refuses_stays_in_the_spool_and_is_told(file, folder, caplog):
    with opened(file) as store:
        test_id = begun(store)
        store.append(test_id, 1, [replace(row, output=9.0) for row in scan(0)])
        store.finish_test(test_id, "interrupted", "stopped")
    with open_store(file) as store:
        left(store, folder, test_id, [0, 1])
        recover(store, folder)
        frame = store.readings(test_id)
        assert frame["output"].tolist() == [9.0] * 3 + [1 / 3 + 1] * 3
    assert "does not take 1 entries" in caplog.text
    (spool,) = spools(folder)
    kept = SpoolFile(spool)
    assert kept.count() == (0, 1)
    kept.close()


# ---- full disks ----


def test_a_full_store_goes_into_the_spool(file, folder):
    with opened(file) as store:
        test_id = begun(store)
        limit(store, 1)  # raised by SQLite to the present size
        for slot in range(200):
            store.append(test_id, 1, scan(slot))
        assert "entries wait" in store.note()
        limit(store, 1_000_000)
        assert store.settle(GENEROUS_S) == ""
        assert slots(store, test_id) == list(range(200))


def limit(store: SpooledStore, pages: int) -> None:
    def work() -> None:
        with store._engine.connect() as connection:
            connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}").close()

    store._worker.submit(work).result(GENEROUS_S)


def test_with_the_spool_full_too_the_write_is_refused_and_the_status_is_mended(
    file, folder, monkeypatch, caplog
):
    def full(self: SpoolFile, operation: Operation) -> None:
        raise StoreAwayError(f"{self.path}: database or disk is full")

    store = opened(file)
    test_id = begun(store)
    store.append(test_id, 1, scan(0))
    with locked(file):
        monkeypatch.setattr(SpoolFile, "add", full)
        with pytest.raises(StoreError, match="disk is full"):
            store.append(test_id, 1, scan(1))
        with pytest.raises(StoreError, match="disk is full"):
            store.finish_test(test_id, "failed", "the disk is full")
    monkeypatch.undo()
    store.close()
    recovered = open_store(file)
    recover(recovered, folder)
    test = recovered.test(test_id)
    assert (test.status, test.runs[0].status) in {
        ("interrupted", "interrupted"),
        ("failed", "failed"),  # the write that was given up arrived all the same
    }
    recovered.close()


# ---- the write-ahead log ----


def test_the_file_alone_holds_everything_after_every_run_and_at_the_end(file, folder, tmp_path):
    with opened(file) as store:
        test_id = begun(store)
        for number in (1, 2):
            store.begin_run(test_id, number, START)
            store.append(test_id, number, scan(number))
            store.finish_run(test_id, number, "finished")
            alone = tmp_path / f"alone{number}.sqlite"

            def whole(alone: Path = alone, number: int = number) -> bool:
                alone.write_bytes(file.read_bytes())
                with open_store(alone) as copy:
                    return len(copy.test(test_id).runs) == number if copy.tests() else False

            wait_for(whole)
        # a reader that has the file open at the end, in no transaction
        reader = sqlite3.connect(f"file:{file}?mode=ro", uri=True)
        reader.execute("SELECT count(*) FROM readings").fetchall()
        store.finish_test(test_id, "finished", "done")
    alone = tmp_path / "end.sqlite"
    alone.write_bytes(file.read_bytes())
    reader.close()
    with open_existing_store(alone) as copy:
        assert copy.test(test_id).status == "finished"
        assert slots(copy, test_id) == [1, 2]


def test_a_reader_in_mid_transaction_at_the_end_is_told_of(file, folder):
    with opened(file) as store:
        test_id = begun(store)
        reader = sqlite3.connect(file, isolation_level=None)
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM readings").fetchall()
        store.append(test_id, 1, scan(0))
        assert "night.sqlite-wal holds the last readings" in store.settle()
        reader.close()
        assert store.settle() == ""


def test_the_file_alone_is_brought_up_to_date_now_and_then(file, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(store_bypass, "CHECKPOINT_S", 0.1)
    with opened(file) as store:
        test_id = begun(store)
        alone = tmp_path / "alone.sqlite"

        def whole() -> bool:
            slot = len(slots(store, test_id))
            store.append(test_id, 1, scan(slot))
            time.sleep(0.2)
            alone.write_bytes(file.read_bytes())
            with open_store(alone) as copy:
                return copy.has_test(test_id) and len(copy.readings(test_id)) == 3 * (slot + 1)

        wait_for(whole)
        store.finish_test(test_id, "interrupted", "stop")


# ---- the server ----


def test_broken_sessions_cost_neither_a_reading_nor_the_claim(postgres_server, folder):
    schema = "broken"
    with psycopg.connect(postgres_server, autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {schema}".encode())
        url = f"{postgres_server}?options=-csearch_path%3D{schema}"
        with opened(url) as store, open_store(url) as other:
            test_id = begun(store)
            store.append(test_id, 1, scan(0))
            connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> pg_backend_pid() AND application_name LIKE 'accelbench%'"
            )
            store.append(test_id, 1, scan(1))
            assert store.settle(GENEROUS_S) == ""
            assert slots(store, test_id) == [0, 1]
            store._due_s = 0.0  # at the next look, five minutes later at the most
            wait_for(lambda: other.is_claimed(test_id))
            store.finish_test(test_id, "interrupted", "stop")


# ---- small things ----


def test_patience_is_a_sampling_period_in_real_seconds_within_bounds():
    assert write_patience_s(10.0, SteppedClock()) == 2.0
    assert write_patience_s(1.0, ScaledClock(1.0)) == 1.0
    assert write_patience_s(10.0, ScaledClock(60.0)) == 0.5


def test_a_folder_that_cannot_be_written_is_told_before_anything(file, folder, monkeypatch):
    folder.parent.mkdir(parents=True)
    folder.write_text("in the way", encoding="utf-8")
    with pytest.raises(StoreError, match=r"cannot be written .*XDG_STATE_HOME"):
        opened(file)
    assert not file.exists()


def test_events_of_another_thread_go_in_beside_the_readings(file, folder):
    with opened(file) as store:
        test_id = begun(store)

        def tell() -> None:
            for _ in range(30):
                store.log_event(test_id, None, None, "display", "lost")

        thread = threading.Thread(target=tell)
        thread.start()
        with locked(file):
            for slot in range(30):
                store.append(test_id, 1, scan(slot))
            thread.join()
        assert store.settle(GENEROUS_S) == ""
        assert slots(store, test_id) == list(range(30))
        assert [e.kind for e in store.events(test_id)].count("display") == 30


# ---- against a store that is always there ----


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
