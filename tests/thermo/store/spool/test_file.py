"""The store's file taken away, moved, full, and alone without its write-ahead log."""

import sqlite3
import stat
import time
from dataclasses import replace
from pathlib import Path

import pytest

from errormodel.errors import StoreError
from tests.thermo.store.outages import locked
from tests.thermo.store.spool.spooling import (
    GENEROUS_S,
    START,
    begun,
    left,
    opened,
    scan,
    slots,
    wait_for,
)
from thermo.store.database import StoreAwayError
from thermo.store.files import open_existing_store
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool.log import Operation, SpoolFile
from thermo.store.spool.recover import recover, spools
from thermo.store.spool.spooled_store import SpooledStore
from thermo.store.store import open_store

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
    assert "refuses 1 entries" in caplog.text
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
