"""The spool's file: an ordered log of store operations, each on the disk when it was added.

An operation is the name of a method of `Store` with its arguments. Done in their order, any of them
twice if need be, they bring a store to the state it would have had.
"""

import hashlib
import json
import os
import sqlite3
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.database import StoreAwayError, store_errors
from thermo.store.records import QUANTITIES, ReadingRow, ScheduleMark
from thermo.store.sqlite import inode
from thermo.store.store import Store

SUFFIX = ".spool"
_SECRET_PARTS = ("password", "passfile", "sslpassword")


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """A writing method of `Store`, `call`, with its arguments as JSON has them."""

    call: str
    arguments: Mapping[str, Any]

    @property
    def test_id(self) -> str:
        """The test it belongs to."""
        return str(self.arguments["test_id"])


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoolEntry:
    """An operation in the log; `refused` is why the store did not take it, empty before that."""

    number: int
    operation: Operation
    refused: str = ""


def apply(store: Store, operation: Operation, *, again: bool) -> Any:
    """Do an operation.

    Parameters
    ----------
    store : Store
    operation : Operation
    again : bool
        Whether it may have been done before, wholly or not at all, without the answer having
        come: then it is not an error that it was. Only readings need to be told: the other
        operations come to the same when they are done twice in a row.

    Raises
    ------
    StoreAwayError
        When the store does not take anything now.
    StoreError
        When it refuses this.
    """
    arguments = dict(operation.arguments)
    if operation.call == "mark_schedule":
        arguments["mark"] = ScheduleMark(**arguments["mark"])
    # the methods of `Store` itself, not those of a spooled store that would come here again
    if operation.call != "append":
        return getattr(Store, operation.call)(store, **arguments)
    values = arguments.pop("values")
    rows = [
        ReadingRow(**{name: value[name] for name in _ROW}, signals=value.get("signals", {}))
        for value in values
    ]
    try:
        Store.append(store, **arguments, rows=rows)
    except StoreAwayError:
        raise
    except StoreError:
        if not (again and Store.has_readings(store, values)):
            raise
    return None


_ROW = ("serial", "slot", "attempt", "segment", *QUANTITIES, "flag")


def default_folder() -> Path:
    """Return where spools lie: ``accelbench/spool`` in the user's state directory."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    return Path(state) / "accelbench/spool"


def prove_spool_writable(folder: Path) -> None:
    """Make a folder that only its user can read, and write into it.

    Raises
    ------
    StoreError
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0" * 4096)
            file.flush()
    except OSError as err:
        raise StoreError(
            f"{folder}: cannot be written ({err.strerror}): readings go there when the store does "
            "not answer; XDG_STATE_HOME names another place"
        ) from None


def digest(url: sa.URL) -> str:
    """Return a name for a store that tells nothing of its password."""
    if url.get_backend_name() == "sqlite":
        text = str(Path(str(url.database)).resolve())
    else:
        query = sorted((n, v) for n, v in url.query.items() if n not in _SECRET_PARTS)
        text = f"{url.username}@{url.host}:{url.port or 5432}/{url.database}?{query}"
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def spool_path(folder: Path, url: sa.URL, test_id: str) -> Path:
    """Return where the spool of a test in a store lies."""
    return folder / f"{digest(url)}.{test_id}{SUFFIX}"


