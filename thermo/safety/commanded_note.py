"""The note that a test commands a chamber: written before its first command, taken back when safe.

Whoever finds it knows that the chamber was left behind, and by what its controller was recognised.
"""

import contextlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.station import ChamberConfig
from errormodel.io.atomic import replace_file
from thermo.safety.chamber_lock import lock_names


def state_folder() -> Path:
    """Return the user's folder for what must outlive a process; it is made."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    folder = Path(state) / "accelbench"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        folder = Path(tempfile.gettempdir())
    return folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Commanded:
    """Note that a test writes before its first command and takes back when the chamber is safe."""

    chamber_url: str
    test_id: str
    recognition: Mapping[str, float | str]
    guardian_pid: int = 0
    guardian_start: int | None = None
    result_path: Path | None = None


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
            "result_path": None if note.result_path is None else str(note.result_path),
        }
    )
    replace_file(path, (text + "\n").encode())


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
            result_path=None if data["result_path"] is None else Path(data["result_path"]),
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
