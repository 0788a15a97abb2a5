"""SQLite's file: damaged, torn, read by another process."""

import os
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import StoreError
from tests.thermo.store.short_test import begun, scan
from thermo.store.store import open_store


def closed_file(folder: Path, scans: int = 200) -> tuple[Path, str]:
    path = folder / "b.sqlite"
    with open_store(path) as store:
        test_id = begun(store)
        for slot in range(0, scans, 20):
            rows = [row for k in range(slot, slot + 20) for row in scan(k)]
            store.append(test_id, 1, rows)
    return path, test_id


@pytest.mark.parametrize("kind", ["text", "truncated", "zeros", "page", "others"])
def test_a_damaged_file_is_refused_and_left_alone(tmp_path, kind):
    path, _ = closed_file(tmp_path)
    data = bytearray(path.read_bytes())
    if kind == "text":
        data = bytearray(b"run,serial\n" * 100)
    elif kind == "truncated":
        del data[len(data) // 2 :]
    elif kind == "zeros":
        data[4096:] = bytes(len(data) - 4096)
    elif kind == "page":
        data[len(data) // 2 : len(data) // 2 + 4096] = os.urandom(4096)
    if kind == "others":
        path.unlink()
        with sqlite3.connect(path) as db:
            db.execute("CREATE TABLE mine (a)")
        db.close()
        data = bytearray(path.read_bytes())
    else:
        path.write_bytes(bytes(data))
    with pytest.raises(StoreError, match=r"b\.sqlite: (not a store|damaged)") as caught:
        open_store(path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == bytes(data)


@pytest.mark.parametrize("damage", ["cut", "flip", "garbage"])
def test_a_torn_last_write_costs_only_what_was_not_acknowledged(tmp_path, damage):
    whole = tmp_path / "whole"
    whole.mkdir()
    store = open_store(whole / "b.sqlite")
    test_id = begun(store, 20)
    log = whole / "b.sqlite-wal"
    acknowledged = log.stat().st_size
    store.append(test_id, 1, scan(20))
    last = log.stat().st_size
    assert last > acknowledged
    rng = np.random.default_rng(3)
    for trial in range(10):
        copy = tmp_path / f"{damage}{trial}"
        shutil.copytree(whole, copy, ignore=shutil.ignore_patterns("*.claim", "*-shm"))
        wal = copy / "b.sqlite-wal"
        data = bytearray(wal.read_bytes())
        place = int(rng.integers(acknowledged, last))
        if damage == "cut":
            del data[place:]
        elif damage == "flip":
            data[place] ^= 1 << int(rng.integers(8))
        else:
            data[acknowledged:] = rng.bytes(last - acknowledged)
        wal.write_bytes(bytes(data))
        with open_store(copy / "b.sqlite") as torn:
            frame = torn.readings(test_id)
            assert len(frame) == 60
            np.testing.assert_array_equal(
                frame["output"], [row.output for slot in range(20) for row in scan(slot)]
            )
            torn.append(test_id, 1, scan(20))
    store.close()


def test_a_reader_in_another_process_disturbs_no_writer(tmp_path):
    path = tmp_path / "b.sqlite"
    code = (
        "import sqlite3, sys; db = sqlite3.connect(sys.argv[1], isolation_level=None);"
        "db.execute('BEGIN'); print(db.execute('SELECT count(*) FROM readings').fetchone()[0],"
        " flush=True); sys.stdin.read()"
    )
    with open_store(path) as store:
        test_id = begun(store, 2)
        reader = subprocess.Popen(
            [sys.executable, "-c", code, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert reader.stdout is not None
        assert reader.stdin is not None
        assert reader.stdout.readline() == b"6\n"
        for slot in range(2, 30):  # would wait for the busy time-out and fail if it were blocked
            store.append(test_id, 1, scan(slot))
        reader.kill()
        reader.wait()
        reader.stdin.close()
        reader.stdout.close()
        store.append(test_id, 1, scan(30))
        assert len(store.readings(test_id)) == 93


def test_durability_settings(tmp_path):
    with open_store(tmp_path / "b.sqlite") as store, store._engine.connect() as connection:
        found = [
            connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys")
        ]
    assert found == ["wal", 2, 1]
