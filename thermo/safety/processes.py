"""Whose a process is, whether it lives, and since when: what /proc tells."""

import os
import pwd
from pathlib import Path


def process_start(pid: int) -> int | None:
    """Return when a process began, in clock ticks since boot; None when it is gone.

    With its number it names a process for good: numbers are given out anew.
    """
    fields = _fields(pid)
    return None if fields is None or fields[0] in "ZXx" else int(fields[19])


def is_alive(pid: int, start: int | None) -> bool:
    """Return True if the process that had this number and this beginning still lives."""
    return start is not None and pid > 0 and process_start(pid) == start


def process_state(pid: int, uid: int | None = None) -> tuple[str, float | None]:
    """Return whether a process "runs", is "stopped" or "gone", and its age, s.

    Parameters
    ----------
    pid : int
    uid : int, optional
        Whose it must be; the number of another user's process is one that was given out anew.

    Returns
    -------
    str, float or None
        ("", None) when the system does not say.
    """
    if pid <= 0:
        return "", None
    fields = _fields(pid)
    if fields is None:
        return _state_by_signal(pid), None
    try:
        owner = Path(f"/proc/{pid}").stat().st_uid
        uptime_s = float(Path("/proc/uptime").read_text(encoding="utf-8").split()[0])
    except (OSError, ValueError):
        return _state_by_signal(pid), None
    age_s = uptime_s - int(fields[19]) / os.sysconf("SC_CLK_TCK")
    if fields[0] in "ZXx" or (uid is not None and owner not in (uid, 0)):
        return "gone", None
    return ("stopped" if fields[0] in "Tt" else "runs"), max(0.0, age_s)


def _state_by_signal(pid: int) -> str:
    """Ask by signal 0: another user's process may be hidden in /proc."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return "gone"
    except OSError:
        return "runs"
    return "runs"


def user_name(uid: int) -> str:
    """Return a user's name, or the number where there is none."""
    try:
        return pwd.getpwuid(uid).pw_name
    except (KeyError, OSError):
        return f"user {uid}"


def _fields(pid: int) -> list[str] | None:
    """Return what stands behind the name in /proc/PID/stat: state first, beginning twentieth."""
    try:
        line = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    fields = line.rpartition(")")[2].split()
    return fields if len(fields) > 19 and fields[19].isdigit() else None
