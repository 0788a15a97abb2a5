"""A store that is taken away for a time: its file locked, or its server's processes stopped."""

import os
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psycopg


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Another program holds the database."""
    db = sqlite3.connect(file, isolation_level=None, timeout=30)
    try:
        db.execute("BEGIN EXCLUSIVE")
        yield
        db.execute("ROLLBACK")
    finally:
        db.close()


def _parent(pid: int) -> int:
    # the name in brackets may hold anything, what follows it is fixed
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def _server_processes(url: str) -> list[int]:
    with psycopg.connect(url, connect_timeout=30) as connection:
        row = connection.execute("SELECT pg_backend_pid()").fetchone()
        assert row is not None
        server = _parent(row[0])
    found = [server]
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if _parent(int(entry.name)) == server:
                found.append(int(entry.name))
    return found


@contextmanager
def stopped(url: str) -> Iterator[None]:
    """A server whose every process stands still, as with a disk that hangs."""
    processes = _server_processes(url)
    _signal(processes, signal.SIGSTOP)
    try:
        yield
    finally:
        _signal(processes, signal.SIGCONT)


def _signal(processes: list[int], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


@contextmanager
def away(url: str) -> Iterator[None]:
    """The store does not answer, whichever it is."""
    with stopped(url) if url.startswith("postgresql") else locked(Path(url[len("sqlite:///") :])):
        yield
