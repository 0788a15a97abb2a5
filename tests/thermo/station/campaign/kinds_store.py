"""Faults of the store, of files and of the terminal."""

import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from tests.thermo.station.campaign import postgresql
from tests.thermo.station.campaign.case import Case
from tests.thermo.station.campaign.kinds import END_S, PATIENCE_S, Result, begin, end, kind

# ---- the store


@kind(8)
def store_locked(case: Case) -> Result:
    begin(case)
    for_s = case.rng.uniform(0.5, 6)
    holder = sqlite3.connect(case.store, timeout=5, isolation_level=None)
    holder.execute("begin immediate" if case.rng.random() < 0.5 else "begin exclusive")
    give_up = time.monotonic() + for_s
    while time.monotonic() < give_up:
        time.sleep(0.05)
    holder.execute("rollback")
    holder.close()
    return Result((0, 1))


@kind(4)
def store_locked_and_killed(case: Case) -> Result:
    begin(case)
    holder = sqlite3.connect(case.store, timeout=5, isolation_level=None)
    holder.execute("begin immediate")
    time.sleep(case.rng.uniform(0.5, 3))
    case.strike()
    case.process.kill(signal.SIGKILL)
    end(case)
    safe_s = case.wait_safe(PATIENCE_S)
    holder.execute("rollback")
    holder.close()
    return Result((-9,), problems=[] if safe_s < PATIENCE_S else [f"safe after {safe_s}"])


def _copies(case: Case) -> list[str]:
    return [str(p) for p in (case.folder / "state").glob("accelbench/spool/*.sqlite")]


@kind(6)
def store_deleted(case: Case) -> Result:
    begin(case)
    for path in case.folder.glob("night.sqlite*"):
        if path.name in ("night.sqlite", "night.sqlite-wal", "night.sqlite-shm"):
            path.unlink()
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


@kind(4)
def store_moved(case: Case) -> Result:
    begin(case)
    away = case.folder / "away.sqlite"
    shutil.move(case.store, away)
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


@kind(3)
def store_replaced(case: Case) -> Result:
    begin(case)
    other = case.folder / "other.sqlite"
    other.write_bytes(b"")
    os.replace(other, case.store)
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


def _disk(case: Case) -> Path:
    disk = case.folder / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(disk)], check=True)
    return disk


@kind(5)
def disk_full(case: Case) -> Result:
    disk = _disk(case)
    case.store = str(disk / "night.sqlite")
    begin(case, high=8)
    ballast = _fill(disk / "ballast")
    if case.rng.random() < 0.5:
        time.sleep(1.5)
        ballast.unlink()
        return Result((0,))
    end(case)
    ballast.unlink()
    return Result((0, 1))


def _fill(path: Path) -> Path:
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return path


@kind(3)
def state_folder_removed(case: Case) -> Result:
    """The folder of spools is taken away, then the store is locked."""
    begin(case, high=8)
    shutil.rmtree(case.folder / "state")
    with closing(sqlite3.connect(case.store, timeout=5, isolation_level=None)) as holder:
        holder.execute("begin immediate")
        time.sleep(case.rng.uniform(0.5, 5))
        holder.execute("rollback")
    return Result((0, 1))


@kind(3)
def no_more_files(case: Case) -> Result:
    """Nothing more can be opened by the controller: no spool, no new connection."""
    begin(case, high=8)
    resource.prlimit(case.process.pid, resource.RLIMIT_NOFILE, (4, 4))
    if case.rng.random() < 0.5:
        case.panel("chamber", "reset", 1)
    else:
        with closing(sqlite3.connect(case.store, timeout=5, isolation_level=None)) as holder:
            holder.execute("begin immediate")
            time.sleep(case.rng.uniform(0.5, 3))
            holder.execute("rollback")
    return Result((0, 1), within_s=60)


@kind(3)
def disk_full_spool_too(case: Case) -> Result:
    disk = _disk(case)
    case.store = str(disk / "night.sqlite")
    case.environment["XDG_STATE_HOME"] = str(disk / "state")
    begin(case, high=8)
    ballast = _fill(disk / "ballast")
    end(case)
    ballast.unlink()
    return Result((0, 1))


