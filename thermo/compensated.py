"""Recorded runs with a model applied, as files: `accelbench compensate` in Python."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.table_write import write_with_sidecar
from errormodel.tables import column_names
from thermo.compensation import Compensated, compensate
from thermo.modelfile import ModelFile, read_model
from thermo.recording import RecordedRuns, read_runs
from thermo.recording_write import sidecar_text

ADDED = ("accel_g", "accel_compensated_g")
OUTSIDE = "outside_range"


@dataclass(frozen=True, slots=True, kw_only=True)
class CompensatedChannel:
    """One accelerometer in a compensated recording.

    Attributes
    ----------
    serial : str
    n : int
        Readings compensated.
    outside_range : int
        Of these, readings whose temperature the model does not cover.
    error_before_ug, error_after_ug : float or None
        rms of the good readings against the known input, before and after, µg; None when the
        input is not known.
    """

    serial: str
    n: int
    outside_range: int
    error_before_ug: float | None
    error_after_ug: float | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CompensatedFile:
    """What was compensated and written."""

    runs: RecordedRuns
    models: ModelFile
    values: Compensated
    channels: tuple[CompensatedChannel, ...]


def compensate_files(
    paths: Sequence[Path | str], model: Path | str, out: Path | str, *, trust_units: bool = False
) -> CompensatedFile:
    """Apply a model file to recorded runs and write them with two columns more.

    `out` (CSV, or Parquet by its suffix) has the columns of the recording, `accel_g` (output over
    the nominal scale) and `accel_compensated_g`; readings whose temperature the model does not
    cover are flagged "outside_range". Its sidecar stands beside it.

    Parameters
    ----------
    paths : sequence of path
        Recorded runs.
    model : path
        Model file.
    out : path
        What to write; replaced when it exists.
    trust_units : bool
        As for `thermo.recording.read_runs`.

    Returns
    -------
    CompensatedFile

    Raises
    ------
    InputError
        If a file is not what it should be or is compensated already, or an accelerometer has no
        model or another unit; nothing was written then.
    """
    for path in paths:
        refuse_compensated(Path(path))
    models = read_model(model)
    runs = read_runs(paths, trust_units=trust_units)
    known = [a.serial for a in models.accelerometers]
    for serial in runs.serials:
        if serial not in known:
            problem = f"no model for serial {serial!r}; expected one of {', '.join(known):.200}"
            raise InputError(model, "accelerometers", problem)
    values = compensate(runs, models)
    write_compensated(runs, values, Path(out))
    return CompensatedFile(
        runs=runs,
        models=models,
        values=values,
        channels=tuple(_channel(runs, values, serial) for serial in runs.serials),
    )


def refuse_compensated(path: Path) -> None:
    """Refuse a recording that a model was applied to: twice would be wrong.

    Raises
    ------
    InputError
        If it has the column `accel_compensated_g`.
    """
    try:
        names = column_names(path)
    except InputError:
        return  # the reader says it better
    if ADDED[1] in names:
        problem = f"has {ADDED[1]}: already compensated, expected a recording as measured"
        raise InputError(path, "header", problem)


def write_compensated(runs: RecordedRuns, values: Compensated, path: Path) -> None:
    """Write a compensated recording and its sidecar, both or none.

    Raises
    ------
    InputError
        If the suffix is neither .csv nor .parquet, or the files cannot be written.
    """
    write_with_sidecar(compensated_frame(runs, values), sidecar_text(runs), path)


def compensated_frame(runs: RecordedRuns, values: Compensated) -> pd.DataFrame:
    """Return a recording's table with `accel_g`, `accel_compensated_g` and the flags added to."""
    frame = runs.frame()
    flags = runs.flag.text()
    marked = np.where(flags == "", OUTSIDE, flags + "+" + OUTSIDE)
    flags = np.where(values.outside_range, marked, flags)
    frame = frame.drop(columns=["flag"], errors="ignore")
    frame[ADDED[0]] = values.accel_g
    frame[ADDED[1]] = values.accel_compensated_g
    frame["flag"] = flags
    return frame


def _channel(runs: RecordedRuns, values: Compensated, serial: str) -> CompensatedChannel:
    mine = runs.serial.codes == runs.serials.index(serial)
    done = mine & np.isfinite(values.accel_compensated_g)
    before = after = None
    good = done & runs.good
    if runs.has_input and good.any():
        force = runs.specific_force_g[good, 0]
        before = _rms_ug(values.accel_g[good] - force)
        after = _rms_ug(values.accel_compensated_g[good] - force)
    return CompensatedChannel(
        serial=serial,
        n=int(done.sum()),
        outside_range=int((done & values.outside_range).sum()),
        error_before_ug=before,
        error_after_ug=after,
    )


def _rms_ug(values: FloatArray) -> float:
    return 1e6 * float(np.sqrt(np.mean(values**2)))
