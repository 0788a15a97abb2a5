"""Outages and kill −9 at random moments: what was acknowledged is stored, once, and in order."""

import os
import random
import signal
import threading
import time
from pathlib import Path

import pytest

from tests.thermo.store.nursery import begin_test, nursery
from tests.thermo.store.outages import away
from thermo.store.files import open_existing_store
from thermo.store.spool.recover import spools

WRITER = """
import logging, random, time
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool import spooled_store as store_spool
logging.disable()
store_bypass.TELL_S = 0.0

def write(url, test_id, seed):
    luck = random.Random(int(seed))
    with store_spool.open_spooled_store(url, patience_s=0.02) as store:
        store.claim(test_id)
        store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
        last = store.last_reading(test_id, 1)
        told = [int(e.text) for e in store.events(test_id) if e.kind == "told"]
        number = 1 + max(-1 if last is None else last.slot, max(told, default=-1))
        while True:
            if luck.random() < 0.3:
                store.log_event(test_id, 1, None, "told", str(number))
            else:
                store.append(test_id, 1, rows(number))
            acknowledge(number)
            number += 1
            time.sleep(0.005)  # or a spool takes many more than the store can take in after it
"""


class Outages:
    """Takes the store away and gives it back at random until the block ends."""

    def __init__(self, url: str, seed: int) -> None:
        self._url, self._luck = url, random.Random(seed)
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._work)

    def __enter__(self) -> "Outages":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._done.wait(self._luck.uniform(0.0, 0.3)):
            with away(self._url):
                self._done.wait(self._luck.uniform(0.05, 0.4))


def survive(url: str, state: Path, kills: int, seed: int) -> int:
    """Return how many kills left something in a spool."""
    luck = random.Random(seed)
    test_id = begin_test(url)
    acknowledged: list[int] = []
    spooled = 0
    with nursery(WRITER, {"XDG_STATE_HOME": str(state)}) as start:
        for kill in range(kills):
            writer = start(url, test_id, seed + kill)
            acknowledged.append(writer.first())
            with Outages(url, seed + kill):
                time.sleep(luck.uniform(0, 1.0))
                os.kill(writer.pid, signal.SIGKILL)
                acknowledged += writer.rest()
            spooled += bool(spools(state / "accelbench/spool"))
    with open_existing_store(url) as store:
        frame = store.readings(test_id)
        told = [int(e.text) for e in store.events(test_id) if e.kind == "told"]
        events = [(e.kind, e.text, e.logged_utc) for e in store.events(test_id)]
        assert store.test(test_id).status == "interrupted"
    assert spools(state / "accelbench/spool") == ()
    sizes = frame.groupby("slot").size()
    assert (sizes == 3).all()
    assert (frame["output"] == frame["slot"] + 0.1).all()
    stored = [*sizes.index, *told]
    assert len(stored) == len(set(stored))  # nothing doubled
    assert len(events) == len(set(events))
    assert sorted(stored) == list(range(len(stored)))  # nothing lost
    assert told == sorted(told)
    # beyond what was acknowledged at most what each kill found half-way
    assert set(acknowledged) <= set(stored)
    assert len(stored) - len(acknowledged) <= kills
    return spooled


def test_acknowledged_operations_survive_outages_and_kills(store_url, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert survive(store_url, tmp_path / "state", kills=4, seed=1) > 0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_acknowledged_operations_survive_outages_and_a_hundred_kills(
    store_url, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert survive(store_url, tmp_path / "state", kills=100, seed=7) > 20
