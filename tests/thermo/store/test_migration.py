"""A store of the tables' version 1: its test was interrupted while a segment was soaked again.

`cases/version-1.sql` is the dump of a store that the program wrote before its tables had a version
2: a test paused in segment 1 (repeated as attempt 2), interrupted, resumed (attempt 3), and
interrupted again before attempt 3 had a reading.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.database import open_engine, parse_store_url
from thermo.store.migration import mark_of_event
from thermo.store.records import ScheduleMark
from thermo.store.schema import SCHEMA_VERSION, metadata
from thermo.store.store import open_store

CASE = Path(__file__).parent / "cases/version-1.sql"
CLOCK = "SteppedClock 8252.140455318150480"  # of the process that wrote it
LAST = ScheduleMark(start_clock_s=140.5, shift_s=325.5, segment=1, attempt=3, clock=CLOCK)


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.executescript(CASE.read_text(encoding="utf-8"))
    return path


def test_a_store_of_version_1_tells_where_its_test_stands(old):
    with open_store(old) as store:
        (test,) = store.tests()
        assert store.last_schedule_mark(test.id, 1) == LAST
        assert store.last_schedule_mark(test.id, 2) is None
        new = ScheduleMark(start_clock_s=1.0, shift_s=2.0, segment=2, attempt=1, clock="c")
        store.mark_schedule(test.id, 1, new)
        assert store.last_schedule_mark(test.id, 1) == new
    with open_store(old) as store:  # the second opening finds nothing to do
        assert store.last_schedule_mark(test.id, 1) == new


def test_an_event_of_a_program_that_ran_on_counts_when_it_is_the_last(old):
    with open_store(old) as store:
        (test,) = store.tests()
        mark = ScheduleMark(start_clock_s=1.0, shift_s=2.0, segment=2, attempt=1, clock="c")
        store.mark_schedule(test.id, 1, mark, "2026-12-01T00:00:00.000000+00:00")
        text = '{"start_clock_s": 9.0, "shift_s": 0.0, "segment": 2, "attempt": 2, "clock": "c"}'
        later = "2026-12-01T00:00:00.000001+00:00"
        store.log_event(test.id, 1, 0.0, "schedule", text, later)
        found = store.last_schedule_mark(test.id, 1)
        assert found is not None
        assert (found.start_clock_s, found.attempt) == (9.0, 2)


def test_a_migrated_store_has_the_tables_of_a_new_one(old, tmp_path):
    with open_store(old):
        pass
    new = tmp_path / "new.sqlite"
    with open_store(new):
        pass
    found = []
    for path in (old, new):
        engine = open_engine(parse_store_url(path), existing=True)
        with engine.connect() as connection:
            asked = sa.text("SELECT type, name FROM sqlite_master ORDER BY type, name")
            names = [tuple(row) for row in connection.execute(asked)]
            version = connection.execute(sa.text("SELECT version FROM schema_version")).scalar()
        engine.dispose()
        found.append((names, version))
    assert found[0] == found[1]
    assert found[0][1] == SCHEMA_VERSION
    assert set(metadata.tables) <= {name for _, name in found[0][0]}


def test_a_mark_is_entered_once_and_never_changed(store_url):
    from tests.thermo.store.short_test import begun

    with open_store(store_url) as store:
        test_id = begun(store)
        stamp = "2026-12-01T00:00:00.000000+00:00"
        for _ in range(2):  # as a spool may do it
            store.mark_schedule(test_id, 1, LAST, stamp)
        assert store.last_schedule_mark(test_id, 1) == LAST
        with store._engine.connect() as connection:
            asked = sa.text("SELECT count(*) FROM schedule_marks")
            assert connection.execute(asked).scalar() == 1
        with (
            pytest.raises(sa.exc.DBAPIError, match="only added, never changed"),
            store._engine.begin() as connection,
        ):
            connection.exec_driver_sql("UPDATE schedule_marks SET segment = 9")
        with pytest.raises(StoreError):
            store.mark_schedule(test_id, 7, LAST)  # a run that has not begun


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"start_clock_s": "x"}', "null"])
def test_an_event_that_holds_no_mark_is_refused(text):
    with pytest.raises(StoreError, match="expected JSON with start_clock_s"):
        mark_of_event(text, "t")
