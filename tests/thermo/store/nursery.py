"""Writers in processes that are there at once, to be killed while they write to a store."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

from thermo.store.records import NewTest
from thermo.store.store import open_store

# Imports once, then forks a writer for each line it reads: a fresh interpreter takes a second.
# No thread and no connection exists in the parent, so its children start clean.
PROGRAM = """
import os, sys
import psycopg, sqlalchemy.dialects.postgresql.psycopg, sqlalchemy.dialects.sqlite.pysqlite
from thermo.store.records import ReadingRow

def rows(number):
    return [
        ReadingRow(serial=s, slot=number, time_s=10.0 * number, temp_c=20.0, position_deg=0.0,
                   output=number + 0.1)
        for s in "ABC"
    ]

def acknowledge(number):
    os.write(1, b"ack %d\\n" % number)

{writer}

os.write(1, b"ready\\n")
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        try:
            write(*line.split())
        except BaseException as err:
            os.write(1, f"failed {{err}}\\n".encode())
        os._exit(1)
    os.write(1, b"born %d\\n" % child)
    os.waitpid(child, 0)
    os.write(1, b"dead\\n")
"""


@dataclass
class Writer:
    """A process that writes until it is killed."""

    pid: int
    _news: Iterator[str]

    def first(self) -> int:
        """Return the first number it acknowledges."""
        line = next(self._news)
        assert line.startswith("ack"), line
        return int(line.split()[1])

    def rest(self) -> list[int]:
        """Return what it acknowledges until it is dead."""
        numbers: list[int] = []
        for line in self._news:
            assert not line.startswith("failed"), line
            if line == "dead\n":
                break
            numbers.append(int(line.split()[1]))
        return numbers


@contextmanager
def nursery(
    writer: str, environment: Mapping[str, str] | None = None
) -> Iterator[Callable[..., Writer]]:
    """Yield what starts a writer with some words.

    Parameters
    ----------
    writer : str
        Source of a function `write` of those words; it has `rows` of a number, and `acknowledge`.
    environment : mapping, optional
        Beside this process's own.
    """
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(writer=writer)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | (environment or {}),
    ) as process:
        orders, news = _streams(process)
        assert news.readline() == "ready\n"

        def start(*words: object) -> Writer:
            orders.write(" ".join(map(str, words)) + "\n")
            orders.flush()
            said = iter(news.readline, "")
            pid = next(int(line.split()[1]) for line in said if line.startswith("born"))
            return Writer(pid, said)

        yield start
        orders.close()


def _streams(process: "subprocess.Popen[str]") -> tuple[IO[str], IO[str]]:
    assert process.stdin is not None
    assert process.stdout is not None
    return process.stdin, process.stdout


def begin_test(url: str) -> str:
    """Begin a test that any writer may claim, and return its id."""
    with open_store(url) as store:
        test_id = store.begin_test(NewTest("kill", "", "{}"))
        store.finish_test(test_id, "interrupted", "handed over")
    return test_id
