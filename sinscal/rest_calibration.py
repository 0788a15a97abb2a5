"""From a recording with rests in many positions to a calibrated triad."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.intervals import RestIntervals, find_intervals, what_is_missing
from sinscal.plain_log import read_plain_log, step_of
from sinscal.recording import read_rig_run
from sinscal.triad import Gauge, TriadFit, fit_triad
from sinscal.triad_model import parameter_names

Unit: TypeAlias = Literal["count", "m/s2", "g", "V", "mA"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rests:
    """Readings of a triad over time, and what else tells motion from rest.

    Attributes
    ----------
    accel : ndarray, shape (n, 3)
        Raw, in `unit`.
    others : ndarray, shape (n, c)
        Gyros, when there are any: they only say where it is at rest.
    temp_c : ndarray, shape (n,), optional
    step_s : float
    gravity_m_s2 : float
    unit : str
    source : str
    """

    accel: FloatArray
    others: FloatArray
    step_s: float
    gravity_m_s2: float
    unit: Unit
    source: str
    temp_c: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RestCalibration:
    """A triad calibrated at rest.

    `before_m_s2` is |f| − g of each position with nominal readings; of counts and voltages, with
    one scale for all axes and the biases taken off.
    """

    rests: Rests
    intervals: RestIntervals
    fit: TriadFit
    before_m_s2: FloatArray
    forces: FloatArray


def rests_of_run(path: Path | str, gravity_m_s2: float | None = None) -> Rests:
    """Read a recorded rig run; gravity is that of its site if not given.

    Gyros need not agree with the forces here: they only tell rest from motion.
    """
    run = read_rig_run(path, physics=False)
    return Rests(
        accel=run.accel,
        others=run.gyro,
        temp_c=None if run.temp_c is None else np.mean(run.temp_c, axis=1),
        step_s=float(np.median(run.step_s)),
        gravity_m_s2=gravity_m_s2 or run.facts.site.gravity_m_s2,
        unit="m/s2",
        source=str(path),
    )


def rests_of_log(
    path: Path | str,
    columns: tuple[str, str, str],
    *,
    gravity_m_s2: float,
    step_s: float | None = None,
    time_column: str | None = None,
    unit: Unit = "count",
) -> Rests:
    """Read a plain log: three columns of readings, and its step or a column of times, s.

    Raises
    ------
    InputError
        If a column is missing, a cell is no number, or neither step nor times are given.
    """
    wanted = columns if time_column is None else (*columns, time_column)
    values = read_plain_log(path, wanted)
    if time_column is not None:
        step_s = step_of(values[:, 3], str(path))
    if step_s is None:
        raise InputError(path, "", "expected its rate, or a column of times")
    return Rests(
        accel=values[:, :3],
        others=np.empty((values.shape[0], 0)),
        step_s=step_s,
        gravity_m_s2=gravity_m_s2,
        unit=unit,
        source=str(path),
    )


def calibrate_at_rest(
    rests: Rests, *, gauge: Gauge = "lower", with_temperature: bool = False
) -> RestCalibration:
    """Find the rests and fit the triad.

    Raises
    ------
    InputError
        If there are too few rests; it says what the recording lacks.
    NotSeparableError
        If the positions cannot tell the unknowns apart.
    """
    found = find_intervals(
        np.hstack([rests.accel, rests.others]), rests.step_s, source=rests.source
    )
    if missing := what_is_missing(found, len(parameter_names(gauge, with_temperature))):
        raise InputError(rests.source, "", missing)
    temp_c = None
    if with_temperature:
        if rests.temp_c is None:
            raise InputError(rests.source, "", "no temperature recorded, expected temp_c")
        temp_c = found.means_of(rests.temp_c[:, None])[:, 0]
    means = found.means[:, :3]
    fit = fit_triad(
        means,
        found.rows,
        found.noise[:3],
        rests.gravity_m_s2,
        gauge=gauge,
        temp_c=temp_c,
        source=rests.source,
    )
    warm = 0.0 if temp_c is None else temp_c - float(np.mean(temp_c))
    return RestCalibration(
        rests=rests,
        intervals=found,
        fit=fit,
        before_m_s2=_before(rests, means, fit),
        forces=fit.model.apply(means, warm),
    )


def _before(rests: Rests, means: FloatArray, fit: TriadFit) -> FloatArray:
    nominal = {"m/s2": 1.0, "g": rests.gravity_m_s2}.get(rests.unit)
    if nominal is not None:
        return nominal * np.linalg.norm(means, axis=1) - rests.gravity_m_s2
    size: FloatArray = np.linalg.norm(means - fit.model.bias, axis=1)
    return rests.gravity_m_s2 * (size / float(np.mean(size)) - 1.0)
