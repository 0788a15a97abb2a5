"""File in which a guardian tells what it does.

A record is made at its full size before the chamber is commanded and written in place afterwards,
two slots in turn, each with a checksum: a full disk loses no word of it, and a write that is torn
leaves the one before.
"""

import json
import os
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from thermo.safety.processes import is_alive, process_start

SLOT_BYTES = 4096
STEP_CHARACTERS = 300  # of one step; the longest result has to fit into a slot
MAX_STEPS = 8

Phase = Literal["watching", "taking over", "trying", "safe"]


class RecordFile:
    """The file of one guardian.

    Parameters
    ----------
    path : Path
    fixed : mapping
        What every entry holds.

    Raises
    ------
    OSError
        If it cannot be made at its full size.
    """

    def __init__(self, path: Path, fixed: Mapping[str, object]) -> None:
        self.path = path
        self._fixed = {
            **fixed,
            "guardian_pid": os.getpid(),
            "guardian_start": process_start(os.getpid()),
        }
        self._sequence = 0
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        # blanks in both slots: whatever was there belongs to another guardian
        blank = b" " * (SLOT_BYTES - 1) + b"\n"
        os.pwrite(self._file, blank * 2, 0)
        os.ftruncate(self._file, 2 * SLOT_BYTES)
        self.write("watching", why="")

    def write(
        self, phase: Phase, *, why: str, verified: bool = False, steps: tuple[str, ...] = ()
    ) -> None:
        """Enter how things are; the entry before stays until this one is on the disk.

        Raises
        ------
        OSError
        """
        self._sequence += 1
        entry: dict[str, object] = {
            **self._fixed,
            "sequence": self._sequence,
            "phase": phase,
            "why": why[:STEP_CHARACTERS],
            "verified": verified,
            "steps": [step[:STEP_CHARACTERS] for step in steps[-MAX_STEPS:]],
            "utc": time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime()),
        }
        line = _sealed(entry)
        while len(line) >= SLOT_BYTES:  # characters of several bytes
            entry["steps"] = [str(step)[: len(str(step)) // 2] for step in entry["steps"]]  # type: ignore[union-attr]
            line = _sealed(entry)
        slot = self._sequence % 2
        os.pwrite(self._file, line.ljust(SLOT_BYTES - 1) + b"\n", slot * SLOT_BYTES)
        os.fsync(self._file)

    def remove(self) -> None:
        """Take the file away: there was nothing to do."""
        self.path.unlink(missing_ok=True)


def _sealed(entry: Mapping[str, object]) -> bytes:
    body = json.dumps(entry, ensure_ascii=False, sort_keys=True)
    return json.dumps({**entry, "crc": zlib.crc32(body.encode())}, ensure_ascii=False).encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardianRecord:
    """The newest whole entry of a guardian's file.

    `needs_help` is True when nobody has made the chamber safe: the guardian still tries, or it is
    dead and never did.
    """

    test_id: str
    path: Path
    phase: str
    verified: bool
    alive: bool
    text: str

    @property
    def needs_help(self) -> bool:
        """True when somebody should go and see to the chamber."""
        return not self.verified and not (self.phase == "watching" and self.alive)


def read_record(path: Path, test_id: str = "") -> GuardianRecord | None:
    """Read a guardian's file; None when there is none."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None
    entries = [e for line in text.splitlines() if (e := _checked(line)) is not None]
    if not entries:
        return GuardianRecord(
            test_id=test_id,
            path=path,
            phase="damaged",
            verified=False,
            alive=False,
            text=f"its result file {path} is damaged",
        )
    newest = max(entries, key=lambda e: int(e.get("sequence", 0)))
    pid, start = int(newest.get("guardian_pid", 0)), newest.get("guardian_start")
    phase, alive = str(newest.get("phase", "")), is_alive(pid, start)
    why = str(newest["why"])
    if phase == "watching" and not alive:
        why = "the guardian died with its controller; the chamber has not been made safe since"
    steps = "; ".join(str(step) for step in newest["steps"])
    still = f", process {pid} keeps trying" if alive and phase in ("taking over", "trying") else ""
    return GuardianRecord(
        test_id=str(newest.get("test_id", test_id)) or test_id,
        path=path,
        phase=phase,
        verified=bool(newest["verified"]),
        alive=alive,
        text=f"{newest['utc']}: {why}{still}" + (f"; {steps}" if steps else ""),
    )


def _checked(line: str) -> dict[str, Any] | None:
    """Return an entry that is whole; None for blanks, a torn one, or anything else."""
    try:
        entry: dict[str, Any] = json.loads(line)
        crc = entry.pop("crc", None)
        body = json.dumps(entry, ensure_ascii=False, sort_keys=True)
        if crc is not None and zlib.crc32(body.encode()) != crc:
            return None
        _ = (
            *(entry[key] for key in ("why", "verified", "utc")),
            list(entry["steps"]),
            int(entry.get("sequence", 0)),
            int(entry.get("guardian_pid", 0)),
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return entry
