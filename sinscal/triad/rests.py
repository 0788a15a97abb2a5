"""From a recording with rests in many positions to a calibrated triad."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.errors import InputError
from errormodel.io.time_units import time_complaint
from errormodel.statistics.outliers import HALF_WINDOWS, OVERLOAD, smallest_step, stray_values
from errormodel.statistics.robust import running_median
from sinscal.recording.files import read_rig_run
from sinscal.triad.intervals import RestIntervals, find_intervals, what_is_missing
from sinscal.triad.model import parameter_names
from sinscal.triad.plain_log import read_plain_log, step_of
from sinscal.triad.triad import Gauge, TriadFit, fit_triad

LONG_STEP_S, TYPICAL_STEP_S = 1.0, 0.01
SCALE_RANGE = (0.5, 2.0)  # of nominal; no accelerometer is made so badly
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
    doubt : str
        What makes the unit of its times doubtful; empty when nothing does.
    mean_sigma : float, optional
        Where each row is the mean over a position: its sigma, in `unit`; 0 when not known.
    """

    accel: FloatArray
    others: FloatArray
    step_s: float
    gravity_m_s2: float
    unit: Unit
    source: str
    temp_c: FloatArray | None = None
    doubt: str = ""
    mean_sigma: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RestCalibration:
    """A triad calibrated at rest.

    `before_m_s2` is |f| − g of each position with nominal readings; of counts and voltages, with
    one scale for all axes and the biases taken off. `left_out` are the rows of single readings
    that no accelerometer gives, `doubts` sentences on times and units that are unlikely.
    """

    rests: Rests
    intervals: RestIntervals
    fit: TriadFit
    before_m_s2: FloatArray
    forces: FloatArray
    left_out: IntArray
    doubts: tuple[str, ...]


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
    doubt = ""
    if time_column is not None:
        step_s = step_of(values[:, 3], str(path))
        doubt = time_complaint(np.diff(values[:, 3]), LONG_STEP_S, TYPICAL_STEP_S, time_column)
    if step_s is None:
        raise InputError(path, "", "expected its rate, or a column of times")
    return Rests(
        accel=values[:, :3],
        others=np.empty((values.shape[0], 0)),
        step_s=step_s,
        gravity_m_s2=gravity_m_s2,
        unit=unit,
        source=str(path),
        doubt=doubt,
    )


def rests_of_means(
    path: Path | str,
    columns: tuple[str, str, str],
    *,
    gravity_m_s2: float,
    unit: Unit = "count",
    sigma: float = 0.0,
) -> Rests:
    """Read a table with a position a row: the mean reading of each axis over it.

    Parameters
    ----------
    path : path
    columns : tuple of str
    gravity_m_s2 : float
    unit : str
    sigma : float
        Of a mean, in `unit`; when it is 0, what the positions differ by tells it.

    Raises
    ------
    InputError
        If a column is missing or a cell is no number.
    """
    accel = read_plain_log(path, columns)
    return Rests(
        accel=accel,
        others=np.empty((accel.shape[0], 0)),
        step_s=0.0,
        gravity_m_s2=gravity_m_s2,
        unit=unit,
        source=str(path),
        mean_sigma=sigma,
    )


def calibrate_at_rest(
    rests: Rests,
    *,
    gauge: Gauge = "lower",
    with_temperature: bool = False,
    trust_units: bool = False,
) -> RestCalibration:
    """Find the rests and fit the triad.

    Single readings that leave their neighbours and come back are left out.

    Parameters
    ----------
    rests : Rests
    gauge : str
        As for `fit_triad`.
    with_temperature : bool
    trust_units : bool
        Whether times and units are taken as stated, however unlikely.

    Raises
    ------
    InputError
        If there are too few rests, with what the recording lacks; if times or units are doubtful.
    NotSeparableError
        If the positions cannot tell the unknowns apart.
    """
    if rests.doubt and not trust_units:
        raise _doubtful(rests.source, rests.doubt)
    found, spoiled = _intervals(rests)
    needed = len(parameter_names(gauge, with_temperature))
    if missing := what_is_missing(found, needed):
        raise InputError(rests.source, "", missing)
    if rests.mean_sigma == 0 and len(found) == needed:
        problem = (
            f"{needed} means for {needed} unknowns: their sigma cannot be estimated, give it "
            f"with --sigma"
        )
        raise InputError(rests.source, "", problem)
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
        mean_sigma=found.digit_sigma[:3],
        source=rests.source,
    )
    doubts = [d for d in (rests.doubt, scale_complaint(fit, rests)) if d]
    if doubts and not trust_units:
        raise _doubtful(rests.source, doubts[0])
    warm = 0.0 if temp_c is None else temp_c - float(np.mean(temp_c))
    return RestCalibration(
        rests=rests,
        intervals=found,
        fit=fit,
        before_m_s2=_before(rests, means, fit),
        forces=fit.model.apply(means, warm),
        left_out=spoiled,
        doubts=tuple(doubts),
    )