@kind(3)
def out_disk_full(case: Case) -> Result:
    disk = _disk(case)
    begin(case, "--out", str(disk / "night.csv"))
    ballast = _fill(disk / "ballast")
    end(case)
    ballast.unlink()
    return Result((1,), says="accelbench export")


@kind(8)
def postgresql_stopped(case: Case) -> Result:
    case.store = postgresql.new_database()
    begin(case, high=8)
    with postgresql.stopped():
        time.sleep(case.rng.uniform(0.5, 8))
        killed = case.rng.random() < 0.3
        if killed:
            case.strike()
            case.process.kill(signal.SIGKILL)
            end(case)
            safe_s = case.wait_safe(PATIENCE_S)
            return Result((-9,), problems=[] if safe_s < PATIENCE_S else ["not safe"])
    return Result((0, 1))


@kind(4)
def postgresql_killed(case: Case) -> Result:
    """The server dies and comes back from its own log."""
    case.store = postgresql.new_database()
    begin(case, high=8)
    postgresql.crash()
    time.sleep(case.rng.uniform(0.2, 2))
    postgresql.start()
    return Result((0, 1))


@kind(4)
def out_removed(case: Case) -> Result:
    (case.folder / "results").mkdir()
    begin(case, "--out", "results/night.csv")
    shutil.rmtree(case.folder / "results")
    return Result((1,), says="accelbench export")


# ---- the terminal


@contextmanager
def _terminal() -> Iterator[tuple[int, int]]:
    """Give both ends of a terminal; whatever is open of it in the end is closed."""
    with _closed_at_the_end(*os.openpty()) as (master, slave):
        yield master, slave


@contextmanager
def _pipe() -> Iterator[tuple[int, int]]:
    """Give both ends of a pipe; whatever is open of it in the end is closed."""
    with _closed_at_the_end(*os.pipe()) as (read, write):
        yield read, write


@contextmanager
def _closed_at_the_end(*fds: int) -> Iterator[tuple[int, ...]]:
    try:
        yield fds
    finally:
        for fd in fds:
            with suppress(OSError):
                os.close(fd)


@kind(4)
def terminal_stopped(case: Case) -> Result:
    """Nobody takes a byte from the terminal, as after Ctrl-S."""
    with _terminal() as (master, slave):
        begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
        os.write(master, b"\x13")
        end(case)
    return Result((0,))


@kind(3)
def terminal_ctrl_s_then_q(case: Case) -> Result:
    said = b""
    with _terminal() as (master, slave):
        begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
        os.write(master, b"\x13")
        time.sleep(1.5)
        os.write(master, b"\x11")
        os.set_blocking(master, False)
        give_up = time.monotonic() + END_S
        while case.process.poll() is None and time.monotonic() < give_up:
            try:
                said += os.read(master, 65536)
            except BlockingIOError:
                time.sleep(0.02)
    return Result((0,), problems=[] if b"finished" in said else ["the outcome was not told"])


@kind(4)
def terminal_hung_up(case: Case) -> Result:
    with _terminal() as (_, slave):
        begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
    return Result((1,))


@kind(4)
def tee_dead(case: Case) -> Result:
    with _pipe() as (_, write):
        begin(case, fds={1: write, 2: write})
    return Result((0,))


@kind(3)
def pipe_undrained(case: Case) -> Result:
    """Nobody reads the pipe that takes the output; it is full before the test begins."""
    with _pipe() as (_, write):
        os.set_blocking(write, False)
        with suppress(BlockingIOError):
            while True:
                os.write(write, bytes(4096))
        os.set_blocking(write, True)
        case.start(fds={1: write, 2: write})
        case.strike()
        end(case)
    return Result((0,))


@kind(3)
def stderr_closed(case: Case) -> Result:
    begin(case, fds={2: None})
    return Result((0,))
