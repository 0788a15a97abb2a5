"""A stored test as the page shows it: complete, consistent while it grows, bounded in memory."""

import threading

import numpy as np
import pytest

from accelbench.panel import followed
from accelbench.panel.followed import FollowedTest
from tests.accelbench.panel.conftest import SEQUENCE
from tests.accelbench.program import ran
from thermo.store import follow
from thermo.store.store import open_store


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A finished test in a store, and its readings."""
    folder = tmp_path_factory.mktemp("stored")
    (folder / "small.toml").write_text(SEQUENCE, encoding="utf-8")
    _, document, _ = ran(folder, "run", "small.toml", "--store", "s.sqlite", "--json")
    with open_store(folder / "s.sqlite") as store:
        yield store, document["test_id"]


def read_all(test: FollowedTest, store) -> int:
    looks = 1
    while test.update(store):
        looks += 1
    return looks


def test_a_test_read_piece_by_piece_is_the_stored_one(stored, monkeypatch) -> None:
    store, test_id = stored
    monkeypatch.setattr(follow, "PIECE", 7)
    test = FollowedTest(store, test_id)
    assert read_all(test, store) > 10
    readings = store.readings(test_id)
    assert test.readings == len(readings)
    drawn = np.array(test.line("QA-001"), dtype=float)
    assert np.allclose(drawn[:, 1], readings["temp_c"], rtol=1e-5)
    hours = test.plan.approach_s / 3600 + readings["time_s"] / 3600
    assert np.allclose(drawn[:, 0], hours, atol=1e-5)
    assert [e.kind for e in test.events] == [e.kind for e in store.events(test_id)]
    (value,) = test.estimates()
    assert value.n == len(readings)


def test_pages_read_while_the_lines_grow(stored, monkeypatch) -> None:
    store, test_id = stored
    monkeypatch.setattr(follow, "PIECE", 12)
    test, stop, problems = FollowedTest(store, test_id), threading.Event(), []

    def read() -> None:
        while not stop.is_set():
            try:
                test.line("QA-001")
                test.rate()
                stop.wait(0.001)
            except Exception as err:
                problems.append(err)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for one in readers:
        one.start()
    read_all(test, store)
    stop.set()
    for one in readers:
        one.join()
    assert problems == []
    assert len(test.line("QA-001")) == len(store.readings(test_id))


def test_memory_and_pictures_are_bounded_and_keep_the_peaks(monkeypatch) -> None:
    monkeypatch.setattr(followed, "MOST_SCANS", 100)
    lines = followed._Lines(("a",))
    for k in range(10_000):
        lines.add(float(k), {"a": float(k)})
        assert len(lines.hours) <= 101
    assert lines.stride == 128
    assert np.all(np.diff(lines.hours) == 128)
    values = np.sin(np.arange(5000.0))
    values[1234], values[3000] = 7.0, np.nan
    points = np.array(followed._points(np.arange(5000.0), values), dtype=float)
    assert len(points) <= followed.MOST_POINTS + 2
    assert points[:, 1].max() == 7.0
    assert (points[0, 0], points[-1, 0]) == (0.0, 4999.0)