def _doubtful(source: str, doubt: str) -> InputError:
    return InputError(source, "", f"{doubt} (--trust-units accepts them as stated)")


def _intervals(rests: Rests) -> tuple[RestIntervals, IntArray]:
    """Return the rests, and which rows are left out there as no readings."""
    if rests.mean_sigma is not None:
        return _of_means(rests, rests.mean_sigma), np.zeros(0, dtype=np.intp)
    values = np.hstack([rests.accel, rests.others])
    spoiled = np.zeros(len(values), dtype=np.bool_)
    for column in values.T:  # the median of its neighbours stands in for a reading left out
        none = np.abs(column) >= OVERLOAD
        if none.all():
            raise InputError(rests.source, "", "a column has only overloads")
        column[none] = np.median(column[~none])
        bad = none | stray_values(column, smallest_step(column))
        column[bad] = running_median(column, max(HALF_WINDOWS))[bad]
        spoiled |= bad
    found = find_intervals(values, rests.step_s, source=rests.source)
    at_rest = np.zeros(len(values), dtype=np.bool_)
    for first, last in zip(found.first, found.last, strict=True):
        at_rest[first : last + 1] = True
    return found, np.flatnonzero(spoiled & at_rest)


def _of_means(rests: Rests, sigma: float) -> RestIntervals:
    """Return each row as a rest; of no known sigma, a negligible one: the scatter tells it."""
    rows: IntArray = np.arange(len(rests.accel), dtype=np.intp)
    negligible = 1e-9 * float(np.ptp(rests.accel))
    return RestIntervals(
        first=rows,
        last=rows,
        means=rests.accel,
        noise=np.full(3, sigma or negligible),
        digit=np.zeros(3),
        digit_sigma=np.zeros(3),
        step_s=0.0,
        too_short=0,
        total_s=0.0,
    )


def scale_complaint(fit: TriadFit, rests: Rests) -> str:
    """Return what makes the unit of the readings doubtful; empty when nothing does."""
    nominal = {"m/s2": 1.0, "g": rests.gravity_m_s2}.get(rests.unit)
    if nominal is None:
        return ""
    ratio = float(np.median(fit.values[:3])) / nominal
    if SCALE_RANGE[0] <= ratio <= SCALE_RANGE[1]:
        return ""
    guesses = {
        "are they in g?": rests.gravity_m_s2,
        "are they in m/s²?": 1 / rests.gravity_m_s2,
        f"are they in thousandths of {rests.unit}?": 1e-3,
        f"are they in millionths of {rests.unit}?": 1e-6,
    }
    near = [words for words, factor in guesses.items() if 0.5 < ratio / factor < 2]
    said = f"a reading of 1 {rests.unit} is {ratio * nominal:.3g} m/s²"
    guess = (
        near[0] if near else f"expected {SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g} times {nominal:g}"
    )
    return f"{said}: {guess}" if near else f"{said}, {guess}"


def _before(rests: Rests, means: FloatArray, fit: TriadFit) -> FloatArray:
    nominal = {"m/s2": 1.0, "g": rests.gravity_m_s2}.get(rests.unit)
    if nominal is not None:
        return nominal * np.linalg.norm(means, axis=1) - rests.gravity_m_s2
    size: FloatArray = np.linalg.norm(means - fit.model.bias, axis=1)
    return rests.gravity_m_s2 * (size / float(np.mean(size)) - 1.0)
