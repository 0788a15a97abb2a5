"""What a guardian leaves in a file, and what a test leaves behind on a chamber it commands.

A record is made at its full size before the chamber is commanded and written in place afterwards,
two slots in turn, each with a checksum: a full disk loses no word of it, and a write that is torn
leaves the one before.
"""

import contextlib
import json
import os
import tempfile
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import sqlalchemy as sa

from drivers.station import ChamberConfig
from thermo.chamber_lock import lock_names
from thermo.processes import is_alive, process_start

SLOT_BYTES = 4096
STEP_CHARACTERS = 300  # of one step; the longest result has to fit into a slot
MAX_STEPS = 8
SUFFIX = ".guardian.json"

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
        """Whether somebody should go and see to the chamber."""
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
        why = "the guardian died with its controller; nobody has made the chamber safe since"
    steps = "; ".join(str(step) for step in newest["steps"])
    still = (
        f", process {pid} goes on trying" if alive and phase in ("taking over", "trying") else ""
    )
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


def state_folder() -> Path:
    """Return the user's folder for what must outlive a process; it is made."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    folder = Path(state) / "accelbench"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        folder = Path(tempfile.gettempdir())
    return folder


def _store_file(store_url: str | Path) -> Path | None:
    """Return the file of an SQLite store; None for a store on a server."""
    text = str(store_url)
    if "://" in text and not text.startswith("sqlite"):
        return None
    database = sa.make_url(text).database if text.startswith("sqlite:") else text
    return Path(database or "store")


def result_file(store_url: str | Path, test_id: str) -> Path:
    """Return where the guardian of a test leaves its result.

    Beside an SQLite store; for a store on a server in the user's state directory.
    """
    store = _store_file(store_url)
    if store is None:
        return state_folder() / f"{test_id}{SUFFIX}"
    return store.with_name(f"{store.name}.{test_id}{SUFFIX}")


def pending_results(store_url: str | Path) -> tuple[GuardianRecord, ...]:
    """Return what guardians have left for a store and what is not entered into it yet.

    Parameters
    ----------
    store_url : str or path
        For a store on a server the results of every such store of the user are returned; match
        their `test_id`.

    Returns
    -------
    tuple of GuardianRecord
        By test id; those of a healthy running test are left out.
    """
    store = _store_file(store_url)
    folder, prefix = (state_folder(), "") if store is None else (store.parent, f"{store.name}.")
    found: list[GuardianRecord] = []
    with contextlib.suppress(OSError):
        for path in sorted(folder.iterdir()):
            if path.name.startswith(prefix) and path.name.endswith(SUFFIX):
                test_id = path.name[len(prefix) : -len(SUFFIX)]
                record = read_record(path, test_id)
                if record is not None and not (record.phase == "watching" and record.alive):
                    found.append(record)
    return tuple(found)


# ---- a chamber that a test commands


@dataclass(frozen=True, slots=True, kw_only=True)
class Commanded:
    """What a test notes before its first command and takes back when the chamber is safe."""

    chamber_url: str
    test_id: str
    recognition: Mapping[str, float | str]
    guardian_pid: int = 0
    guardian_start: int | None = None


def note_commanded(config: ChamberConfig, note: Commanded) -> None:
    """Note that a test commands a chamber, for whoever finds it left behind.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path = _commanded_path(config)
    text = json.dumps(
        {
            "chamber": note.chamber_url,
            "test_id": note.test_id,
            "recognition": dict(note.recognition),
            "guardian_pid": note.guardian_pid,
            "guardian_start": note.guardian_start,
        }
    )
    draft = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    draft.write_text(text + "\n", encoding="utf-8")
    draft.replace(path)


def read_commanded(config: ChamberConfig) -> Commanded | None:
    """Return what a test of this user has left behind on a chamber; None when there is nothing."""
    path = _commanded_path(config)
    try:
        if path.stat().st_uid not in (os.getuid(), 0):
            return None  # what somebody else put there is no evidence
        data: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return Commanded(
            chamber_url=str(data["chamber"]),
            test_id=str(data["test_id"]),
            recognition=dict(data["recognition"]),
            guardian_pid=int(data["guardian_pid"]),
            guardian_start=data["guardian_start"],
        )
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        return Commanded(chamber_url=config.url, test_id="", recognition={})


def forget_commanded(config: ChamberConfig) -> None:
    """Take the note back: the chamber is safe."""
    with contextlib.suppress(OSError):
        _commanded_path(config).unlink(missing_ok=True)


def _commanded_path(config: ChamberConfig) -> Path:
    name = lock_names(config)[0].rpartition("-")[2]
    return state_folder() / f"chamber-{name}.json"
