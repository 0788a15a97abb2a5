"""Calibration of a SINS on a rig: the twins of the commands of `accelbench rig`."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from accelbench.rig.api import calibrate, covariance, discrepancy, flight, simulate, triad
    from sinscal.judgement.judge import Options
    from sinscal.judgement.result_file import read_result
    from sinscal.model.compensate import compensate_run as compensate
    from sinscal.recording.files import read_nav_run, write_rig_run
    from sinscal.recording.files import read_rig_run as read_run
    from sinscal.twin.rig_file import read_rig_file as read_programme

__all__ = [
    "Options",
    "calibrate",
    "compensate",
    "covariance",
    "discrepancy",
    "flight",
    "read_nav_run",
    "read_programme",
    "read_result",
    "read_run",
    "simulate",
    "triad",
    "write_rig_run",
]

_HOMES = {
    "Options": ("sinscal.judgement.judge", "Options"),
    "calibrate": ("accelbench.rig.api", "calibrate"),
    "compensate": ("sinscal.model.compensate", "compensate_run"),
    "covariance": ("accelbench.rig.api", "covariance"),
    "discrepancy": ("accelbench.rig.api", "discrepancy"),
    "flight": ("accelbench.rig.api", "flight"),
    "read_nav_run": ("sinscal.recording.files", "read_nav_run"),
    "read_programme": ("sinscal.twin.rig_file", "read_rig_file"),
    "read_result": ("sinscal.judgement.result_file", "read_result"),
    "read_run": ("sinscal.recording.files", "read_rig_run"),
    "simulate": ("accelbench.rig.api", "simulate"),
    "triad": ("accelbench.rig.api", "triad"),
    "write_rig_run": ("sinscal.recording.files", "write_rig_run"),
}


def __getattr__(name: str) -> Any:
    """Import a name when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module 'accelbench.rig' has no attribute {name!r}")
    home, attribute = _HOMES[name]
    return getattr(importlib.import_module(home), attribute)


def __dir__() -> list[str]:
    return list(__all__)
