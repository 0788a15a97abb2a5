"""The store of a running test: never waited for longer than a moment, and nothing lost by that.

A worker thread owns the real store. Each operation is handed to it; when it does not come back in
time, or the store cannot write, the operation and all that follow go into a log on this machine
(`thermo.store_log`), in their order, and are acknowledged from there. The worker does them when the
store answers again. What was given up half-way is done a second time and makes no difference.
See docs/decisions/0009-spool.md.
"""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from sqlite3 import Error as SQLiteError
from typing import Any, TypeVar

import pandas as pd
import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from drivers.clock import Clock
from errormodel.errors import StoreError
from thermo.store import HeldClaim, Store
from thermo.store_claims import FileClaim
from thermo.store_log import (
    Operation,
    SpoolFile,
    apply,
    default_folder,
    prove_writable,
    replay,
    spool_path,
)
from thermo.store_open import StoreAwayError, open_engine, parse_url, shown
from thermo.store_records import EventRecord, NewTest, ReadingRow, TestRecord, TestSummary
from thermo.store_recover import recover
from thermo.store_rows import check_status, number_or_null, reading_values
from thermo.store_sqlite import Identity, checkpoint, copy_open_file, identity
from thermo.store_worker import Worker

log = logging.getLogger(__name__)

# all in real seconds
PATIENCE_S = 2.0  # for a write
LEAST_PATIENCE_S = 0.5  # a disk that is busy for a moment is not away
READ_PATIENCE_S = 10.0  # for a reading back; as long as between two looks at a waiting chamber
OPEN_PATIENCE_S = 300.0  # for an old spool to flow in, before anything is commanded
END_PATIENCE_S = 30.0  # for the spool to flow in at the end
CHECKPOINT_S = 300.0
TELL_S = 300.0  # a store that comes and goes is told of once in so long
END_TRIES = 10  # of a checkpoint

Value = TypeVar("Value")


def patience_s(period_s: float, clock: Clock) -> float:
    """Return for how many real seconds a write may keep a test waiting: one sampling period.

    Parameters
    ----------
    period_s : float
        Between two readings, s on the clock.
    clock : Clock
    """
    real_s = period_s / getattr(clock, "speed", 1.0)
    return min(PATIENCE_S, max(LEAST_PATIENCE_S, real_s))


def open_spooled_store(
    url: str | Path, *, spool_folder: Path | None = None, patience_s: float = PATIENCE_S
) -> "SpooledStore":
    """Open a store for a test that must not wait for it.

    What an earlier test could not bring into it flows in first.

    Parameters
    ----------
    url : str or path
    spool_folder : Path, optional
        Where the spool goes when one is needed; `thermo.store_log.default_folder` if not given.
    patience_s : float
        Real seconds for which a write may keep the caller waiting.

    Raises
    ------
    StoreError
        If it cannot be opened, does not answer, or the spool's folder cannot be written.
    """
    parsed = parse_url(url)
    folder = spool_folder or default_folder()
    prove_writable(folder)
    worker = Worker("store")
    try:
        opening = worker.submit(partial(open_engine, parsed))
        engine = _result(opening, OPEN_PATIENCE_S, shown(parsed))
        store = SpooledStore(engine, parsed, worker, folder, patience_s)
        store.recover()
    except BaseException:
        worker.stop()
        raise
    return store


def _result(future: "Future[Value]", patience_s: float, where: str) -> Value:
    try:
        return future.result(patience_s)
    except TimeoutError:
        future.cancel()  # unless it is being done
        raise StoreAwayError(f"{where}: no answer in {patience_s:.3g} s") from None


