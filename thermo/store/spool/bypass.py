"""Going round a store that does not answer: the worker that owns it, and the spool.

A worker thread owns the real store. Each operation is handed to it; when it does not come back in
time, or the store cannot write, the operation and all that follow go into a log on this machine
(`thermo.store.spool.log`), in their order, and are acknowledged from there. The worker does them
when the store answers again. What was given up half-way is done a second time and makes no
difference.
See docs/decisions/0010-spool.md.
"""

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import count
from pathlib import Path
from sqlite3 import Error as SQLiteError
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from errormodel.errors import StoreError
from thermo.planning.silence import READ_PATIENCE_S
from thermo.store.database import StoreAwayError, open_engine
from thermo.store.spool.log import Operation, SpoolFile, apply, replay, spool_path
from thermo.store.spool.worker import StoreWorker
from thermo.store.sqlite import Identity, checkpoint, copy_open_file, identity
from thermo.store.store import Store

log = logging.getLogger(__name__)

CHECKPOINT_S = 300.0
TELL_S = 300.0  # a store that comes and goes is told of once in so long

Value = TypeVar("Value")


def result_of(future: "Future[Value]", patience_s: float, where: str) -> Value:
    """Return what a job came to, or give it up after so many real seconds.

    Raises
    ------
    StoreAwayError
        When it was given up; if it had not begun, it never will.
    """
    try:
        return future.result(patience_s)
    except TimeoutError:
        future.cancel()  # unless it is being done
        raise StoreAwayError(f"{where}: no answer in {patience_s:.3g} s") from None


class BypassedStore(Store):
    """A store with a worker that owns it and a spool that stands in for it.

    `thermo.store.spool.spooled_store.SpooledStore` makes the methods of a store from `do_write` and
    `ask`.
    """

    def __init__(
        self, engine: sa.Engine, url: sa.URL, worker: StoreWorker, folder: Path, patience_s: float
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

    def do_write(self, operation: Operation) -> Any:
        """Do a write; None when it went into the spool."""
        if self._worker.is_current:
            return apply(self, operation, again=False)
        self._settled = False
        with self._order:
            if self._keep(operation):
                return None
            doing = self._worker.submit(partial(self._direct, operation))
            try:
                return result_of(doing, self.patience_s, self._where)
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
            spool = SpoolFile(path, self._where, patience_s=self.patience_s)
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

    def ask(self, call: Callable[[], Value], patience_s: float | None = None) -> Value:
        """Read from the store when it has everything."""
        if self._worker.is_current:
            return call()
        patience_s = READ_PATIENCE_S if patience_s is None else patience_s
        give_up_s = time.monotonic() + patience_s
        if not self._through.wait(patience_s):
            raise StoreAwayError(f"{self._why}; the readings wait in a spool")
        left_s = max(0.0, give_up_s - time.monotonic())
        return result_of(self._worker.submit(call), left_s, self._where)

    def next_stamp(self) -> str:
        """Return the present as ISO text, later than every time before."""
        with self._stamp_lock:
            self._stamp = max(datetime.now(UTC), self._stamp + timedelta(microseconds=1))
            return self._stamp.isoformat(timespec="microseconds")

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
            self._claims.renew()

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
                self._refused = f"{refused} entries that it refuses are in {spool.path}"
                log.error("%s: %s", self._where, self._refused)
            spool.close(delete=not refused)
            self._spool = None
            self._due_s = 0.0
            self._through.set()
        log.warning("%s: answers again; the spool has been stored", self._where)

    def _follow_file(self) -> None:
        """See that the open file is the one its path names, or go on in a copy of it."""
        if self.path is None or self._file is None:
            return
        try:
            now, before = identity(self.path), self._file
        except OSError as err:  # no reason to believe that it has gone
            log.warning("%s: cannot be looked at: %s", self.path, err.strerror)
            return
        if now == before:
            return
        if now[0] == before[0] and before[1] is None:
            self._file = now  # its -wal has been made
            return
        self._move_to_copy(self.path)

    def _move_to_copy(self, path: Path) -> None:
        stem = f"{path.stem}.{next(iter(self._claims.tests), 'store')}"
        names = (self._folder / f"{stem}{f'-{k}' if k else ''}.sqlite" for k in count())
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
        self._claims.move_to(url)
        self._moved = (
            f"{path} was deleted, moved or replaced while the test ran: everything is in {target}"
        )
        log.error("%s", self._moved)
        with suppress(SQLAlchemyError, SQLiteError):
            checkpoint(old)  # if it was moved, it is whole where it is now
        old.dispose()
        with suppress(StoreError):
            for test_id in self._claims.tests:
                self.log_event(test_id, None, None, "store", self._moved)