class SpoolFile:
    """An open log; made when there is none, and locked against every other process.

    Parameters
    ----------
    path : Path
    where : str
        The store it is for, as messages show it; kept from the first time.
    patience_s : float
        Real seconds to wait for another process that has it open.

    Raises
    ------
    StoreError
        If it cannot be made, or another process has it open.
    """

    def __init__(self, path: Path, where: str = "", *, patience_s: float = 0.0) -> None:
        self.path = path
        self._lock = threading.Lock()
        give_up_s = time.monotonic() + patience_s
        with store_errors(str(path)):
            while True:
                before = _made(path)
                try:
                    self._db = self._open(where)
                except sqlite3.OperationalError:  # SQLite does not wait itself here
                    if time.monotonic() >= give_up_s:
                        raise
                    time.sleep(0.02)
                    continue
                # who had it open before may have taken it away between the two
                if before is not None and before == inode(path):
                    break
                self._db.close()

    def _open(self, where: str) -> sqlite3.Connection:
        db = sqlite3.connect(self.path, timeout=0.0, isolation_level=None, check_same_thread=False)
        try:
            # exclusive: held until it is closed, or its process has ended in whatever way
            for pragma in ("locking_mode=EXCLUSIVE", "journal_mode=WAL", "synchronous=FULL"):
                db.execute(f"PRAGMA {pragma}").fetchone()
            db.execute("BEGIN IMMEDIATE")
            db.execute(_LOG)
            db.execute("CREATE TABLE IF NOT EXISTS store (shown TEXT NOT NULL)")
            db.execute(
                "INSERT INTO store SELECT ? WHERE NOT EXISTS (SELECT 1 FROM store)", (where,)
            )
            db.execute("COMMIT")
        except BaseException:
            db.close()
            raise
        return db

    def _do(self, statement: str, *values: Any) -> list[Any]:
        with self._lock, store_errors(str(self.path)):
            return self._db.execute(statement, values).fetchall()

    @property
    def where(self) -> str:
        """The store it is for, as messages show it."""
        return str(self._do("SELECT shown FROM store")[0][0])

    def add(self, operation: Operation) -> None:
        """Add an operation; when this returns it is on the disk."""
        text = json.dumps(dict(operation.arguments))
        self._do("INSERT INTO log (call, arguments) VALUES (?, ?)", operation.call, text)

    def first(self) -> SpoolEntry | None:
        """Return the oldest entry that the store has neither taken nor refused."""
        found = self._do(
            "SELECT number, call, arguments FROM log WHERE refused = '' ORDER BY number LIMIT 1"
        )
        if not found:
            return None
        number, call, text = found[0]
        return SpoolEntry(number=number, operation=Operation(call=call, arguments=json.loads(text)))

    def taken(self, entry: SpoolEntry) -> None:
        """Take out what the store has."""
        self._do("DELETE FROM log WHERE number = ?", entry.number)

    def refuse(self, entry: SpoolEntry, reason: str) -> None:
        """Keep an entry that the store does not take, with the reason."""
        self._do("UPDATE log SET refused = ? WHERE number = ?", reason or "refused", entry.number)

    def count(self) -> tuple[int, int]:
        """Return how many entries wait, and how many were refused."""
        return tuple(
            self._do("SELECT count(*) FILTER (WHERE refused = ''), "
                     "count(*) FILTER (WHERE refused <> '') FROM log")[0]
        )  # fmt: skip

    def close(self, *, delete: bool = False) -> None:
        """Close it; harmless when done twice. `delete`: take the file away before."""
        with self._lock, store_errors(str(self.path)):
            if delete:
                # first the file: nobody is to find it, and add to it, between the two
                for suffix in ("", "-wal"):
                    self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
            self._db.close()


_LOG = (
    "CREATE TABLE IF NOT EXISTS log (number INTEGER PRIMARY KEY AUTOINCREMENT, "
    "call TEXT NOT NULL, arguments TEXT NOT NULL, refused TEXT NOT NULL DEFAULT '')"
)


def _made(path: Path) -> tuple[int, int] | None:
    """Make a file if there is none, and return which one it is; None: it has gone again."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    except FileExistsError:
        pass  # and not opened here: closing it would drop the lock of this process on it
    except OSError as err:
        raise StoreError(f"{path}: cannot be made: {err.strerror}") from None
    return inode(path)


def replay(store: Store, spool: SpoolFile, after: Callable[[], None] = lambda: None) -> None:
    """Do what a log holds, oldest first, and take out what was done.

    `after` is called between the two: what it raises leaves the entry in the log.

    Raises
    ------
    StoreAwayError
        When the store does not answer (any more); the rest stays.
    """
    while (entry := spool.first()) is not None:
        try:
            apply(store, entry.operation, again=True)
        except StoreAwayError:
            raise
        except StoreError as err:
            spool.refuse(entry, str(err))
        else:
            after()
            spool.taken(entry)
