"""Recorded runs with a model applied, as files: `accelbench compensate` in Python."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.arrays import rms
from errormodel.errors import InputError
from errormodel.io.table_write import write_with_sidecar
from errormodel.io.tables import column_names
from thermo.compensation.compensate import Compensated, compensate
from thermo.compensation.model_file import AccelerometerModel, ModelFile, read_model
from thermo.recording.files import RecordedRuns, read_runs
from thermo.recording.write import sidecar_text
from thermo.selection.residuals import constants_only_ug

ADDED = ("accel_g", "accel_compensated_g", "accel_sigma_g")
OUTSIDE = ("outside_range", "outside_rate", "outside_input")


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
    outside_rate, outside_input : int
        Readings whose rate of temperature, or whose force, it does not cover.
    error_before_ug, error_after_ug : float or None
        rms of the good readings against the known input, µg: with constants only (K0 and K1 of
        these readings, as `fit` has it), and compensated; None when the input is not known.
    sigma_ug : float
        rms of the sigmas of the good readings, µg.
    left_in_ug : float or None
        What misalignment and cross-coupling may leave in where the position is not known, µg.
    run_to_run_known : bool
        Whether the sigmas allow for how runs differ: not when the model is of one run.
    scale_left_ug : float or None
        What each per cent by which K1 is not nominal leaves in at another gravity than the fit's,
        µg: one position cannot give K1, and K0 holds what it is off. None where K1 was fitted.
    """

    serial: str
    n: int
    outside_range: int
    outside_rate: int
    outside_input: int
    error_before_ug: float | None
    error_after_ug: float | None
    sigma_ug: float
    left_in_ug: float | None
    run_to_run_known: bool
    scale_left_ug: float | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CompensatedFile:
    """Compensated recording, as written."""

    runs: RecordedRuns
    models: ModelFile
    values: Compensated
    channels: tuple[CompensatedChannel, ...]


def compensate_files(
    paths: Sequence[Path | str], model: Path | str, out: Path | str, *, trust_units: bool = False
) -> CompensatedFile:
    """Apply a model file to recorded runs and write them with three columns more.

    `out` (CSV, or Parquet by its suffix) has the columns of the recording, `accel_g` (output over
    the nominal scale), `accel_compensated_g` and `accel_sigma_g`; readings whose temperature, rate
    or force the model does not cover are flagged "outside_range", "outside_rate" and
    "outside_input". Its sidecar stands beside it.

    Parameters
    ----------
    paths : sequence of path
        Recorded runs.
    model : path
        Model file.
    out : path
        What to write; replaced when it exists.
    trust_units : bool
        As for `thermo.recording.files.read_runs`.

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
        channels=tuple(_channel(runs, values, models.of(s)) for s in runs.serials),
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
    """Return a recording's table with the compensated columns and the flags added to."""
    frame = runs.frame()
    flags = runs.flag.text()
    for name in OUTSIDE:
        marked = np.where(flags == "", name, flags + "+" + name)
        flags = np.where(getattr(values, name), marked, flags)
    frame = frame.drop(columns=["flag"], errors="ignore")
    for name in ADDED:
        frame[name] = getattr(values, name)
    frame["flag"] = flags
    return frame


def _channel(
    runs: RecordedRuns, values: Compensated, model: AccelerometerModel
) -> CompensatedChannel:
    mine = runs.serial.codes == runs.serials.index(model.serial)
    done = mine & np.isfinite(values.accel_compensated_g)
    before = after = None
    good = done & runs.good
    known = bool(np.all(np.isfinite(runs.position_deg[good]) | np.isfinite(runs.a_g[good, 0])))
    if known and good.any():
        force = runs.take(good).specific_force_g[:, 0]
        before = rms(constants_only_ug(values.accel_g[good], force))
        after = 1e6 * rms(values.accel_compensated_g[good] - force)
    return CompensatedChannel(
        serial=model.serial,
        n=int(done.sum()),
        outside_range=int((done & values.outside_range).sum()),
        outside_rate=int((done & values.outside_rate).sum()),
        outside_input=int((done & values.outside_input).sum()),
        error_before_ug=before,
        error_after_ug=after,
        sigma_ug=1e6 * rms(values.accel_sigma_g[good]) if good.any() else 0.0,
        left_in_ug=None if known else _left_in_ug(model),
        run_to_run_known=model.run_to_run is not None,
        scale_left_ug=_scale_left_ug(runs.take(np.flatnonzero(mine)).gravity_m_s2, model),
    )


def _scale_left_ug(gravity_m_s2: float, model: AccelerometerModel) -> float | None:
    """Return what K0 has of one per cent of K1 at the fit's site and not here, at 1 g, µg.

    An output of K1·(K0 + a) at the fit's site, in whose g everything is, is taken for
    N·(K0' + a), N nominal: K0' holds (K1/N − 1)·a. Where gravity is ρ times that, it lacks
    (K1/N − 1)·a·(ρ − 1), of a local a·ρ.
    """
    if not model.has_input or "k1" in model.names:
        return None
    return 1e4 * abs(1.0 - model.gravity_m_s2 / gravity_m_s2)


def _left_in_ug(model: AccelerometerModel) -> float:
    """Return the most that terms of the unknown cross forces leave in, within 1 g, µg."""
    most = {"delta_o": 1.0, "delta_p": 1.0, "k_ip": 0.5, "k_io": 0.5}
    found = model.coefficients
    return sum(share * abs(found[n].value) for n, share in most.items() if n in found)
