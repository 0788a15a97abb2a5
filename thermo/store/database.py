"""Opening a store's database so that a commit means: it is on the disk.

SQLite: `thermo.store.sqlite`. PostgreSQL: synchronous_commit, and a time limit on everything that
can be waited for. No message shows a password.
"""

import logging
import os
import re
import socket
import sqlite3
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.exc import ArgumentError, DataError, DBAPIError, IntegrityError, SQLAlchemyError

from errormodel.errors import StoreError
from thermo.store import schema
from thermo.store.migration import OLDEST, migrate, tables_since
from thermo.store.sqlite import look_before_opening, sqlite_engine

log = logging.getLogger(__name__)

SCHEMA_LOCK = 0x0ACCE1  # PostgreSQL advisory lock: one process at a time makes the tables

# libpq's own limits, for a host that is gone; a server that is only stopped answers none of them
CONNECTING = {
    "connect_timeout": 10,  # s
    "tcp_user_timeout": 20_000,  # ms that sent bytes may stay unacknowledged
    "keepalives_idle": 10,  # s
    "keepalives_interval": 5,  # s
    "keepalives_count": 3,
}
# the server's limits, s: a statement, a wait for somebody's lock, a transaction left open
SESSION = {
    "statement_timeout": "300s",
    "lock_timeout": "10s",
    "idle_in_transaction_session_timeout": "60s",
    "tcp_keepalives_idle": "30s",  # a dead host's claim is let go
    "synchronous_commit": "on",  # a commit that has returned is on the disk, whatever the default
}

# what a URL's query may show; all else can carry a secret (password, sslpassword, options, …)
_SHOWN = {"host", "hostaddr", "port", "dbname", "user", "sslmode", "connect_timeout"}
_MASK = "***"
_secrets: set[str] = set()  # of every URL that was parsed: drivers repeat pieces of it


class StoreAwayError(StoreError):
    """The store does not answer, or cannot write now; it may later."""


def utc_now() -> str:
    """Return the present as ISO text with microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


def driver_message(err: BaseException) -> str:
    """Return the first line of what a driver said, without any password."""
    cause = err.orig if isinstance(err, DBAPIError) and err.orig is not None else err
    line = (str(cause).strip().splitlines() or [type(cause).__name__])[0]
    for secret in sorted(_secrets, key=len, reverse=True):
        line = re.sub(rf"(?<!\w){re.escape(secret)}(?!\w)", _MASK, line)
    return line


@contextmanager
def store_errors(where: str) -> Generator[None]:
    """Turn what the database says into a `StoreError` of one line.

    Refused values are one; everything else a database can say means that it is away.
    """
    try:
        yield
    except (IntegrityError, DataError, OverflowError, sqlite3.IntegrityError) as err:
        raise StoreError(f"{where}: {driver_message(err)}") from err
    except (SQLAlchemyError, sqlite3.Error) as err:
        raise StoreAwayError(f"{where}: {driver_message(err)}") from err


def parse_store_url(url: str | Path) -> sa.URL:
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
        if _LIKE_A_SERVER.search(text):  # not shown: it may hold a password
            raise StoreError("the store is no file name: expected FILE, sqlite:///FILE or "
                             "postgresql://USER@HOST/DATABASE")  # fmt: skip
        return sa.URL.create("sqlite", database=text)
    try:
        parsed = sa.make_url(text)
    except (ArgumentError, ValueError):
        raise StoreError("the store's URL is not a URL: expected sqlite:///FILE or postgresql://…"
                         ) from None  # fmt: skip
    kind = parsed.drivername.split("+")[0]
    if kind in {"postgresql", "postgres"}:
        if "@" in f"{parsed.host}{parsed.database}":
            raise StoreError("the store's URL has a second @: write an @ in a password as %40")
        _secrets.update(_secrets_of(parsed))
        return parsed.set(drivername="postgresql+psycopg")
    if kind != "sqlite":
        raise StoreError(f"{kind}: expected sqlite:///FILE or postgresql://…")
    if parsed.host or parsed.username or parsed.password:
        raise StoreError("a file URL cannot have a user or a host: expected sqlite:///FILE")
    if parsed.database in {None, "", ":memory:"}:
        raise StoreError("a store in memory would lose all readings: expected sqlite:///FILE")
    return parsed.set(drivername="sqlite")


_LIKE_A_SERVER = re.compile(r"^(postgres(ql)?|sqlite)(\+\w+)?:|\b(password|passfile)\s*=|\w:[^/]*@")


def _secrets_of(url: sa.URL) -> set[str]:
    hidden = {str(url.password)} if url.password else set[str]()
    for name, value in url.query.items():
        if name not in _SHOWN:
            hidden |= {value} if isinstance(value, str) else set(value)
    return hidden - {""}


def display_url(url: sa.URL | str | Path) -> str:
    """Return a store for messages: the file, or the URL without password or other secrets."""
    if not isinstance(url, sa.URL):
        if "://" not in str(url):
            return str(url)
        url = parse_store_url(url)
    if url.get_backend_name() == "sqlite":
        return str(url.database)
    query = {name: value if name in _SHOWN else _MASK for name, value in url.query.items()}
    masked = url.set(drivername="postgresql", query={n: v for n, v in sorted(query.items())})
    return masked.render_as_string(hide_password=True).replace("%2A%2A%2A", _MASK)


def open_engine(url: sa.URL, *, existing: bool = False) -> sa.Engine:
    """Open the database and make the tables when it is new.

    Parameters
    ----------
    url : sa.URL
    existing : bool
        Whether it is to hold a store already.

    Raises
    ------
    StoreError
        If it cannot be reached, is damaged, is not a store, or is newer than this program.
    """
    where = display_url(url)
    if url.get_backend_name() == "sqlite":
        path = Path(str(url.database))
        look_before_opening(path, existing=existing)
        if not path.exists() or path.stat().st_size == 0:
            _make_tables_in_file(url, where)
        engine = sqlite_engine(url)
    else:
        engine = _postgres_engine(url)
    try:
        with store_errors(where):
            _make_or_check_tables(engine, where)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _make_tables_in_file(url: sa.URL, where: str) -> None:
    engine = sqlite_engine(url, write_ahead=False)
    try:
        with store_errors(where):
            _make_or_check_tables(engine, where)
    finally:
        engine.dispose()


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
            connect_args={
                "application_name": label,
                **{name: limit for name, limit in CONNECTING.items() if name not in url.query},
            },
        )
    except ImportError:
        raise StoreError(
            f"{display_url(url)}: needs psycopg: install accelbench[postgres]"
        ) from None

    def on_connect(db: Any, _: Any) -> None:
        with db.cursor() as cursor:
            cursor.execute("; ".join(f"SET {name} = '{value}'" for name, value in SESSION.items()))
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
            if not isinstance(version, int) or not OLDEST <= version <= schema.SCHEMA_VERSION:
                raise StoreError(
                    f"{where}: schema version {version}, expected {schema.SCHEMA_VERSION}: "
                    "made by another version of this program; nothing was changed"
                )
            later = {table.name for table in tables_since(version)}
            missing = set(schema.metadata.tables) - names - later
            if missing:
                raise StoreError(f"{where}: damaged: no table {min(missing)}; nothing was changed")
            if version < schema.SCHEMA_VERSION:
                migrate(connection, version)
            return
        schema.metadata.create_all(connection)
        connection.execute(
            sa.insert(schema.schema_version).values(
                version=schema.SCHEMA_VERSION, created_utc=utc_now()
            )
        )
