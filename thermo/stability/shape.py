"""An accelerometer's K0 over temperature: how much of it no model can hold, and how it bends.

The curve of run r in direction d is μ(T) + δ_d(T) + b_rd(T) + error. *Spread* is what no model in
temperature can take away, √(mean over T and d of δ² + var b): a property of the accelerometer, so
its estimate must not depend on how many runs there were. Its two parts are estimated apart, the
errors' known variance taken out, and their limits put together by the method of variance
estimates recovery (Zou and Donner 2008, Stat. Med. 27, 1693).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray
from errormodel.statistics.scatter import sigma_bounds
from thermo.stability.curves import GRID_C, MAX_GRID, CurveSet

TAIL = 0.025  # beyond each 95 % limit
ROUNDING_UG = 1e-6
Limits = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """Figures of an accelerometer's K0 over temperature, µg.

    Attributes
    ----------
    spread_ug : float
        As likely too high as too low, for any number of runs.
    spread_ci95_ug : pair of float
    bend_ug : float
        Rms of the mean curve about a straight line.
    bend_ci95_ug : pair of float
    """

    spread_ug: float
    spread_ci95_ug: Limits
    bend_ug: float
    bend_ci95_ug: Limits


@dataclass(frozen=True, slots=True, eq=False)
class _Curves:
    """K0 (runs, m) of one direction on a common grid, and the mean variance of its errors."""

    runs: tuple[str, ...]
    k0: FloatArray
    noise2: float


@dataclass(frozen=True, slots=True)
class _Part:
    """A mean square with its limits; `shown`: above 0, wrongly so in half of `TAIL` cases."""

    value: float
    low: float
    high: float
    shown: bool


def shape_of(sets: Sequence[CurveSet]) -> Shape | None:
    """Describe the K0 curves over the temperatures that all directions share.

    None without such temperatures.
    """
    if not sets:
        return None
    low, high = max(float(s.temp_c[0]) for s in sets), min(float(s.temp_c[-1]) for s in sets)
    if low > high:
        return None
    count = 1 + min(int((high - low) / GRID_C), MAX_GRID - 1)
    grid = np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2.0])
    curves = [_on(grid, s) for s in sets]
    known_to = min(s.sigma_dof for s in sets)
    parts = [_between_runs(curves, known_to)]
    if len(curves) == 2:
        parts.append(_between_directions(*curves))
    spread2 = sum(p.value for p in parts)
    # parts that may be 0 add up to what may be 0, which the limits put together would deny
    shown = any(p.shown for p in parts)
    below = float(np.sqrt(sum((p.value - p.low) ** 2 for p in parts))) if shown else spread2
    above = float(np.sqrt(sum((p.high - p.value) ** 2 for p in parts)))
    bend = _bend(grid, curves)
    return Shape(
        spread_ug=float(np.sqrt(spread2)),
        spread_ci95_ug=(float(np.sqrt(max(spread2 - below, 0.0))), float(np.sqrt(spread2 + above))),
        bend_ug=float(np.sqrt(bend.value)),
        bend_ci95_ug=(float(np.sqrt(bend.low)), float(np.sqrt(bend.high))),
    )


def _on(grid: FloatArray, one: CurveSet) -> _Curves:
    k0 = np.zeros((len(one.run_ids), grid.size))
    for k in range(len(one.run_ids)):
        k0[k] = np.interp(grid, one.temp_c, one.k0_ug[k])
    inside = (one.temp_c >= grid[0]) & (one.temp_c <= grid[-1])
    shown = one.k0_variance_ug2[:, inside] if np.any(inside) else one.k0_variance_ug2
    return _Curves(one.run_ids, k0, float(np.mean(shown)))


def _between_runs(curves: Sequence[_Curves], known_to: float) -> _Part:
    """Return the variance between runs, mean over temperature and direction.

    Its limits are those of a value that differs from run to run as the curves do in the mean
    (exact where runs differ by an offset; a shape that differs too makes them a little wide).
    """
    squares = [_mean_square(c.k0) for c in curves]
    noise = float(np.sqrt(np.mean([c.noise2 for c in curves])))
    n = min(len(c.runs) for c in curves)
    pattern = np.linspace(-1.0, 1.0, n)
    values = pattern * np.sqrt(np.mean(squares)) / np.std(pattern, ddof=1)
    noises = np.full(n, noise)
    low, high = sigma_bounds(values, noises, TAIL, known_to)
    middle = sigma_bounds(values, noises, 0.5)[0]
    shown = sigma_bounds(values, noises, TAIL / 2.0, known_to)[0] > 0.0
    return _Part(middle**2, low**2, max(high, middle) ** 2, shown)


def _mean_square(curves: FloatArray) -> float:
    """Return the variance over the runs, mean over temperature."""
    variance: FloatArray = np.var(curves, axis=0, ddof=1)
    return float(np.mean(variance))


def _between_directions(one: _Curves, other: _Curves) -> _Part:
    """Return the mean square of half the difference of the directions, from runs with both."""
    both = [r for r in one.runs if r in other.runs]
    if len(both) < 2:  # each direction from other runs: what differs is counted between runs
        return _Part(0.0, 0.0, 0.0, shown=False)
    half = 0.5 * np.array([one.k0[one.runs.index(r)] - other.k0[other.runs.index(r)] for r in both])
    return _of_mean(half)


def _of_mean(curves: FloatArray) -> _Part:
    """Return the mean square of the mean curve (runs, m), its scatter taken out, and limits."""
    n = curves.shape[0]
    mean: FloatArray = np.mean(curves, axis=0)
    rms = float(np.sqrt(np.mean(mean**2)))
    rms = rms if rms > ROUNDING_UG else 0.0
    error = float(np.sqrt(_mean_square(curves) / n))
    slack, more = (float(stats.t.ppf(1.0 - p, n - 1)) * error for p in (TAIL, TAIL / 2.0))
    value = max(rms**2 - error**2, 0.0)
    return _Part(value, min(max(rms - slack, 0.0) ** 2, value), (rms + slack) ** 2, rms > more)


def _bend(grid: FloatArray, curves: Sequence[_Curves]) -> _Part:
    """Return the mean square of what a straight line leaves of the mean curve."""
    runs = [r for r in curves[0].runs if all(r in c.runs for c in curves)]
    if len(runs) < 2:
        rows = np.vstack([c.k0 for c in curves])
    else:
        rows = np.mean([c.k0[[c.runs.index(r) for r in runs]] for c in curves], axis=0)
    x = grid - grid.mean()
    line = np.outer(rows @ x / max(float(x @ x), 1e-300), x)
    return _of_mean(np.asarray(rows - rows.mean(axis=1, keepdims=True) - line, dtype=np.float64))
