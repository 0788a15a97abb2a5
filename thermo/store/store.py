"""The store: tests, runs and readings that survive the process that wrote them.

A reading is acknowledged when `Store.append` returns: it is then on the disk, in a table to which
rows are only added. SQLite and PostgreSQL behave alike; see docs/decisions/0003-store.md. A running
test writes through `thermo.store.spool.spooled_store`, which never waits for a store that does not
answer.
"""

import logging
import secrets
import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pandas as pd
import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from errormodel.errors import StoreError
from thermo.store import queries, schema
from thermo.store.claims import PATIENCE_S, Claim, FileClaim, HeldClaim, ServerClaim
from thermo.store.database import (
    one_line,
    open_engine,
    parse_url,
    shown,
    told_as_store_error,
    utc_now,
)
from thermo.store.export import export_test
from thermo.store.records import (
    EventRecord,
    NewTest,
    ReadingRow,
    RunRecord,
    TestRecord,
    TestSummary,
    check_status,
    json_text,
    number_or_null,
    plain_text,
    reading_values,
)
from thermo.store.sqlite import checkpoint

log = logging.getLogger(__name__)

__all__ = [
    "EventRecord",
    "HeldClaim",
    "NewTest",
    "ReadingRow",
    "RunRecord",
    "Store",
    "TestRecord",
    "TestSummary",
    "export_test",
    "open_store",
]


def open_store(url: str | Path, *, existing: bool = False) -> "Store":
    """Open a store, and make it when there is none.

    Parameters
    ----------
    url : str
        A file name, ``sqlite:///FILE`` or ``postgresql://USER@HOST/DATABASE``.
    existing : bool
        Whether it is to hold a store already; an empty file is refused then.

    Raises
    ------
    StoreError
        If it cannot be reached, is damaged, is no store, or was made by a newer program; then
        nothing was changed.
    """
    parsed = parse_url(url)
    return Store(open_engine(parsed, existing=existing), parsed)


