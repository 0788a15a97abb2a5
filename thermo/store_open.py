"""Opening a store's database so that a commit means: it is on the disk.

SQLite: write-ahead log, synchronous=FULL, foreign keys, and a busy timeout; a file is looked at
without being written before it is opened in earnest. PostgreSQL: synchronous_commit.
"""

import logging
import os
import socket
import sqlite3
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError

from errormodel.errors import StoreError
from thermo import store_schema as schema

log = logging.getLogger(__name__)

BUSY_TIMEOUT_S = 30.0
SQLITE_MAGIC = b"SQLite format 3\0"
SCHEMA_LOCK = 0x0ACCE1  # PostgreSQL advisory lock: one process at a time makes the tables


def utc_now() -> str:
    """Return the present as ISO text with microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


def one_line(err: BaseException) -> str:
    """Return the first line of what a driver said."""
    cause = err.orig if isinstance(err, DBAPIError) and err.orig is not None else err
    return (str(cause).strip().splitlines() or [type(cause).__name__])[0]


@contextmanager
def told_as_store_error(where: str) -> Generator[None]:
    """Turn what the database says into a `StoreError` of one line."""
    try:
        yield
    except SQLAlchemyError as err:
        raise StoreError(f"{where}: {one_line(err)}") from err
    except (sqlite3.Error, OverflowError) as err:
        raise StoreError(f"{where}: {one_line(err)}") from err


def parse_url(url: str | Path) -> sa.URL:
    """Turn a bare path, ``sqlite:///path`` or ``postgresql://…`` into a URL.

    Raises
    ------
    StoreError
        If it is another database, or one that lives in memory only.
    """
    text = str(url)
    if "://" not in text:
        if not text or text == ":memory:" or "\0" in text:
            raise StoreError(f"{text!r}: expected a file name or a database URL")
        return sa.URL.create("sqlite", database=text)
    try:
        parsed = sa.make_url(text)
    except (ArgumentError, ValueError):
        raise StoreError("the store's URL is not a URL: expected sqlite:///FILE or postgresql://…"
                         ) from None  # fmt: skip
    kind = parsed.drivername.split("+")[0]
    if kind in {"postgresql", "postgres"}:
        return parsed.set(drivername="postgresql+psycopg")
    if kind != "sqlite":
        raise StoreError(f"{kind}: expected sqlite:///FILE or postgresql://…")
    if parsed.database in {None, "", ":memory:"}:
        raise StoreError("sqlite in memory would lose everything: expected sqlite:///FILE")
    return parsed.set(drivername="sqlite")


def open_engine(url: sa.URL) -> sa.Engine:
    """Open the database and make the tables when it is new.

    Raises
    ------
    StoreError
        If it cannot be reached, is damaged, is not a store, or is newer than this program.
    """
    where = shown(url)
    if url.get_backend_name() == "sqlite":
        _look_before_opening(Path(str(url.database)))
        engine = _sqlite_engine(url)
    else:
        engine = _postgres_engine(url)
    try:
        with told_as_store_error(where):
            _make_or_check_tables(engine, where)
    except BaseException:
        engine.dispose()
        raise
    return engine


def shown(url: sa.URL) -> str:
    """Return the database for messages, without its password."""
    if url.get_backend_name() == "sqlite":
        return str(url.database)
    return url.render_as_string(hide_password=True)


def _look_before_opening(path: Path) -> None:
    """Refuse a file that is not a sound SQLite database, and leave it as it is."""
    if not path.parent.is_dir():
        raise StoreError(f"{path}: no such folder")
    if path.is_dir():
        raise StoreError(f"{path}: a folder, expected a file")
    try:
        size = path.stat().st_size if path.exists() else 0
        if size == 0:
            return
        with open(path, "rb") as file:
            magic = file.read(len(SQLITE_MAGIC))
    except OSError as err:
        raise StoreError(f"{path}: cannot be read: {err.strerror}") from None
    if magic != SQLITE_MAGIC:
        raise StoreError(f"{path}: not a store (no SQLite file); nothing was changed")
    try:
        with _read_only(path) as db:
            verdict = str(db.execute("PRAGMA quick_check(1)").fetchone()[0])
            tables = {row[0] for row in db.execute("SELECT name FROM sqlite_master")}
    except sqlite3.Error as err:
        verdict, tables = str(err), set[str]()
    if verdict != "ok":
        raise StoreError(f"{path}: damaged ({one_line(ValueError(verdict))}); nothing was changed")
    if tables and schema.schema_version.name not in tables:
        raise StoreError(f"{path}: not a store (it has other tables); nothing was changed")


@contextmanager
def _read_only(path: Path) -> Generator[sqlite3.Connection]:
    db = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_TIMEOUT_S)
    try:
        yield db
    finally:
        db.close()


def _sqlite_engine(url: sa.URL) -> sa.Engine:
    engine = sa.create_engine(url, connect_args={"timeout": BUSY_TIMEOUT_S})

    def on_connect(db: sqlite3.Connection, _: Any) -> None:
        db.isolation_level = None  # transactions are begun below, not guessed by the module
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


def session_engine(url: sa.URL) -> sa.Engine:
    """Return an engine on PostgreSQL whose every connection is a session that ends with it."""
    return _postgres_engine(url, poolclass=sa.NullPool)


def _postgres_engine(url: sa.URL, **options: Any) -> sa.Engine:
    label = f"accelbench {os.getpid()}@{socket.gethostname()}"[:63]
    try:
        engine = sa.create_engine(
            url,
            pool_pre_ping=True,
            **options,
            connect_args={"application_name": label, "connect_timeout": 10},
        )
    except ImportError:
        raise StoreError(f"{shown(url)}: needs psycopg: install accelbench[postgres]") from None

    def on_connect(db: Any, _: Any) -> None:
        with db.cursor() as cursor:
            # a commit that has returned is on the server's disk, whatever the server's default
            cursor.execute("SET synchronous_commit = on")
            cursor.execute("SET tcp_keepalives_idle = 30")  # a dead host's claim is let go
        db.commit()

    event.listen(engine, "connect", on_connect)
    return engine


def _make_or_check_tables(engine: sa.Engine, where: str) -> None:
    with engine.begin() as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(SCHEMA_LOCK)))
            if connection.exec_driver_sql("SHOW fsync").scalar_one() != "on":
                log.warning("%s: the server runs with fsync off: a power cut loses data", where)
        names = set(sa.inspect(connection).get_table_names())
        if schema.schema_version.name in names:
            version = connection.execute(sa.select(schema.schema_version.c.version)).scalar()
            if version != schema.SCHEMA_VERSION:
                raise StoreError(
                    f"{where}: schema version {version}, expected {schema.SCHEMA_VERSION}: "
                    "made by another version of this program; nothing was changed"
                )
            missing = set(schema.metadata.tables) - names
            if missing:
                raise StoreError(f"{where}: damaged: no table {min(missing)}; nothing was changed")
            return
        schema.metadata.create_all(connection)
        connection.execute(
            sa.insert(schema.schema_version).values(
                version=schema.SCHEMA_VERSION, created_utc=utc_now()
            )
        )
