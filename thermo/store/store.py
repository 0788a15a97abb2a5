"""The store: tests, runs and readings that survive the process that wrote them.

A reading is acknowledged when `Store.append` returns: it is then on the disk, in a table to which
rows are only added. SQLite and PostgreSQL behave alike; see docs/decisions/0003-store.md. A running
test writes through `thermo.store.spool.spooled_store`, which never waits for a store that does not
answer.
"""

import secrets
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from errormodel.errors import StoreError
from thermo.store import changes, queries, schema
from thermo.store.claims import Claims, HeldClaim
from thermo.store.database import (
    driver_message,
    open_engine,
    parse_store_url,
    store_errors,
    utc_now,
)
from thermo.store.reader import StoreReader
from thermo.store.records import (
    NewTest,
    ReadingRow,
    ScheduleMark,
    check_status,
    json_text,
    number_or_null,
    plain_text,
    reading_values,
)
from thermo.store.sqlite import checkpoint


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
    parsed = parse_store_url(url)
    return Store(open_engine(parsed, existing=existing), parsed)


class Store(StoreReader):
    """An open store; a context manager, and safe to use from several threads.

    Every method raises `StoreError` when the database refuses or cannot be reached.
    """

    def __init__(self, engine: sa.Engine, url: sa.URL) -> None:
        super().__init__(engine, url)
        self._claims = Claims(url)
        self._checked: set[tuple[str, int, int, int]] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of all claims and of the database; harmless when done twice."""
        self._claims.release_all()
        self._engine.dispose()

    def checkpoint(self, tries: int = 1) -> bool:
        """Take an SQLite store's -wal into its file; True when the file alone holds everything.

        Each try waits for readers for a fifth of a second at the most.
        """
        if self.path is None:
            return True
        with store_errors(self._where):
            return checkpoint(self._engine, tries)

    @contextmanager
    def changing(self) -> Generator[sa.Connection]:
        """Give a connection on which everything is changed together or not at all."""
        with store_errors(self._where), self._engine.begin() as connection:
            yield connection

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
            with store_errors(self._where), self._engine.begin() as connection:
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
        values = {
            "test_id": test_id,
            "number": int(number),
            "start_utc": start,
            "start_clock_s": start_clock_s,
            "status": "running",
        }
        with store_errors(f"test {test_id}"), self._engine.begin() as connection:
            changes.begin_run(connection, values)

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
        with store_errors(f"test {test_id} run {run}"):
            try:
                with self._engine.begin() as connection:
                    for key in attempts - self._checked:
                        queries.need_open_attempt(connection, *key)
                    changes.insert_readings(connection, values)
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
        with store_errors(f"test {test_id}"), self._engine.begin() as connection:
            changes.insert_once(connection, schema.events, values)

    def mark_schedule(
        self, test_id: str, run: int, mark: ScheduleMark, logged_utc: str | None = None
    ) -> None:
        """Enter where the schedule of a run stands, durably; a resumption goes by the last one.

        Parameters
        ----------
        test_id : str
        run : int
        mark : ScheduleMark
        logged_utc : str, optional
            As for `log_event`; a mark that is there already is not entered again.
        """
        values = {
            "test_id": test_id,
            "run": int(run),
            **asdict(mark),
            "logged_utc": logged_utc or utc_now(),
        }
        with store_errors(f"test {test_id} run {run}"), self._engine.begin() as connection:
            changes.insert_once(connection, schema.schedule_marks, values)

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
        with store_errors(f"test {test_id} run {run}"), self._engine.begin() as connection:
            following = changes.void_attempts(
                connection, test_id, run, segment, plain_text(flag), attempt
            )
        self._checked.clear()
        return following

    def finish_run(self, test_id: str, run: int, status: str) -> None:
        """Say how a run ended: "finished", "interrupted" or "failed"."""
        check_status(status)
        with store_errors(f"test {test_id} run {run}"), self._engine.begin() as connection:
            changes.finish_run(connection, test_id, run, status)
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
        with store_errors(f"test {test_id}"), self._engine.begin() as connection:
            changes.finish_test(connection, test_id, ending)
        self._checked.clear()
        self._release(test_id)

    def reopen_test(self, test_id: str) -> None:
        """Mark a test that was interrupted or has failed as running again; claim it first."""
        with store_errors(f"test {test_id}"), self._engine.begin() as connection:
            changes.reopen_test(connection, test_id)

    # ---- claims ----

    def claim(self, test_id: str) -> HeldClaim:
        """Take the right to run a test; a store that has it already keeps it.

        `begin_test` takes it too. A dead process's claim is free.

        Raises
        ------
        StoreError
            Naming the process that holds it.
        """
        self._claims.take(test_id)
        return HeldClaim(test_id, self._release)

    def is_claimed(self, test_id: str) -> bool:
        """Tell whether some process runs the test now."""
        return self._claims.is_taken(test_id)

    def _release(self, test_id: str) -> None:
        self._claims.release(test_id)

    def _clash(
        self, test_id: str, run: int, values: Sequence[Mapping[str, Any]], err: IntegrityError
    ) -> StoreError:
        where = f"test {test_id} run {run}"
        with self._reader.connect() as connection:
            twice = queries.first_present(connection, values)
        if twice is None:
            return StoreError(f"{where}: {driver_message(err)}; nothing was changed")
        return StoreError(
            f"{where}: {twice['serial']} slot {twice['slot']} attempt {twice['attempt']} is there "
            "already, expected a reading not yet stored; nothing was changed"
        )
