"""A throw-away PostgreSQL server, and a store on either database for the tests that want both."""

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import psycopg
import pytest

_numbers = count()


def _programs() -> Path | None:
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if found:
        return found[-1].parent
    in_path = shutil.which("initdb")
    return Path(in_path).resolve().parent if in_path else None


def _owner() -> str | None:
    """PostgreSQL does not run as root: return who runs it then, None for ourselves."""
    if os.getuid() != 0:
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return next((name for name in ("postgres", "nobody") if name in names), "")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    """URL of a database on a server of this process's own; every test worker has its own."""
    programs, owner = _programs(), _owner()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (no initdb)")
    if owner == "":
        pytest.skip("running as root without a user postgres or nobody to run PostgreSQL as")
    folder = Path(tempfile.mkdtemp(prefix="accelbench-pg-"))
    as_owner = {} if owner is None else {"user": owner, "group": pwd.getpwnam(owner).pw_gid}
    as_owner |= {"cwd": folder} if owner is None else {"cwd": folder, "extra_groups": []}
    if owner is not None:
        shutil.chown(folder, owner)

    def run(program: str, *args: str) -> None:
        done = subprocess.run(
            [programs / program, *args],
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if program == "initdb" else subprocess.DEVNULL,
            stderr=subprocess.STDOUT,
            timeout=60,
            env={"PATH": os.defpath, "LC_ALL": "C", "HOME": str(folder)},
            **as_owner,
        )
        assert done.returncode == 0, f"{program}: {done.stdout}"

    try:
        data = str(folder / "data")
        run("initdb", "-D", data, "-U", "bench", "-A", "trust", "--no-sync", "-E", "UTF8")
        port = _free_port()
        options = f"-h 127.0.0.1 -p {port} -k {folder} -c shared_buffers=16MB -c max_connections=50"
        run(
            "pg_ctl",
            "-D",
            data,
            "-w",
            "-t",
            "50",
            "-l",
            str(folder / "log"),
            "-o",
            options,
            "start",
        )
        try:
            yield f"postgresql://bench@127.0.0.1:{port}/postgres"
        finally:
            run("pg_ctl", "-D", data, "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=["sqlite", "postgresql"])
def store_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty store; a test that takes this runs on both databases."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'bench.sqlite'}"
    server: str = request.getfixturevalue("postgres_server")
    schema = f"t{next(_numbers)}"
    with psycopg.connect(server) as connection:
        connection.execute(f"CREATE SCHEMA {schema}".encode())
    return f"{server}?options=-csearch_path%3D{schema}"
