"""Characterise accelerometers over temperature and calibrate the SINS made of them.

Every command of the program has its twin here, and `accelbench.rig` holds those of `accelbench
rig`. Nothing is imported before it is asked for::

    import accelbench as ab

    runs = ab.read_runs(["run.csv"])
    model = ab.fit(runs)
    model.to_dataframe()
    model.plot()[0]
"""

import importlib
from typing import TYPE_CHECKING, Any

from accelbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from accelbench import rig
    from accelbench.api import combine, compensate, discrepancy, fit, foresee, runin, stability
    from accelbench.result import Result
    from accelbench.shell.library import library
    from errormodel.errors import InputError, NotSeparableError, WorkbenchError
    from errormodel.model import ErrorModel
    from thermo.compensation.model_file import ModelFile, read_model
    from thermo.fitting.terms_wanted import TermsFile, read_terms
    from thermo.launch.emulated import run_emulated
    from thermo.launch.make_safe import make_station_safe
    from thermo.launch.real import load_station, run_on_station
    from thermo.planning.plan import make_plan
    from thermo.planning.sequence import load_sequence
    from thermo.recording.files import RecordedRuns, join_runs, make_runs, read_runs
    from thermo.recording.foreign.read import import_log
    from thermo.recording.write import write_runs
    from thermo.station.job import make_job, make_resumed_job
    from thermo.store.files import open_existing_store, stored_runs

__all__ = [
    "ErrorModel",
    "InputError",
    "ModelFile",
    "NotSeparableError",
    "RecordedRuns",
    "Result",
    "TermsFile",
    "WorkbenchError",
    "combine",
    "compensate",
    "discrepancy",
    "fit",
    "foresee",
    "import_log",
    "join_runs",
    "library",
    "load_sequence",
    "load_station",
    "make_job",
    "make_plan",
    "make_resumed_job",
    "make_runs",
    "make_station_safe",
    "open_existing_store",
    "read_model",
    "read_runs",
    "read_terms",
    "rig",
    "run_emulated",
    "run_on_station",
    "runin",
    "stability",
    "stored_runs",
    "write_runs",
]

_HOMES = {
    "accelbench.api": (
        "combine", "compensate", "discrepancy", "fit", "foresee", "runin", "stability",
    ),
    "accelbench.result": ("Result",),
    "accelbench.shell.library": ("library",),
    "errormodel.errors": ("InputError", "NotSeparableError", "WorkbenchError"),
    "errormodel.model": ("ErrorModel",),
    "thermo.compensation.model_file": ("ModelFile", "read_model"),
    "thermo.fitting.terms_wanted": ("TermsFile", "read_terms"),
    "thermo.launch.emulated": ("run_emulated",),
    "thermo.launch.make_safe": ("make_station_safe",),
    "thermo.launch.real": ("load_station", "run_on_station"),
    "thermo.planning.plan": ("make_plan",),
    "thermo.planning.sequence": ("load_sequence",),
    "thermo.recording.files": ("RecordedRuns", "join_runs", "make_runs", "read_runs"),
    "thermo.recording.foreign.read": ("import_log",),
    "thermo.recording.write": ("write_runs",),
    "thermo.station.job": ("make_job", "make_resumed_job"),
    "thermo.store.files": ("open_existing_store", "stored_runs"),
}  # fmt: skip
_get = lazy_names("accelbench", {name: home for home, names in _HOMES.items() for name in names})


def __getattr__(name: str) -> Any:
    """Import a name when it is first asked for."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("accelbench")
        except PackageNotFoundError:
            return "unknown"
    return importlib.import_module("accelbench.rig") if name == "rig" else _get(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
