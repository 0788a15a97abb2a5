"""A small process that makes the chamber safe when the controller dies without doing so.

The controller starts it before it tells the chamber anything, and keeps the other end of a pipe.
An orderly end writes "done" into it. A pipe that ends without it means that the controller is gone
(kill -9, the out-of-memory killer, a power-cycled container): the guardian then opens the chamber
itself, puts it into the safe condition, verifies it and leaves the result in a file. It is in a
session of its own and deaf to the terminal's signals.
"""

import fcntl
import hashlib
import json
import logging
import os
import select
import signal
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.chambers import open_chamber
from drivers.devices import SafeResult
from drivers.station import ChamberConfig

log = logging.getLogger(__name__)

DONE = b"done\n"
READY = "ready"
BUSY = "another guardian has the chamber"
RETRY_S = 600.0  # real seconds for which a chamber that does not answer is tried
PAUSE_S = 2.0
LOOK_S = 1.0  # between two looks whether the parent still lives
DEAF_TO = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGPIPE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Charge:
    """What a guardian watches over; the first line it is given, as JSON."""

    chamber: ChamberConfig
    safe_temp_c: float
    result_path: Path
    retry_s: float = RETRY_S

    def line(self) -> str:
        """Write the charge as one line."""
        return json.dumps(
            {
                "chamber": self.chamber.model_dump(mode="json"),
                "safe_temp_c": self.safe_temp_c,
                "result_path": str(self.result_path),
                "retry_s": self.retry_s,
            }
        )

    @classmethod
    def parse(cls, line: str) -> "Charge":
        """Read what `line` wrote."""
        data: Mapping[str, Any] = json.loads(line)
        return cls(
            chamber=ChamberConfig.model_validate(data["chamber"]),
            safe_temp_c=float(data["safe_temp_c"]),
            result_path=Path(data["result_path"]),
            retry_s=float(data["retry_s"]),
        )


def open_lock(chamber_url: str) -> int:
    """Open the file that the guardian of a chamber holds locked as long as it lives.

    It is the chamber's, not a test's: whatever is to run next on it has to wait.

    Returns
    -------
    int
        A file descriptor, not locked yet.
    """
    digest = hashlib.sha256(chamber_url.encode()).hexdigest()[:16]
    path = Path(tempfile.gettempdir()) / f"accelbench-guardian-{digest}.lock"
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        # readable for all: another user's test waits for it as well
        return os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)


def make_safe(charge: Charge) -> SafeResult:
    """Open the chamber afresh and make it safe, again and again until it is or time is up.

    Parameters
    ----------
    charge : Charge

    Returns
    -------
    SafeResult
        Never raises: what went wrong is in its steps.
    """
    steps: list[str] = []
    give_up_s = time.monotonic() + charge.retry_s
    while True:
        try:
            chamber = open_chamber(charge.chamber)
            try:
                result = chamber.make_safe(charge.safe_temp_c)
            finally:
                chamber.close()
            if result.verified:
                return SafeResult(verified=True, steps=(*steps, *result.steps))
            line = "; ".join(("not verified", *result.steps))
        except Exception as err:
            line = " ".join(str(err).split()) or type(err).__name__
        if not steps or steps[-1] != line:  # ten minutes of one complaint are one line
            steps.append(line)
        if time.monotonic() >= give_up_s:
            return SafeResult(verified=False, steps=tuple(steps))
        time.sleep(PAUSE_S)


def write_result(charge: Charge, result: SafeResult, why: str) -> None:
    """Leave the result in its file, whole or not at all."""
    path = charge.result_path
    text = json.dumps(
        {
            "why": why,
            "verified": result.verified,
            "steps": list(result.steps),
            "chamber": charge.chamber.url,
            "safe_temp_c": charge.safe_temp_c,
            "utc": time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime()),
        },
        ensure_ascii=False,
    )
    draft = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    with draft.open("w", encoding="utf-8") as file:
        file.write(text + "\n")
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)


def wait_for_end(pipe: int, parent: int) -> bool:
    """Wait until the controller says that it is done, or is gone.

    The parent is looked at as well: should another process have inherited the pipe's end, the
    pipe would outlive the controller.

    Returns
    -------
    bool
        True when it said so.
    """
    said = b""
    while True:
        ready, _, _ = select.select([pipe], [], [], LOOK_S)
        if ready:
            piece = os.read(pipe, 4096)
            said += piece
            if DONE in said:
                return True
            if not piece:
                return False
        elif os.getppid() != parent:
            return False


def main() -> int:
    """Watch over one controller; the charge comes on standard input.

    Returns
    -------
    int
        0 when nothing was left to do or the chamber is safe, 1 when it could not be made so.
    """
    for number in DEAF_TO:
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(level=logging.ERROR)
    parent = os.getppid()
    line = bytearray()
    while not line.endswith(b"\n"):  # unbuffered: what follows the line belongs to `select`
        byte = os.read(0, 1)
        if not byte:
            return 0  # the controller went before it had begun anything
        line += byte
    charge = Charge.parse(line.decode())
    try:
        fcntl.flock(open_lock(charge.chamber.url), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.write(1, f"{BUSY}\n".encode())
        return 1
    os.write(1, f"{READY}\n".encode())
    if wait_for_end(0, parent):
        return 0
    result = make_safe(charge)
    write_result(charge, result, "the controller was gone without having made the chamber safe")
    return 0 if result.verified else 1


if __name__ == "__main__":
    sys.exit(main())
