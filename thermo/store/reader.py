"""Reading from a store: tests, runs, events, readings."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import sqlalchemy as sa

from thermo.store import queries, reading_queries
from thermo.store.database import display_url, store_errors
from thermo.store.records import EventRecord, ReadingRow, ScheduleMark, TestRecord, TestSummary


class StoreReader:
    """The reading half of a store (`thermo.store.store.Store`).

    Every method raises `StoreError` when the database refuses or cannot be reached.
    """

    def __init__(self, engine: sa.Engine, url: sa.URL) -> None:
        self._turn_to(engine, url)

    def _turn_to(self, engine: sa.Engine, url: sa.URL) -> None:
        """Take this database for the store from now on."""
        self._engine = engine
        self._reader = engine.execution_options(reading=True)
        self._url = url
        self._where = display_url(url)

    @property
    def url(self) -> sa.URL:
        """URL with the password; `thermo.store.database.display_url` is for messages."""
        return self._url

    @property
    def path(self) -> Path | None:
        """The SQLite file; None on a server."""
        if self._engine.dialect.name == "postgresql":
            return None
        return Path(str(self._url.database))

    def test(self, test_id: str) -> TestRecord:
        """Return a test with its runs."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.test(connection, test_id)

    def has_test(self, test_id: str) -> bool:
        """Tell whether there is such a test."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.has_test(connection, test_id)

    def running_tests(self) -> tuple[str, ...]:
        """Return the ids of the tests that are called running, whether anybody runs them or not."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.running_tests(connection)

    def tests(self) -> tuple[TestSummary, ...]:
        """Return all tests, the oldest first."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.tests(connection)

    def events(self, test_id: str) -> tuple[EventRecord, ...]:
        """Return what happened in a test, in the order of logging."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.events(connection, test_id)

    def last_schedule_mark(self, test_id: str, run: int) -> ScheduleMark | None:
        """Return where the schedule of a run stood last; None: it has not begun."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.last_schedule_mark(connection, test_id, run)

    def last_reading(self, test_id: str, run: int) -> ReadingRow | None:
        """Return the reading of a run that is latest in time, voided or not; None: none yet."""
        with store_errors(self._where), self._reader.connect() as connection:
            return reading_queries.last_reading(connection, test_id, run)

    def readings(self, test_id: str, run: int | None = None) -> pd.DataFrame:
        """Return readings as a table, in order of run, time and serial.

        Columns: run and those of `ReadingRow`, NaN where nothing was measured, and `voided`:
        empty, or why the attempt the reading belongs to does not count.
        """
        with store_errors(self._where), self._reader.connect() as connection:
            return reading_queries.readings_frame(connection, test_id, run)

    @contextmanager
    def snapshot(self) -> Generator[sa.Connection]:
        """Give a connection on which every question is answered as of one moment."""
        with store_errors(self._where), self._reader.connect() as connection:
            if connection.dialect.name == "postgresql":
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            yield connection

    def has_readings(self, values: Sequence[Mapping[str, Any]]) -> bool:
        """Tell whether readings, as `reading_values` has them, are all there."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.has_readings(connection, values)

    def attempts(self, test_id: str) -> set[tuple[int, int, int]]:
        """Return the attempts with readings and the voided ones, as (run, segment, attempt)."""
        with store_errors(self._where), self._reader.connect() as connection:
            return queries.all_attempts(connection, test_id)
