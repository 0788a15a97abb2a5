"""A throw-away PostgreSQL server for the campaign, that can be stopped and killed."""

import atexit
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import psycopg

_numbers = count()
_folder = Path()
_port = 0


def _run(program: str, *args: str) -> None:
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{program}"))
    # it does not run as root
    user = {"user": "postgres", "extra_groups": []} if os.getuid() == 0 else {}
    subprocess.run(
        [found[-1] if found else program, *args], check=True, cwd=_folder, timeout=60,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, **user,
    )  # fmt: skip


def start() -> None:
    """Start the server, made anew the first time."""
    global _folder, _port
    if not _port:
        _folder = Path(tempfile.mkdtemp(prefix="faults-postgresql-"))
        if os.getuid() == 0:
            os.chown(_folder, pwd.getpwnam("postgres").pw_uid, -1)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            _port = probe.getsockname()[1]
        _run("initdb", "-D", f"{_folder}/data", "-U", "bench", "-A", "trust", "-E", "UTF8")
        atexit.register(end, os.getpid())
    options = f"-h 127.0.0.1 -p {_port} -k {_folder} -c shared_buffers=16MB"
    _run("pg_ctl", "-D", f"{_folder}/data", "-w", "-l", f"{_folder}/log", "-o", options, "start")


def end(owner: int) -> None:
    if os.getpid() == owner:
        _run("pg_ctl", "-D", f"{_folder}/data", "-m", "immediate", "stop")
        shutil.rmtree(_folder, ignore_errors=True)


def new_database() -> str:
    """Return the URL of an empty database."""
    if not _port:
        start()
    name = f"faults{next(_numbers)}"
    server = f"postgresql://bench@127.0.0.1:{_port}/"
    with psycopg.connect(f"{server}postgres", autocommit=True) as link:
        link.execute(f"create database {name}")
    return server + name


def _processes() -> list[int]:
    """Return the server's processes, the postmaster first."""
    master = int((_folder / "data/postmaster.pid").read_text().split()[0])
    children = Path(f"/proc/{master}/task/{master}/children").read_text()
    return [master, *map(int, children.split())]


@contextmanager
def stopped() -> Iterator[None]:
    """Stop every process of the server meanwhile."""
    pids = _processes()
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


def crash() -> None:
    """End every process of the server at once, as when its machine fails."""
    _run("pg_ctl", "-D", f"{_folder}/data", "-m", "immediate", "stop")
