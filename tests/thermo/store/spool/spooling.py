"""A test's readings put into a spooled store, and the slots that came through."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from thermo.store.records import NewTest, ReadingRow, reading_values
from thermo.store.spool.log import Operation, SpoolFile, spool_path
from thermo.store.spool.spooled_store import SpooledStore, open_spooled_store
from thermo.store.store import Store

NEW = NewTest("night", 'name = "night"\n', "{}")
START = "2026-11-22T22:15:00+00:00"
PATIENCE_S = 0.3
GENEROUS_S = 60.0  # for a condition that comes at once on an idle machine


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


def left(store: Store, folder: Path, test_id: str, numbers: list[int]) -> None:
    """Leave a spool as a killed process does."""
    spool = SpoolFile(spool_path(folder, store.url, test_id), str(store.path))
    for slot in numbers:
        values = [reading_values(test_id, 1, row) for row in scan(slot)]
        arguments = {"test_id": test_id, "run": 1, "values": values}
        spool.add(Operation(call="append", arguments=arguments))
    spool.close()
