"""Runs compared as curves over temperature."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from thermo.stability.runs import RunByRun, RunFit

GRID_C = 1.0
MAX_GRID = 400
DRAWS = 2000  # of the curves' errors: their 95 % point is then known to some 2 %


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CurveSet:
    """The curves of all runs in one direction, over the temperatures that they share.

    Attributes
    ----------
    direction : int
        1 heating, −1 cooling, 0 hold.
    run_ids : tuple of str
    temp_c : ndarray, shape (m,)
    k0_ug, k1_ppm : ndarray, shape (runs, m)
        K1 as ppm from nominal.
    k0_errors_ug, k1_errors_ppm : ndarray, shape (draws, runs, m)
        Draws of what the estimation adds.
    k0_variance_ug2 : ndarray, shape (runs, m)
        Variance of K0 by its estimation.
    sigma_dof : float
        Degrees of freedom that this is known to.
    """

    direction: int
    run_ids: tuple[str, ...]
    temp_c: FloatArray
    k0_ug: FloatArray
    k1_ppm: FloatArray
    k0_errors_ug: FloatArray
    k1_errors_ppm: FloatArray
    k0_variance_ug2: FloatArray
    sigma_dof: float

    def __post_init__(self) -> None:
        arrays = ("temp_c", "k0_ug", "k1_ppm", "k0_errors_ug", "k1_errors_ppm", "k0_variance_ug2")
        freeze(self, **{name: readonly(getattr(self, name)) for name in arrays})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Distance:
    """Distance between the runs' curves.

    Attributes
    ----------
    rms, largest : float
        Over all pairs of runs, temperatures and directions.
    largest_at : tuple of (str, str, float, int) or None
        The two runs, the temperature and the direction of the largest.
    rms_draws, largest_draws : ndarray, shape (draws,)
        What the estimation alone would give.
    """

    rms: float
    largest: float
    largest_at: tuple[str, str, float, int] | None
    rms_draws: FloatArray
    largest_draws: FloatArray

    def rms_bounds(self, alpha: float) -> tuple[float, float]:
        """Return bounds of the distance without estimation errors, each wrong in `alpha` or less.

        Both measures are seminorms: estimation moves them by their own value of its errors at most.
        """
        return _bounds(self.rms, self.rms_draws, alpha)

    def largest_bounds(self, alpha: float) -> tuple[float, float]:
        """Return the same for the largest distance."""
        return _bounds(self.largest, self.largest_draws, alpha)


def _bounds(value: float, draws: FloatArray, alpha: float) -> tuple[float, float]:
    slack = float(np.quantile(draws, 1.0 - alpha)) if draws.size else 0.0
    return max(0.0, value - slack), value + slack


def curve_sets(one: RunByRun) -> tuple[CurveSet, ...]:
    """Evaluate the curves of each direction that two runs or more share a temperature in."""
    rng = np.random.default_rng(len(one.joint.serial))
    found: list[CurveSet] = []
    for direction, fits in one.curves.items():
        low, high = max(f.temp_c[0] for f in fits), min(f.temp_c[1] for f in fits)
        if low > high:
            continue
        count = min(max(1 + int((high - low) / GRID_C), 1), MAX_GRID)
        temp_c = np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
        x = temp_c - one.joint.t_ref_c
        known_to = min(f.dof("k0") for f in fits)
        k0, k0_variance, k0_errors = _evaluated(fits, "k0", x, known_to, rng)
        k1, _, k1_errors = _evaluated(fits, "k1", x, known_to, rng)
        found.append(
            CurveSet(
                direction=direction,
                run_ids=tuple(f.run_id for f in fits),
                temp_c=temp_c,
                k0_ug=k0,
                k1_ppm=k1,
                k0_errors_ug=k0_errors,
                k1_errors_ppm=k1_errors,
                k0_variance_ug2=k0_variance,
                sigma_dof=known_to,
            )
        )
    return tuple(found)


def _evaluated(
    fits: Sequence[RunFit],
    family: str,
    x: FloatArray,
    known_to: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return curves and variances (runs, m), and draws of the errors (draws, runs, m).

    The sigmas are estimates: their common factor differs from draw to draw (Student's t).
    """
    curves, variances, errors = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    size = np.sqrt(known_to / rng.chisquare(known_to, DRAWS))
    for one in fits:
        value, gradient = one.curve(family, x)
        root = gradient @ np.linalg.cholesky(_padded(one.fit.cov))
        draws = rng.standard_normal((DRAWS, root.shape[1])) @ root.T
        curves.append(value)
        variances.append(np.sum(root**2, axis=1))
        errors.append(size[:, None] * draws)
    return np.array(curves), np.array(variances), np.stack(errors, axis=1)


def _padded(cov: FloatArray) -> FloatArray:
    return cov + 1e-12 * np.diag(np.diag(cov))  # rounding may leave it just short of positive


def distance(sets: Sequence[CurveSet], family: str) -> Distance | None:
    """Return how far the runs' curves lie apart; None without curves to compare."""
    if not sets:
        return None
    curves = [getattr(s, _FIELD[family]) for s in sets]
    errors = [getattr(s, _ERRORS[family]) for s in sets]
    rms, largest = _measures([c[None] for c in curves])
    rms_draws, largest_draws = _measures(errors)
    return Distance(
        rms=float(rms[0]),
        largest=float(largest[0]),
        largest_at=_where(sets, curves),
        rms_draws=rms_draws,
        largest_draws=largest_draws,
    )


_FIELD = {"k0": "k0_ug", "k1": "k1_ppm"}
_ERRORS = {"k0": "k0_errors_ug", "k1": "k1_errors_ppm"}


def _measures(sets: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return rms and largest distance of curves, a set (draws, runs, m) a direction.

    The mean over all pairs of (a − b)² is twice the variance over the runs.
    """
    squares = np.concatenate([2.0 * np.var(s, axis=1, ddof=1) for s in sets], axis=1)
    widths = np.concatenate([np.ptp(s, axis=1) for s in sets], axis=1)
    return np.sqrt(squares.mean(axis=1)), widths.max(axis=1)


def _where(
    sets: Sequence[CurveSet], curves: Sequence[FloatArray]
) -> tuple[str, str, float, int] | None:
    k = int(np.argmax([np.ptp(c, axis=0).max() for c in curves]))
    at = int(np.argmax(np.ptp(curves[k], axis=0)))
    low, high = int(np.argmin(curves[k][:, at])), int(np.argmax(curves[k][:, at]))
    if low == high:
        return None
    one = sets[k]
    return one.run_ids[low], one.run_ids[high], float(one.temp_c[at]), one.direction
