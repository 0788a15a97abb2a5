"""The store of a running test, with the real one stopped, locked, taken away or full."""

import sqlite3
import stat
import threading
import time
from collections.abc import Callable

import psycopg
import pytest

from drivers.clock import ScaledClock, SteppedClock
from errormodel.errors import StoreError
from tests.thermo.store.outages import away, locked
from tests.thermo.store.spool.spooling import GENEROUS_S, NEW, begun, opened, scan, slots, wait_for
from thermo.store.database import StoreAwayError
from thermo.store.files import open_existing_store
from thermo.store.records import reading_values
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool import spooled_store as store_spool
from thermo.store.spool.log import Operation, SpoolFile, replay
from thermo.store.spool.recover import spools
from thermo.store.spool.spooled_store import SpooledStore, write_patience_s
from thermo.store.store import Store, open_store


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