class Store:
    """An open store; a context manager, and safe to use from several threads.

    Every method raises `StoreError` when the database refuses or cannot be reached.
    """

    def __init__(self, engine: sa.Engine, url: sa.URL) -> None:
        self._turn_to(engine, url)
        self._lock = threading.RLock()
        self._claims: dict[str, Claim] = {}
        self._checked: set[tuple[str, int, int, int]] = set()

    def _turn_to(self, engine: sa.Engine, url: sa.URL) -> None:
        """Take this database for the store from now on."""
        self._engine = engine
        self._reader = engine.execution_options(reading=True)
        self._url = url
        self._where = shown(url)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of all claims and of the database; harmless when done twice."""
        with self._lock:
            for test_id in list(self._claims):
                self._release(test_id)
        self._engine.dispose()

    @property
    def url(self) -> sa.URL:
        """Where it is, with the password; `thermo.store.database.shown` is for messages."""
        return self._url

    @property
    def path(self) -> Path | None:
        """The SQLite file; None on a server."""
        if self._engine.dialect.name == "postgresql":
            return None
        return Path(str(self._url.database))

    def checkpoint(self, tries: int = 1) -> bool:
        """Take an SQLite store's -wal into its file; True when the file alone holds everything.

        Each try waits for readers for a fifth of a second at the most.
        """
        if self.path is None:
            return True
        with told_as_store_error(self._where):
            return checkpoint(self._engine, tries)

    def note(self) -> str:
        """Return where readings are that are not in this store, a line; empty: nowhere else."""
        return ""

    # ---- writing ----

    def begin_test(self, new: NewTest) -> str:
        """Enter a new test and claim it for this process.

        Returns
        -------
        str
            Its id, the time it began and four random digits: ``20261122T221500-3f9a``.
        """
        now = datetime.now(UTC)
        test_id = f"{now:%Y%m%dT%H%M%S}-{secrets.token_hex(2)}"
        self.claim(test_id)
        values = {
            "id": test_id,
            "created_utc": now.isoformat(timespec="microseconds"),
            "name": plain_text(new.name),
            "sequence_toml": plain_text(new.sequence_toml),
            "station_json": plain_text(new.station_json),
            "versions_json": json_text(new.versions),
            "settings_json": json_text(new.settings),
            "status": "running",
            "outcome": "",
            "safe_result_json": "",
        }
        try:
            with told_as_store_error(self._where), self._engine.begin() as connection:
                connection.execute(sa.insert(schema.tests), [values])
        except BaseException:
            self._release(test_id)
            raise
        return test_id

    def begin_run(
        self,
        test_id: str,
        number: int,
        start_utc: datetime | str,
        start_clock_s: float | None = None,
    ) -> None:
        """Enter a run. A run that was entered before keeps its start; it is then running again.

        Parameters
        ----------
        test_id : str
        number : int
            Counted from 1.
        start_utc : datetime or str
            When it began, ISO if text.
        start_clock_s : float, optional
            The same moment on the station's clock, s.
        """
        start = start_utc if isinstance(start_utc, str) else start_utc.isoformat()
        with told_as_store_error(f"test {test_id}"), self._engine.begin() as connection:
            status = queries.run_status(connection, test_id, number)
            if status == "finished":
                raise StoreError(f"test {test_id} run {number}: is finished")
            if status is not None:
                queries.set_run_status(connection, test_id, number, "running")
                return
            queries.need_test(connection, test_id)
            values = {
                "test_id": test_id,
                "number": int(number),
                "start_utc": start,
                "start_clock_s": start_clock_s,
                "status": "running",
            }
            connection.execute(sa.insert(schema.runs), [values])

    def append(self, test_id: str, run: int, rows: Sequence[ReadingRow]) -> None:
        """Add the readings of one scan; when this returns they are on the disk.

        They go in together or not at all.

        Raises
        ------
        StoreError
            If one of them is already there, the run is not open, its attempt was voided, or a
            value is infinite. Nothing was changed then.
        """
        if not rows:
            return
        values = [reading_values(test_id, run, row) for row in rows]
        attempts = {(test_id, int(run), v["segment"], v["attempt"]) for v in values}
        with told_as_store_error(f"test {test_id} run {run}"):
            try:
                with self._engine.begin() as connection:
                    for key in attempts - self._checked:
                        queries.need_open_attempt(connection, *key)
                    connection.execute(_INSERT_READINGS, values)
            except IntegrityError as err:
                raise self._clash(test_id, run, values, err) from err
        self._checked |= attempts

    def log_event(
        self,
        test_id: str,
        run: int | None,
        time_s: float | None,
        kind: str,
        text: str,
        logged_utc: str | None = None,
    ) -> None:
        """Enter something that happened, durably.

        Parameters
        ----------
        test_id : str
        run : int or None
            None: it belongs to the test as a whole.
        time_s : float or None
            From the run's start, s.
        kind, text : str
        logged_utc : str, optional
            When it was logged, ISO with microseconds; now if not given. An event that is there
            already in every word, this moment among them, is not entered again.
        """
        values = {
            "test_id": test_id,
            "run": run,
            "time_s": number_or_null(time_s),
            "kind": plain_text(kind),
            "text": plain_text(text),
            "logged_utc": logged_utc or utc_now(),
        }
        with told_as_store_error(f"test {test_id}"), self._engine.begin() as connection:
            # whoever else enters an event of this test, perhaps the same one, waits here
            queries.lock_test(connection, test_id)
            if not queries.has_event(connection, values):
                connection.execute(sa.insert(schema.events), [values])

    def mark_attempt(
        self,
        test_id: str,
        run: int,
        segment: int,
        flag: str = "superseded",
        attempt: int | None = None,
    ) -> int:
        """Void the readings of a segment's attempts so far; they stay where they are.

        Parameters
        ----------
        test_id, run, segment
            What is to be repeated.
        flag : str
            Why, in a word.
        attempt : int, optional
            Only this attempt; all of the segment when left out.

        Returns
        -------
        int
            The number of the next attempt.
        """
        with told_as_store_error(f"test {test_id} run {run}"), self._engine.begin() as connection:
            made = queries.attempts(connection, test_id, run, segment)
            old = queries.voided_attempts(connection, test_id, run, segment)
            chosen = (made if attempt is None else {attempt}) - old
            mark = {
                "test_id": test_id,
                "run": int(run),
                "segment": int(segment),
                "flag": plain_text(flag),
                "created_utc": utc_now(),
            }
            if chosen:
                rows = [mark | {"attempt": number} for number in sorted(chosen)]
                connection.execute(sa.insert(schema.voided), rows)
        self._checked.clear()
        return max(made | old | chosen, default=0) + 1

    def finish_run(self, test_id: str, run: int, status: str) -> None:
        """Say how a run ended: "finished", "interrupted" or "failed"."""
        check_status(status)
        with told_as_store_error(f"test {test_id} run {run}"), self._engine.begin() as connection:
            old = queries.run_status(connection, test_id, run)
            if old is None:
                raise StoreError(f"test {test_id} run {run}: has not begun")
            if old == "finished" != status:
                raise StoreError(f"test {test_id} run {run}: is finished already")
            queries.set_run_status(connection, test_id, run, status)
        self._checked.clear()

    def finish_test(
        self, test_id: str, status: str, outcome: str, safe_result_json: str = ""
    ) -> None:
        """Say how a test ended, and let go of the claim on it.

        A run that was open in a test that is not finished ends in the same way. A test that is
        finished stays so; one that was interrupted or failed may end again.
        """
        check_status(status)
        ending = {
            "status": status,
            "outcome": plain_text(outcome),
            "safe_result_json": plain_text(safe_result_json),
        }
        with told_as_store_error(f"test {test_id}"), self._engine.begin() as connection:
            old = queries.need_test(connection, test_id)
            if old["status"] == "finished" and any(old[k] != v for k, v in ending.items()):
                raise StoreError(f"test {test_id}: is finished already")
            connection.execute(
                sa.update(schema.tests).where(schema.tests.c.id == test_id).values(ending)
            )
            if status != "finished":
                queries.end_open_runs(connection, test_id, status)
        self._checked.clear()
        self._release(test_id)

    def reopen_test(self, test_id: str) -> None:
        """Mark a test that was interrupted or has failed as running again; claim it first."""
        with told_as_store_error(f"test {test_id}"), self._engine.begin() as connection:
            if queries.need_test(connection, test_id)["status"] == "finished":
                raise StoreError(f"test {test_id}: is finished and cannot be resumed")
            connection.execute(
                sa.update(schema.tests)
                .where(schema.tests.c.id == test_id)
                .values(status="running", outcome="", safe_result_json="")
            )

    # ---- claims ----

    def claim(self, test_id: str) -> HeldClaim:
        """Take the right to run a test; a store that has it already keeps it.

        `begin_test` takes it too. A dead process's claim is free.

        Raises
        ------
        StoreError
            Naming the process that holds it.
        """
        with self._lock:
            if test_id not in self._claims:
                self._claims[test_id] = self._take(test_id, PATIENCE_S)
        return HeldClaim(test_id, self._release)

    def renew_claims(self) -> None:
        """Take again what was lost with a broken session; a test that somebody took is told of."""
        with self._lock:
            for test_id, claim in self._claims.items():
                if claim.is_lost():
                    claim.release()
                    try:
                        self._claims[test_id] = self._take(test_id, PATIENCE_S)
                    except StoreError as err:
                        log.error("the claim was lost with the server's session: %s", err)

    def is_claimed(self, test_id: str) -> bool:
        """Tell whether some process runs the test now."""
        with self._lock:
            if test_id in self._claims:
                return True
            try:
                self._take(test_id, 0.0).release()
            except StoreError:
                return True
        return False

    def _take(self, test_id: str, patience_s: float) -> Claim:
        if self.path is None:
            return ServerClaim(self._url, test_id, patience_s)
        return FileClaim(self.path, test_id)

    def _release(self, test_id: str) -> None:
        with self._lock:
            claim = self._claims.pop(test_id, None)
        if claim is not None:
            claim.release()

    # ---- reading ----

    def test(self, test_id: str) -> TestRecord:
        """Return a test with its runs."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.test(connection, test_id)

    def has_test(self, test_id: str) -> bool:
        """Tell whether there is such a test."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.has_test(connection, test_id)

    def running_tests(self) -> tuple[str, ...]:
        """Return the ids of the tests that are called running, whether anybody runs them or not."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.running_tests(connection)

    def tests(self) -> tuple[TestSummary, ...]:
        """Return all tests, the oldest first."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.tests(connection)

    def events(self, test_id: str) -> tuple[EventRecord, ...]:
        """Return what happened in a test, in the order of logging."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.events(connection, test_id)

    def last_reading(self, test_id: str, run: int) -> ReadingRow | None:
        """Return the reading of a run that is latest in time, voided or not; None: none yet."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.last_reading(connection, test_id, run)

    def readings(self, test_id: str, run: int | None = None) -> pd.DataFrame:
        """Return readings as a table, in order of run, time and serial.

        Columns: run and those of `ReadingRow`, NaN where nothing was measured, and `voided`:
        empty, or why the attempt the reading belongs to does not count.
        """
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.readings(connection, test_id, run)

    @contextmanager
    def snapshot(self) -> Generator[sa.Connection]:
        """Give a connection on which every question is answered as of one moment."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            if connection.dialect.name == "postgresql":
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            yield connection

    def has_readings(self, values: Sequence[Mapping[str, Any]]) -> bool:
        """Tell whether readings, as `reading_values` has them, are all there."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.has_readings(connection, values)

    def attempts(self, test_id: str) -> set[tuple[int, int, int]]:
        """Return the attempts with readings and the voided ones, as (run, segment, attempt)."""
        with told_as_store_error(self._where), self._reader.connect() as connection:
            return queries.all_attempts(connection, test_id)

    def _clash(
        self, test_id: str, run: int, values: Sequence[Mapping[str, Any]], err: IntegrityError
    ) -> StoreError:
        where = f"test {test_id} run {run}"
        with self._reader.connect() as connection:
            twice = queries.first_present(connection, values)
        if twice is None:
            return StoreError(f"{where}: {one_line(err)}; nothing was changed")
        return StoreError(
            f"{where}: {twice['serial']} slot {twice['slot']} attempt {twice['attempt']} is there "
            "already, expected a reading not yet stored; nothing was changed"
        )


_INSERT_READINGS = sa.insert(schema.readings)
