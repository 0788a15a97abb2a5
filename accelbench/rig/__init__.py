"""Calibration of a SINS on a rig: the twins of the commands of `accelbench rig`."""

from typing import TYPE_CHECKING

from accelbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from accelbench.rig.api import calibrate, covariance, discrepancy, flight, simulate, triad
    from sinscal.judgement.options import Options
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

__getattr__ = lazy_names("accelbench.rig", {
    "Options": "sinscal.judgement.options",
    "calibrate": "accelbench.rig.api",
    "compensate": "sinscal.model.compensate:compensate_run",
    "covariance": "accelbench.rig.api",
    "discrepancy": "accelbench.rig.api",
    "flight": "accelbench.rig.api",
    "read_nav_run": "sinscal.recording.files",
    "read_programme": "sinscal.twin.rig_file:read_rig_file",
    "read_result": "sinscal.judgement.result_file",
    "read_run": "sinscal.recording.files:read_rig_run",
    "simulate": "accelbench.rig.api",
    "triad": "accelbench.rig.api",
    "write_rig_run": "sinscal.recording.files",
})  # fmt: skip


def __dir__() -> list[str]:
    return list(__all__)
