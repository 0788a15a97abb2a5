"""Outages and kill −9 at random moments: what was acknowledged is stored, once, and in order."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from tests.thermo.outages import away
from thermo.store import NewTest, open_store
from thermo.store_files import open_existing_store
from thermo.store_recover import spools

# Imports once, then forks a writer for each line it reads. No thread and no connection exists in
# the parent, so its children start clean.
NURSERY = """
import logging, os, random, sys, time
import psycopg, sqlalchemy.dialects.postgresql.psycopg, sqlalchemy.dialects.sqlite.pysqlite
from thermo import store_bypass, store_spool
from thermo.store import ReadingRow
logging.disable()
store_bypass.TELL_S = 0.0

def write(url, test_id, seed):
    luck = random.Random(seed)
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
                rows = [
                    ReadingRow(serial=s, slot=number, time_s=10.0 * number, temp_c=20.0,
                               position_deg=0.0, output=number + 0.1)
                    for s in "ABC"
                ]
                store.append(test_id, 1, rows)
            os.write(1, b"ack %d\\n" % number)
            number += 1
            time.sleep(0.005)  # or a spool takes many more than the store can take in after it

os.write(1, b"ready\\n")
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        try:
            url, test_id, seed = line.split()
            write(url, test_id, int(seed))
        except BaseException as err:
            os.write(1, f"failed {err}\\n".encode())
        os._exit(1)
    os.write(1, b"born %d\\n" % child)
    os.waitpid(child, 0)
    os.write(1, b"dead\\n")
"""


@contextmanager
def nursery(state: Path) -> Iterator[tuple[IO[str], IO[str]]]:
    with subprocess.Popen(
        [sys.executable, "-c", NURSERY],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"XDG_STATE_HOME": str(state)},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process.stdin, process.stdout
        process.stdin.close()


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
    with open_store(url) as store:
        test_id = store.begin_test(NewTest("kill", "", "{}"))
        store.finish_test(test_id, "interrupted", "handed over")
    acknowledged: list[int] = []
    spooled = 0
    with nursery(state) as (orders, news):
        for kill in range(kills):
            orders.write(f"{url} {test_id} {seed + kill}\n")
            orders.flush()
            said = iter(news.readline, "")
            child = next(int(line.split()[1]) for line in said if line.startswith("born"))
            line = next(said)
            assert line.startswith("ack"), line
            acknowledged.append(int(line.split()[1]))
            with Outages(url, seed + kill):
                time.sleep(luck.uniform(0, 1.0))
                os.kill(child, signal.SIGKILL)
                for line in said:
                    assert not line.startswith("failed"), line
                    if line == "dead\n":
                        break
                    acknowledged.append(int(line.split()[1]))
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
