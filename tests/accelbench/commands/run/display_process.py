"""`accelbench` in a process of its own, on whatever its standard streams shall be."""

import contextlib
import json
import os
import pty
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[4]
SHORT = ROOT / "examples/sequences/short.toml"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "100"}
PATIENCE_S = 120.0  # of a loaded machine
LONG_PATIENCE_S = 600.0


def program(*arguments: str | Path, still_s: float | None = None) -> list[str]:
    """The command line; `still_s` is how long it waits in the end for whoever does not read."""
    patience = f"accelbench.shell.surroundings.CLOSE_S = {still_s};" if still_s is not None else ""
    code = (
        f"import sys, accelbench.shell.surroundings; {patience} "
        "import accelbench.cli as c; sys.exit(c.main())"
    )
    return [sys.executable, "-c", code, *map(str, arguments)]


@contextmanager
def started(command: list[str], **streams: Any) -> Iterator[subprocess.Popen[bytes]]:
    given = {"stdin": subprocess.DEVNULL, "env": ENVIRONMENT} | streams
    process = subprocess.Popen(command, **given)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait(PATIENCE_S)
        for end in (process.stdout, process.stderr):
            if end is not None:
                end.close()


def wait_until(condition, process: subprocess.Popen[bytes]) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert process.poll() is None, f"ended with {process.returncode}"
        assert time.monotonic() < give_up
        time.sleep(0.02)


def asked(store: Path, query: str) -> list[tuple[Any, ...]]:
    """Rows of a store that may be being written; none before it has tables."""
    try:
        with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True)) as db:
            return db.execute(query).fetchall()
    except sqlite3.OperationalError:
        return []


def count(store: Path) -> int:
    return next(iter(asked(store, "select count(*) from readings")), (0,))[0]


def events(store: Path, kind: str) -> list[str]:
    return [text for (text,) in asked(store, f"select text from events where kind = '{kind}'")]


def ended(store: Path) -> tuple[str, str, bool]:
    """How the only test of a store ended, and whether its chamber was left safe."""
    ((status, outcome, safe),) = asked(store, "select status, outcome, safe_result_json from tests")
    return status, outcome, json.loads(safe)["verified"]


class Screen:
    """A pseudo-terminal; nobody reads it before `read_along`."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        self.seen = b""
        self._reader: threading.Thread | None = None

    def press(self, key: bytes) -> None:
        os.write(self.master, key)

    def fill(self) -> None:
        """Let no further byte go into it."""
        os.set_blocking(self.slave, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(self.slave, 64 * b".")
        os.set_blocking(self.slave, True)

    def read_along(self) -> None:
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def close(self) -> None:
        os.close(self.slave)
        if self._reader is not None:
            self._reader.join(PATIENCE_S)
        os.close(self.master)

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the last one to hold the other end has gone
            while piece := os.read(self.master, 4096):
                self.seen += piece


@contextmanager
def screen() -> Iterator[Screen]:
    made = Screen()
    try:
        yield made
    finally:
        made.close()
