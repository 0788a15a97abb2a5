"""kill −9 at random moments: what was acknowledged is there, and no scan is there by half."""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

import pytest

from thermo.store import NewTest, open_store

# Imports once, then forks a writer for each line it reads: a fresh interpreter takes a second.
# No thread and no connection exists in the parent, so its children start clean.
NURSERY = """
import os, sys
import psycopg, sqlalchemy.dialects.postgresql.psycopg, sqlalchemy.dialects.sqlite.pysqlite
from thermo.store import ReadingRow, open_store

def write(url, test_id):
    with open_store(url) as store, store.claim(test_id):
        store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
        last = store.last_reading(test_id, 1)
        slot = 0 if last is None else last.slot + 1
        while True:
            rows = [
                ReadingRow(serial=s, slot=slot, time_s=10.0 * slot, temp_c=20.0, position_deg=0.0,
                           output=slot + 0.1)
                for s in "ABC"
            ]
            store.append(test_id, 1, rows)
            os.write(1, b"ack %d\\n" % slot)
            slot += 1

os.write(1, b"ready\\n")
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        try:
            write(*line.split())
        except BaseException as err:
            os.write(1, f"failed {err}\\n".encode())
        os._exit(1)
    os.write(1, b"born %d\\n" % child)
    os.waitpid(child, 0)
    os.write(1, b"dead\\n")
"""


@contextmanager
def nursery() -> Iterator[tuple[IO[str], IO[str]]]:
    with subprocess.Popen(
        [sys.executable, "-c", NURSERY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process.stdin, process.stdout
        process.stdin.close()


def survive(url: str, kills: int, seed: int) -> None:
    luck = random.Random(seed)
    with open_store(url) as store:
        test_id = store.begin_test(NewTest("kill", "", "{}"))
        store.finish_test(test_id, "interrupted", "handed over")
    acknowledged: list[int] = []
    with nursery() as (orders, news):
        for _ in range(kills):
            orders.write(f"{url} {test_id}\n")
            orders.flush()
            said = iter(news.readline, "")
            child = next(int(line.split()[1]) for line in said if line.startswith("born"))
            # one in three while the store is being opened, the others while it is written
            if luck.random() > 1 / 3:
                line = next(said)
                assert line.startswith("ack"), line
                acknowledged.append(int(line.split()[1]))
            time.sleep(luck.uniform(0, 0.05))
            os.kill(child, signal.SIGKILL)
            for line in said:
                assert not line.startswith("failed"), line
                if line == "dead\n":
                    break
                acknowledged.append(int(line.split()[1]))
    with open_store(url) as store:
        frame = store.readings(test_id)
        sizes = frame.groupby("slot").size()
        assert set(acknowledged) <= set(sizes.index)
        assert len(acknowledged) == len(set(acknowledged))
        assert (sizes == 3).all()
        assert sizes.index.tolist() == list(range(len(sizes)))
        assert (frame["output"] == frame["slot"] + 0.1).all()
        assert len(acknowledged) > kills / 2  # two in three wrote something
        assert not store.is_claimed(test_id)


def test_acknowledged_readings_survive_kills(store_url):
    survive(store_url, kills=15, seed=1)


@pytest.mark.slow
def test_acknowledged_readings_survive_a_hundred_kills(store_url):
    survive(store_url, kills=100, seed=2)