class SpooledStore(Store):
    """A store whose writes come back within `patience_s`, or a reading back within ten seconds.

    A write that has returned is durable in the store or in the spool. Made by
    `open_spooled_store`. A reading back shows everything that was written, or raises
    `StoreAwayError`.
    """

    def __init__(
        self, engine: sa.Engine, url: sa.URL, worker: Worker, folder: Path, patience_s: float
    ) -> None:
        super().__init__(engine, url)
        self.patience_s = patience_s
        self._worker = worker
        self._folder = folder
        self._order = threading.RLock()  # one write after the other
        self._gate = threading.Lock()  # for `_spool`: held for a moment only
        self._spool: SpoolFile | None = None
        self._through = threading.Event()  # set: there is no spool, the store has everything
        self._through.set()
        self._file: Identity | None = identity(self.path) if self.path else None
        self._attempts: set[tuple[str, int, int, int]] = set()
        self._stamp_lock = threading.Lock()
        self._stamp = datetime.min.replace(tzinfo=UTC)
        self._due_s = time.monotonic() + CHECKPOINT_S
        self._told_s = -TELL_S
        self._why = self._moved = self._refused = self._log_left = ""
        self._closed = self._settled = False
        worker.idle = self._idle

    # ---- in the caller's thread ----

    def _do(self, operation: Operation) -> Any:
        """Do a write; None when it went into the spool."""
        if self._worker.is_current:
            return apply(self, operation, again=False)
        self._settled = False
        with self._order:
            if self._keep(operation):
                return None
            doing = self._worker.submit(partial(self._direct, operation))
            try:
                return _result(doing, self.patience_s, self._where)
            except StoreAwayError as err:
                self._begin_spooling(operation, str(err))
                return None

    def _keep(self, operation: Operation) -> bool:
        """Add to the spool if there is one."""
        with self._gate:
            if self._spool is not None:
                self._spool.add(operation)
            return self._spool is not None

    def _begin_spooling(self, operation: Operation, why: str) -> None:
        self._why = why
        with self._gate:
            path = spool_path(self._folder, self._url, operation.test_id)
            spool = SpoolFile(path, self._where)
            try:
                spool.add(operation)
            except BaseException:
                spool.close()
                raise
            self._through.clear()
            self._spool = spool
        log.warning("%s; readings go into %s until it answers", why, path)
        if time.monotonic() - self._told_s >= TELL_S:
            self._told_s = time.monotonic()
            self.log_event(
                operation.test_id, None, None, "store", f"{why}; readings go into {path}"
            )

    def _ask(self, call: Callable[[], Value], patience_s: float | None = None) -> Value:
        """Read from the store when it has everything."""
        if self._worker.is_current:
            return call()
        patience_s = READ_PATIENCE_S if patience_s is None else patience_s
        give_up_s = time.monotonic() + patience_s
        if not self._through.wait(patience_s):
            raise StoreAwayError(f"{self._why}; what was written waits in a spool")
        left_s = max(0.0, give_up_s - time.monotonic())
        return _result(self._worker.submit(call), left_s, self._where)

    # ---- in the worker ----

    def _direct(self, operation: Operation) -> Any:
        answer = apply(self, operation, again=False)
        self._follow_file()
        if operation.call in ("finish_run", "finish_test"):
            self._due_s = 0.0
        if time.monotonic() >= self._due_s:
            self._worker.submit(self._tidy)
        return answer

    def _idle(self) -> None:
        if self._spool is not None:
            self._drain(self._spool)
        elif time.monotonic() >= self._due_s:
            self._tidy()
        if self._closed and self._spool is None:
            Store.close(self)
            self._worker.stop()

    def _tidy(self) -> None:
        self._due_s = time.monotonic() + CHECKPOINT_S
        with suppress(StoreError):
            Store.checkpoint(self)
            self.renew_claims()

    def _drain(self, spool: SpoolFile) -> None:
        try:
            self._follow_file()
            replay(self, spool, after=self._follow_file)
        except StoreError as err:
            self._why = str(err)
            return
        with self._gate:
            waiting, refused = spool.count()
            if waiting:
                return
            if refused:
                self._refused = f"{refused} entries that it does not take are in {spool.path}"
                log.error("%s: %s", self._where, self._refused)
            spool.close(delete=not refused)
            self._spool = None
            self._due_s = 0.0
            self._through.set()
        log.warning("%s: answers again; the spool has flowed in", self._where)

    def _follow_file(self) -> None:
        """See that the open file is the one its path names, or go on in a copy of it."""
        if self.path is None or self._file is None:
            return
        now, before = identity(self.path), self._file
        if now == before:
            return
        if now[0] == before[0] and before[1] is None:
            self._file = now  # its -wal has been made
            return
        self._move_to_copy(self.path)

    def _move_to_copy(self, path: Path) -> None:
        stem = f"{path.stem}.{next(iter(self._claims), 'store')}"
        names = (self._folder / f"{stem}{n}.sqlite" for n in ("", *(f"-{k}" for k in range(1, 99))))
        target = next(name for name in names if not name.exists())
        old, url = self._engine, self._url.set(database=str(target))
        try:
            copy_open_file(old, target)
            engine = open_engine(url, existing=True)
        except (OSError, SQLiteError, StoreError) as err:
            raise StoreAwayError(
                f"{path}: was deleted, moved or replaced, and cannot be copied to {target}: {err}"
            ) from None
        self._turn_to(engine, url)
        self._file = identity(target)
        for test_id, claim in list(self._claims.items()):
            claim.release()
            self._claims[test_id] = FileClaim(target, test_id)
        self._moved = (
            f"{path} was deleted, moved or replaced while the test ran: everything is in {target}"
        )
        log.error("%s", self._moved)
        with suppress(SQLAlchemyError, SQLiteError):
            checkpoint(old)  # if it was moved, it is whole where it is now
        old.dispose()
        with suppress(StoreError):
            for test_id in self._claims:
                self.log_event(test_id, None, None, "store", self._moved)

    # ---- writing ----

    def begin_test(self, new: NewTest) -> str:
        """As `Store.begin_test`; a store that does not answer begins no test."""
        return self._ask(partial(super().begin_test, new))

    def begin_run(
        self,
        test_id: str,
        number: int,
        start_utc: datetime | str,
        start_clock_s: float | None = None,
    ) -> None:
        """As `Store.begin_run`."""
        start = start_utc if isinstance(start_utc, str) else start_utc.isoformat()
        arguments = {"test_id": test_id, "number": int(number), "start_utc": start}
        arguments |= {"start_clock_s": start_clock_s}
        self._do(Operation(call="begin_run", arguments=arguments))

    def append(self, test_id: str, run: int, rows: Sequence[ReadingRow]) -> None:
        """As `Store.append`."""
        if not rows:
            return
        values = [reading_values(test_id, run, row) for row in rows]
        arguments = {"test_id": test_id, "run": int(run), "values": values}
        self._do(Operation(call="append", arguments=arguments))
        self._attempts |= {(test_id, int(run), v["segment"], v["attempt"]) for v in values}

    def log_event(
        self,
        test_id: str,
        run: int | None,
        time_s: float | None,
        kind: str,
        text: str,
        logged_utc: str | None = None,
    ) -> None:
        """As `Store.log_event`; the moment tells events of the same words apart."""
        arguments = {"test_id": test_id, "run": run, "time_s": number_or_null(time_s)}
        arguments |= {"kind": kind, "text": text, "logged_utc": logged_utc or self._next_stamp()}
        self._do(Operation(call="log_event", arguments=arguments))

    def _next_stamp(self) -> str:
        with self._stamp_lock:
            self._stamp = max(datetime.now(UTC), self._stamp + timedelta(microseconds=1))
            return self._stamp.isoformat(timespec="microseconds")

    def mark_attempt(
        self,
        test_id: str,
        run: int,
        segment: int,
        flag: str = "superseded",
        attempt: int | None = None,
    ) -> int:
        """As `Store.mark_attempt`; what was written by this object tells the number if need be."""
        arguments = {"test_id": test_id, "run": int(run), "segment": int(segment)}
        number = self._do(
            Operation(
                call="mark_attempt", arguments={**arguments, "flag": flag, "attempt": attempt}
            )
        )
        if attempt is not None:
            self._attempts.add((test_id, int(run), int(segment), attempt))
        if number is not None:
            return int(number)
        place = (test_id, int(run), int(segment))
        return max((a for *here, a in self._attempts if tuple(here) == place), default=0) + 1

    def finish_run(self, test_id: str, run: int, status: str) -> None:
        """As `Store.finish_run`."""
        arguments = {"test_id": test_id, "run": int(run), "status": check_status(status)}
        self._do(Operation(call="finish_run", arguments=arguments))

    def finish_test(
        self, test_id: str, status: str, outcome: str, safe_result_json: str = ""
    ) -> None:
        """As `Store.finish_test`; the claim is kept until the store knows of the end."""
        arguments = {"test_id": test_id, "status": check_status(status), "outcome": outcome}
        arguments["safe_result_json"] = safe_result_json
        self._do(Operation(call="finish_test", arguments=arguments))

    def reopen_test(self, test_id: str) -> None:
        """As `Store.reopen_test`; a store that does not answer resumes no test."""
        self._ask(partial(super().reopen_test, test_id))

    # ---- claims and reading: in the worker, within a bounded time ----

    def claim(self, test_id: str) -> HeldClaim:
        """As `Store.claim`."""
        held = self._ask(partial(super().claim, test_id))
        if not self._worker.is_current:
            known = self._ask(partial(super().attempts, test_id))
            self._attempts |= {(test_id, *one) for one in known}
        return held

    def is_claimed(self, test_id: str) -> bool:
        """As `Store.is_claimed`."""
        return self._ask(partial(super().is_claimed, test_id))

    def _release(self, test_id: str) -> None:
        self._ask(partial(super()._release, test_id))

    def test(self, test_id: str) -> TestRecord:
        """As `Store.test`."""
        return self._ask(partial(super().test, test_id))

    def tests(self) -> tuple[TestSummary, ...]:
        """As `Store.tests`."""
        return self._ask(partial(super().tests))

    def events(self, test_id: str) -> tuple[EventRecord, ...]:
        """As `Store.events`."""
        return self._ask(partial(super().events, test_id))

    def last_reading(self, test_id: str, run: int) -> ReadingRow | None:
        """As `Store.last_reading`."""
        return self._ask(partial(super().last_reading, test_id, run))

    def readings(self, test_id: str, run: int | None = None) -> pd.DataFrame:
        """As `Store.readings`."""
        return self._ask(partial(super().readings, test_id, run))

    def checkpoint(self, tries: int = 1) -> bool:
        """As `Store.checkpoint`."""
        return self._ask(partial(super().checkpoint, tries))

    # ---- the ends ----

    def recover(self) -> None:
        """Let flow in what earlier tests left, and mend what they could not end."""
        self._ask(partial(recover, self, self._folder), OPEN_PATIENCE_S)

    def settle(self, patience_s: float = END_PATIENCE_S) -> str:
        """Wait until the store has everything and its file holds it; return `note`."""
        self._settled = True
        if not self._through.wait(patience_s):
            return self.note()
        try:
            self._ask(self._follow_file)
            whole = self._ask(partial(super().checkpoint, END_TRIES))
        except StoreError as err:
            log.warning("%s", err)
        else:
            self._log_left = "" if whole else (
                f"{self.path}-wal holds the last readings, another program reads the store: "
                "the two files belong together"
            )  # fmt: skip
        return self.note()

    def note(self) -> str:
        """Return where readings are that are not in this store, a line; empty: nowhere else."""
        spooled = ""
        with self._gate:
            if self._spool is not None:
                spooled = (
                    f"the store does not answer: {self._spool.count()[0]} entries wait in "
                    f"{self._spool.path}; `accelbench runs --store {self._where}` brings them in"
                )
        return "; ".join(s for s in (self._moved, spooled, self._refused, self._log_left) if s)

    def close(self) -> None:
        """Close it; with a store that does not answer now, when it does, while this process lives.

        Nothing is lost by the process ending before that.
        """
        if self._closed:
            return
        if not self._settled and (note := self.settle()):
            log.warning("%s", note)
        self._closed = True
        if self._through.is_set():
            closing = self._worker.submit(partial(super().close))
            self._worker.stop(READ_PATIENCE_S)
            if closing.done():
                closing.result()
