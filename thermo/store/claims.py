"""Claims on tests: one process at a time runs a test, and a dead one lets go by itself.

The claim is a lock that the operating system (SQLite: a locked file beside the database) or the
server (PostgreSQL: an advisory lock of an open session) drops when its owner is gone, however it
went. So there is no lease to wait out and no stale mark to clear by hand.
"""

import fcntl
import hashlib
import logging
import os
import socket
import threading
import time
from pathlib import Path
from typing import Protocol

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from errormodel.errors import StoreError
from thermo.store.database import session_engine, store_errors

log = logging.getLogger(__name__)

PATIENCE_S = 2.0  # the server takes a moment to see that a client has died


class Claim(Protocol):
    """The right to run a test, held until it is released or the process ends."""

    def is_lost(self) -> bool:
        """Tell whether it has gone without having been released."""
        ...

    def release(self) -> None:
        """Let go; harmless when done twice."""
        ...


class FileClaim:
    """A claim by a locked file `DATABASE.TEST_ID.claim`."""

    def __init__(self, database: Path, test_id: str) -> None:
        self._path = database.with_name(f"{database.name}.{test_id}.claim")
        self._file: int | None = None
        while True:
            try:
                file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except OSError as err:
                raise StoreError(f"{self._path}: cannot be made: {err.strerror}") from None
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                owner = os.pread(file, 200, 0).decode(errors="replace") or "another process"
                os.close(file)
                raise StoreError(f"test {test_id}: is being run by {owner}") from None
            if self._is_still(file):
                break
            os.close(file)  # the former owner took the file away between opening and locking
        os.ftruncate(file, 0)
        os.pwrite(file, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        self._file = file

    def _is_still(self, file: int) -> bool:
        try:
            return os.path.samestat(os.fstat(file), os.stat(self._path))
        except FileNotFoundError:
            return False

    def is_lost(self) -> bool:
        """Tell whether it has gone: never, the file is locked as long as this process lives."""
        return False

    def release(self) -> None:
        """Let go; harmless when done twice."""
        if self._file is not None:
            self._path.unlink(missing_ok=True)
            os.close(self._file)
            self._file = None


class ServerClaim:
    """A claim by a PostgreSQL advisory lock, in a session of its own."""

    def __init__(self, url: sa.URL, test_id: str, patience_s: float = PATIENCE_S) -> None:
        self._connection: sa.Connection | None = None
        digest = hashlib.sha256(b"accelbench claim " + test_id.encode()).digest()
        key = int.from_bytes(digest[:8], "big", signed=True)
        deadline_s = time.monotonic() + patience_s
        with store_errors(f"test {test_id}"):
            connection = session_engine(url).connect()
            connection = connection.execution_options(isolation_level="AUTOCOMMIT")
            try:
                while not connection.execute(_TRY, {"key": key}).scalar():
                    if time.monotonic() > deadline_s:
                        owner = connection.execute(_OWNER, {"key": key}).scalar()
                        who = owner or "another process"
                        raise StoreError(f"test {test_id}: is being run by {who}")
                    time.sleep(0.02)
            except BaseException:
                connection.close()
                raise
        self._connection = connection

    def is_lost(self) -> bool:
        """Tell whether the session has been broken, and the lock with it."""
        if self._connection is None:
            return False
        try:
            self._connection.execute(sa.select(1))
        except SQLAlchemyError:
            return True
        return False

    def release(self) -> None:
        """Let go; harmless when done twice."""
        if self._connection is not None:
            self._connection.close()  # ends the session, and the lock with it
            self._connection = None


_TRY = sa.text("SELECT pg_try_advisory_lock(:key)")
_OWNER = sa.text(
    "SELECT a.application_name FROM pg_locks l JOIN pg_stat_activity a USING (pid) "
    "WHERE l.locktype = 'advisory' AND l.objsubid = 1 AND l.granted "
    "AND ((l.classid::bigint << 32) | l.objid::bigint) = :key LIMIT 1"
)


class Claims:
    """The claims that one open store has on its tests; safe to use from several threads.

    Parameters
    ----------
    url : sa.URL
        Of the store.
    """

    def __init__(self, url: sa.URL) -> None:
        self._url = url
        self._held: dict[str, Claim] = {}
        self._lock = threading.RLock()

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests claimed, the oldest claim first."""
        with self._lock:
            return tuple(self._held)

    def take(self, test_id: str) -> None:
        """Take the claim on a test unless it is held already.

        Raises
        ------
        StoreError
            Naming the process that holds it.
        """
        with self._lock:
            if test_id not in self._held:
                self._held[test_id] = self._claim(test_id, PATIENCE_S)

    def renew(self) -> None:
        """Take again what was lost with a broken session; a test that somebody took is told of."""
        with self._lock:
            for test_id, claim in self._held.items():
                if claim.is_lost():
                    claim.release()
                    try:
                        self._held[test_id] = self._claim(test_id, PATIENCE_S)
                    except StoreError as err:
                        log.error("the claim was lost with the session of the server: %s", err)

    def move_to(self, url: sa.URL) -> None:
        """Hold the same claims on the tests of another store, from now on the one that is open.

        Raises
        ------
        StoreError
            If one is held by another process.
        """
        with self._lock:
            self._url = url
            for test_id, claim in self._held.items():
                claim.release()
                self._held[test_id] = self._claim(test_id, PATIENCE_S)

    def is_taken(self, test_id: str) -> bool:
        """Tell whether some process, this one among them, holds the claim on a test."""
        with self._lock:
            if test_id in self._held:
                return True
            try:
                self._claim(test_id, 0.0).release()
            except StoreError:
                return True
        return False

    def release(self, test_id: str) -> None:
        """Let go; harmless when there is none."""
        with self._lock:
            claim = self._held.pop(test_id, None)
        if claim is not None:
            claim.release()

    def release_all(self) -> None:
        """Let go of every test."""
        for test_id in self.tests:
            self.release(test_id)

    def _claim(self, test_id: str, patience_s: float) -> Claim:
        if self._url.get_backend_name() == "sqlite":
            return FileClaim(Path(str(self._url.database)), test_id)
        return ServerClaim(self._url, test_id, patience_s)


class HeldClaim:
    """A claim as a store hands it out: a context manager that lets go at its end."""

    def __init__(self, test_id: str, release: "Releaser") -> None:
        self.test_id = test_id
        self._release = release

    def release(self) -> None:
        """Let go; harmless when done twice."""
        self._release(self.test_id)

    def __enter__(self) -> "HeldClaim":
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


class Releaser(Protocol):
    """Lets go of the claim on a test."""

    def __call__(self, test_id: str) -> None:
        """Let go; harmless when there is none."""
        ...
