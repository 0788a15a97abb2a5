"""kill −9 at random moments: what was acknowledged is there, and no scan is there by half."""

import os
import random
import signal
import time

import pytest

from tests.thermo.store.nursery import begin_test, nursery
from thermo.store.store import open_store

WRITER = """
from thermo.store.store import open_store

def write(url, test_id):
    with open_store(url) as store, store.claim(test_id):
        store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
        last = store.last_reading(test_id, 1)
        slot = 0 if last is None else last.slot + 1
        while True:
            store.append(test_id, 1, rows(slot))
            acknowledge(slot)
            slot += 1
"""


def survive(url: str, kills: int, seed: int) -> None:
    luck = random.Random(seed)
    test_id = begin_test(url)
    acknowledged: list[int] = []
    with nursery(WRITER) as start:
        for _ in range(kills):
            writer = start(url, test_id)
            # one in three while the store is being opened, the others while it is written
            if luck.random() > 1 / 3:
                acknowledged.append(writer.first())
            time.sleep(luck.uniform(0, 0.05))
            os.kill(writer.pid, signal.SIGKILL)
            acknowledged += writer.rest()
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
