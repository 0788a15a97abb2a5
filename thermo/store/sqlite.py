"""A store's SQLite file: opened so that a commit is on the disk, and kept together.

Write-ahead log, synchronous=FULL, foreign keys and a busy timeout. What was committed lies in the
file's -wal until a checkpoint takes it into the file itself.
"""

import os
import sqlite3
import time
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

from errormodel.errors import StoreError
from thermo.store import schema

BUSY_TIMEOUT_S = 30.0
CHECKPOINT_WAIT_S = 0.2  # for readers, at each try of a checkpoint

Identity = tuple[tuple[int, int] | None, tuple[int, int] | None]


def companion_path(path: Path, suffix: str) -> Path:
    """Return the file that belongs to a database, ``night.sqlite-wal``."""
    return Path(f"{path}{suffix}")


def look_before_opening(path: Path, *, existing: bool) -> None:
    """Refuse a file that is not a sound store, and leave it as it is.

    The file is looked at through SQLite alone: were it opened and closed besides, every lock would
    go that this process holds on it by another connection, and another process could then take
    the write-ahead log away from under it.

    Parameters
    ----------
    path : Path
    existing : bool
        Whether it is to hold a store already, so that an empty file is refused too.

    Raises
    ------
    StoreError
    """
    if not path.parent.is_dir():
        raise StoreError(f"{path}: no such folder")
    if path.is_dir():
        raise StoreError(f"{path}: a folder, expected a file")
    try:
        size = path.stat().st_size if path.exists() else 0
        if size == 0 and existing:
            raise StoreError(f"{path}: an empty file, expected a store")
    except OSError as err:
        raise StoreError(f"{path}: cannot be read: {err.strerror}") from None
    if size == 0:
        return
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path}: cannot be read: permission denied")
    try:
        with _looking(path) as db:
            verdict = str(db.execute("PRAGMA quick_check(1)").fetchone()[0])
            tables = {row[0] for row in db.execute("SELECT name FROM sqlite_master")}
    except sqlite3.Error as err:
        if getattr(err, "sqlite_errorcode", None) == sqlite3.SQLITE_NOTADB:
            raise StoreError(f"{path}: not a store (no SQLite file); nothing was changed") from None
        verdict, tables = str(err), set[str]()
    if verdict != "ok":
        line = (verdict.splitlines() or ["no reason given"])[0]
        raise StoreError(f"{path}: damaged ({line}); nothing was changed")
    if not tables:
        raise StoreError(
            f"{path}: has a header and no tables: its -wal file is missing or orphaned; expected "
            f"{path.name}-wal beside it, as it was when the store was written; nothing was changed"
        )
    if schema.schema_version.name not in tables:
        raise StoreError(f"{path}: not a store (it has other tables); nothing was changed")


@contextmanager
def _looking(path: Path) -> Generator[sqlite3.Connection]:
    # a creation that was killed is undone first, and that is a writing
    mode = "rw" if companion_path(path, "-journal").exists() else "ro"
    url = f"{path.resolve().as_uri()}?mode={mode}"
    with closing(sqlite3.connect(url, uri=True, timeout=BUSY_TIMEOUT_S)) as db:
        yield db


def holds_test(path: Path, test_id: str) -> bool:
    """Tell whether a file is a store with this test in it; whatever is wrong with it: no."""
    try:
        with _looking(path) as db:
            found = db.execute("SELECT 1 FROM tests WHERE id = ?", (test_id,)).fetchone()
    except sqlite3.Error:
        return False
    return found is not None


def sqlite_engine(url: sa.URL, *, write_ahead: bool = True) -> sa.Engine:
    """Return an engine on a file.

    Parameters
    ----------
    url : sa.URL
    write_ahead : bool
        False while the tables are made: they are then in the file itself, so that one without
        tables can only have lost its write-ahead log.
    """
    engine = sa.create_engine(url, connect_args={"timeout": BUSY_TIMEOUT_S})

    def on_connect(db: sqlite3.Connection, _: Any) -> None:
        db.isolation_level = None  # transactions are begun below, not guessed by the module
        if write_ahead:
            _write_ahead(db)
        for pragma in ("synchronous=FULL", "fullfsync=ON", "foreign_keys=ON"):
            db.execute(f"PRAGMA {pragma}").close()

    def on_begin(connection: sa.Connection) -> None:
        # a writer takes its lock at once: one that turns from reader to writer can be refused
        reading = connection.get_execution_options().get("reading", False)
        connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")

    event.listen(engine, "connect", on_connect)
    event.listen(engine, "begin", on_begin)
    return engine


def _write_ahead(db: sqlite3.Connection) -> None:
    """Switch to the write-ahead log; SQLite does not wait for others there, so this does."""
    deadline_s = time.monotonic() + BUSY_TIMEOUT_S
    while True:
        with suppress(sqlite3.OperationalError):
            if db.execute("PRAGMA journal_mode=WAL").fetchone()[0] == "wal":
                return
        if time.monotonic() > deadline_s:
            raise sqlite3.OperationalError("cannot switch to the write-ahead log")
        time.sleep(0.01)


@contextmanager
def _raw(engine: sa.Engine) -> Generator[sqlite3.Connection]:
    """Lend the driver's own connection, outside of any transaction."""
    lent = engine.raw_connection()
    try:
        db = lent.driver_connection
        assert isinstance(db, sqlite3.Connection)
        yield db
    finally:
        lent.close()


def checkpoint(engine: sa.Engine, tries: int = 1) -> bool:
    """Take the write-ahead log into the file; True when the file alone then holds everything.

    A reader in mid-transaction keeps the newest part out; it is tried again `tries` times.
    """
    with _raw(engine) as db:
        db.execute(f"PRAGMA busy_timeout={1000 * CHECKPOINT_WAIT_S:.0f}")
        try:
            for _ in range(tries):
                busy, frames, taken = db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
                if not busy or frames == taken:
                    return True
        finally:
            db.execute(f"PRAGMA busy_timeout={1000 * BUSY_TIMEOUT_S:.0f}")
    return False


def copy_open_file(engine: sa.Engine, path: Path) -> None:
    """Copy what an open connection sees into a new file, also when its own was unlinked or moved.

    Raises
    ------
    OSError, sqlite3.Error
        If it cannot be written; nothing is left of it then.
    """
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    try:
        with closing(sqlite3.connect(path)) as target, _raw(engine) as source:
            target.execute("PRAGMA synchronous=FULL")
            source.backup(target)
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def identity(path: Path) -> Identity:
    """Return which file and which -wal the path names now; None for one that is not there.

    Raises
    ------
    OSError
        If that cannot be told.
    """
    return inode(path), inode(companion_path(path, "-wal"))


def inode(path: Path) -> tuple[int, int] | None:
    """Return which file a path names, as device and inode; None when there is none."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return found.st_dev, found.st_ino
