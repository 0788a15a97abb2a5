"""Runs in which all accelerometers of a batch moved together: the station, not the accelerometers.

Value of accelerometer a in run r: ``m_a + g_r + b_ar``. What is common, g_r, is a remount, a power
supply, a move of the station; b_ar is the accelerometer's own. A run is named where the shift of
all from their other runs stands out from what the b_ar explain (two-way layout, t test, the most
conspicuous run first), and its shift, as the *other* accelerometers show it, is taken out.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, IntArray
from thermo.stability.runs import RunByRun, RunFit, reported_as

MIN_ACCELEROMETERS = 3
FALSE_EVENT = 0.01  # chance of naming an event in a batch that has none


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonEvent:
    """A run in which a coefficient of all accelerometers moved together.

    `shift` is from their other runs and `sigma` its standard deviation, as reported; `shifts` is
    what is taken out of each accelerometer, by serial number, with its sigma.
    """

    run_id: str
    coefficient: str
    unit: str
    shift: float
    sigma: float
    p_value: float
    shifts: dict[str, tuple[float, float]]

    @property
    def sentence(self) -> str:
        """The event in one line."""
        return (
            f"run {self.run_id}: {self.coefficient} of all {len(self.shifts)} accelerometers "
            f"shifted together by {self.shift:+.3g} ± {self.sigma:.2g} {self.unit} (p = "
            f"{self.p_value:.1g}): station, remount or supply; not counted as their own"
        )


def common_events(batch: Sequence[RunByRun]) -> tuple[CommonEvent, ...]:
    """Find runs that moved all accelerometers alike; none with fewer than three of them."""
    names = dict.fromkeys(n for one in batch for r in one.runs for n in r.fit.names)
    run_ids = list(dict.fromkeys(r.run_id for one in batch for r in one.runs))
    tables = {n: _table(batch, run_ids, n) for n in names}
    alpha = FALSE_EVENT / max(len(run_ids) * len(tables), 1)
    found: list[CommonEvent] = []
    for name, table in tables.items():
        while best := _most_conspicuous(table, range(len(run_ids)), alpha):
            found.append(_taken_out(batch, table, best, run_ids, name))
    # where something happened to one coefficient, fewer questions are asked of the others
    columns = sorted({run_ids.index(e.run_id) for e in found})
    for name, table in tables.items():
        alpha = FALSE_EVENT / max(len(columns) * len(tables), 1)
        while best := _most_conspicuous(table, columns, alpha):
            found.append(_taken_out(batch, table, best, run_ids, name))
    return tuple(found)


def _most_conspicuous(table: FloatArray, columns: Iterable[int], alpha: float) -> "_Tried | None":
    """Return the run that stands out most, if by more than chance."""
    tried = [t for t in (_event(table, k) for k in columns) if t and t.p_value <= alpha]
    return min(tried, key=lambda t: t.p_value, default=None)


def _taken_out(
    batch: Sequence[RunByRun],
    table: FloatArray,
    tried: "_Tried",
    run_ids: Sequence[str],
    name: str,
) -> CommonEvent:
    """Return an event, and take its shift out of the table."""
    table[tried.rows, tried.column] -= tried.mean
    unit = "ppm" if name == "k1" else _unit(batch, name)
    return _named(batch, tried, run_ids, name, unit)


def without_common(one: RunByRun, events: Sequence[CommonEvent]) -> RunByRun:
    """Return the runs of an accelerometer with the common shifts taken out."""
    mine = [e for e in events if one.joint.serial in e.shifts]
    if not mine:
        return one
    return replace(
        one,
        runs=tuple(_moved(r, one, mine) for r in one.runs),
        curves={d: tuple(_moved(r, one, mine) for r in fits) for d, fits in one.curves.items()},
    )


def _moved(run: RunFit, one: RunByRun, events: Sequence[CommonEvent]) -> RunFit:
    values, found, cov = dict(run.values), np.array(run.fit.values), np.array(run.fit.cov)
    for event in events:
        name = event.coefficient
        if event.run_id != run.run_id or name not in values:
            continue
        shift, sigma = event.shifts[one.joint.serial]
        factor = reported_as(one.joint.fit.model, name)[0]
        values[name] -= shift / factor
        if name in run.fit.names:
            k = run.fit.names.index(name)
            found[k] -= shift / factor
            cov[k, k] += (sigma / factor) ** 2
    return replace(run, values=values, fit=replace(run.fit, values=found, cov=cov))


def _table(batch: Sequence[RunByRun], run_ids: Sequence[str], name: str) -> FloatArray:
    """Return a coefficient by accelerometer and run, NaN where there is none."""
    table = np.full((len(batch), len(run_ids)), np.nan)
    for row, one in enumerate(batch):
        for r in one.runs:
            if name in r.fit.names:
                table[row, run_ids.index(r.run_id)] = r.coefficient(name)[0]
    return table


def _unit(batch: Sequence[RunByRun], name: str) -> str:
    coefficients = (c for one in batch for c in one.joint.fit.model.coefficients)
    return next((c.unit for c in coefficients if c.name == name), "")


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    column: int
    rows: IntArray
    apart: FloatArray
    mean: float
    variance: float
    p_value: float


def _event(table: FloatArray, column: int) -> _Tried | None:
    """Test whether one run differs alike in all accelerometers from their others."""
    others = np.delete(table, column, axis=1)
    count = np.asarray(np.sum(np.isfinite(others), axis=1), dtype=np.float64)
    rows = np.isfinite(table[:, column]) & (count >= 1)
    if np.count_nonzero(rows) < MIN_ACCELEROMETERS:
        return None
    rest, count = others[rows], count[rows]
    means: FloatArray = np.nanmean(rest, axis=1)
    apart: FloatArray = np.asarray(table[rows, column] - means, dtype=np.float64)
    n = apart.size
    # what the accelerometers do by themselves: in this run, and in the others
    here, here_dof = float(np.sum((apart - apart.mean()) ** 2)), n - 1
    there = float(np.nansum((rest - means[:, None]) ** 2)) * (1.0 + float(np.mean(1.0 / count)))
    there_dof = int(count.sum()) - n
    variance = (here + there) / (here_dof + there_dof)
    mean, middle = float(apart.mean()), float(np.median(apart))
    if variance <= 0.0 or middle * mean <= 0.0 or abs(middle) < 0.5 * abs(mean):
        return None
    t = mean / np.sqrt(variance / n)
    p = float(2.0 * stats.t.sf(abs(t), here_dof + there_dof))
    return _Tried(column, np.flatnonzero(rows), apart, mean, variance, p)


def _named(
    batch: Sequence[RunByRun], tried: _Tried, run_ids: Sequence[str], name: str, unit: str
) -> CommonEvent:
    n = tried.apart.size
    by_others = (tried.apart.sum() - tried.apart) / (n - 1)
    sigma = float(np.sqrt(tried.variance / (n - 1)))
    serials = [batch[int(k)].joint.serial for k in tried.rows]
    return CommonEvent(
        run_id=run_ids[tried.column],
        coefficient=name,
        unit=unit,
        shift=tried.mean,
        sigma=float(np.sqrt(tried.variance / n)),
        p_value=tried.p_value,
        shifts={s: (float(v), sigma) for s, v in zip(serials, by_others, strict=True)},
    )
