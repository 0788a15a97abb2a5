"""A coefficient that relaxes from cycle to cycle: what its estimates say of its future.

Estimate k = 0, 1, … of a coefficient is ``c∞ + A·g(k/κ) + kicks so far + error``. g is the law of
relaxation: exp(−k/κ), or the slow 1/(1 + k/κ). The kick before cycle k has the standard deviation
h·g(k/κ): the less stress is left, the smaller. The error is the estimate's own (its sigma is
given) and a scatter ρ between runs that no estimate knows of. κ, h and ρ are on a grid with equal
weights per ratio; given them everything is Gaussian and exact. All is in units of the limit, so
that the priors need no unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray, IntArray, freeze, readonly

Law = Literal["exponential", "hyperbolic"]

KAPPA = np.geomspace(0.5, 60.0, 32)  # cycles
KICK = (0.05, 20.0, 6)  # h, in limits: from, to, how many
SCATTER = (0.03, 3.0, 5)  # ρ, in limits
QUIET = 0.3  # where estimates are much better than the limit, both begin at this share of a sigma
# Prior of A: so many limits, or so many times what was seen, whichever is more.
AMPLITUDE_LIMITS, AMPLITUDE_SEEN = 50.0, 3.0
LEVEL_WIDER = 20.0  # c∞ is known that much less than A beforehand
# One stress relaxes in an accelerometer, so its coefficients' κ agree about as well as this.
KAPPA_SPREAD = 0.15
HORIZON = 60  # cycles looked ahead; what is left after them is counted as one more


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Series:
    """Estimates of one coefficient, cycle by cycle, and the change that is acceptable.

    Attributes
    ----------
    name, unit : str
    values, sigmas : ndarray, shape (n,)
        Estimates and their standard deviations, in `unit`.
    limit : float
        The change after which the coefficient is no longer what it was, in `unit`.

    Raises
    ------
    ValueError
        If shapes differ, there are fewer than three cycles, a number is not finite, or the limit
        is not positive.
    """

    name: str
    unit: str
    values: FloatArray
    sigmas: FloatArray
    limit: float

    def __post_init__(self) -> None:
        values, sigmas = readonly(self.values), readonly(self.sigmas)
        if values.ndim != 1 or values.shape != sigmas.shape or values.size < 3:
            raise ValueError(
                f"{self.name}: shapes {values.shape}, {sigmas.shape}; expected (n ≥ 3)"
            )
        if not (np.isfinite(values).all() and np.isfinite(sigmas).all() and self.limit > 0):
            raise ValueError(f"{self.name}: estimates must be finite and the limit positive")
        freeze(self, values=values, sigmas=sigmas)

    def first(self, cycles: int) -> "Series":
        """Return the series as it was after so many cycles."""
        return Series(
            name=self.name,
            unit=self.unit,
            values=self.values[:cycles],
            sigmas=self.sigmas[:cycles],
            limit=self.limit,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Draws:
    """Equally likely pasts and futures of one coefficient, in its own unit; m draws.

    Attributes
    ----------
    kappa, amplitude, final : ndarray, shape (m,)
        κ in cycles; A; the value after everything has relaxed.
    past : ndarray, shape (m, n)
        The coefficient in the cycles seen, kicks at their mean.
    future : ndarray, shape (m, HORIZON + 2)
        Its change from the last cycle on: 0, after one more cycle, …, and in the end.
    needed : ndarray of int, shape (m,)
        Further cycles after which it never again changes by more than the limit.
    """

    kappa: FloatArray
    amplitude: FloatArray
    final: FloatArray
    past: FloatArray
    future: FloatArray
    needed: IntArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Grid:
    """The Gaussian posterior of (c∞, A) at every (κ, h, ρ) for one series, in limits."""

    series: Series
    shape: FloatArray  # (g, n + HORIZON + 1): g(k/κ), the last 0
    kick: FloatArray  # (g,)
    kick_cov: FloatArray  # (g, n, n) of the kicks so far
    inverse: FloatArray  # (g, n, n) of the estimates' covariance
    shifted: FloatArray  # (n,) estimates less the last one
    mean: FloatArray  # (g, 2)
    precision: FloatArray  # (g, 2, 2)
    log_weight: FloatArray  # (len(KAPPA), g / len(KAPPA))

    @property
    def by_kappa(self) -> FloatArray:
        """The logarithm of the weight of each κ."""
        return np.logaddexp.reduce(self.log_weight, axis=1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Relaxing:
    """What the estimates of one accelerometer say under one law: `weigh` makes it.

    `log_evidence` compares laws; `of_centre` is the logarithm of the weight of each κ that the
    coefficients' own lie around.
    """

    law: Law
    grids: tuple[_Grid, ...]
    log_near: FloatArray
    of_centre: FloatArray

    @property
    def log_evidence(self) -> float:
        """Natural logarithm of the law's evidence."""
        return float(np.logaddexp.reduce(self.of_centre))

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Draws, ...]:
        """Draw pasts and futures, one `Draws` for each series."""
        centre = _choose(np.broadcast_to(self.of_centre, (count, KAPPA.size)), rng)
        drawn: list[Draws] = []
        for grid in self.grids:
            kappa = _choose((self.log_near + grid.by_kappa)[centre], rng)
            rest = _choose(grid.log_weight[kappa], rng)
            drawn.append(_drawn(grid, kappa, kappa * grid.log_weight.shape[1] + rest, rng))
        return tuple(drawn)


def weigh(series: Sequence[Series], law: Law) -> Relaxing:
    """Infer the coefficients of one accelerometer under a law.

    Parameters
    ----------
    series : sequence of Series
        Of one length; their κ are near one another (`KAPPA_SPREAD`).
    law : {"exponential", "hyperbolic"}
    """
    grids = tuple(_posterior(one, law) for one in series)
    near = np.exp(-0.5 * (np.log(KAPPA[:, None] / KAPPA) / KAPPA_SPREAD) ** 2)
    log_near = np.log(near / near.sum(axis=1, keepdims=True) + 1e-300)
    of_each = [np.logaddexp.reduce(log_near + grid.by_kappa, axis=1) for grid in grids]
    return Relaxing(law=law, grids=grids, log_near=log_near, of_centre=np.sum(of_each, axis=0))


def _choose(log_weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw one column of each row, shape (m,)."""
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    below = np.cumsum(weight, axis=1)
    level = rng.random(len(weight)) * below[:, -1]
    return np.asarray((below < level[:, None]).sum(axis=1), dtype=np.intp)


def law_shape(law: Law, cycle: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return how much is left after so many cycles, 1 at first."""
    ratio = cycle / kappa
    return np.exp(-ratio) if law == "exponential" else 1.0 / (1.0 + ratio)


def _posterior(series: Series, law: Law) -> _Grid:
    n = series.values.size
    quiet = QUIET * max(float(np.min(series.sigmas)) / series.limit, 1e-6)
    kicks, scatters = (np.geomspace(min(lo, quiet), hi, m) for lo, hi, m in (KICK, SCATTER))
    kappa, kick, scatter = (a.ravel() for a in np.meshgrid(KAPPA, kicks, scatters, indexing="ij"))
    ahead = law_shape(law, np.arange(n + HORIZON, dtype=float), kappa[:, None])
    shape = np.column_stack([ahead, np.zeros(kappa.size)])
    seen = shape[:, :n]
    sums = np.cumsum(np.where(np.arange(n) > 0, seen**2, 0.0), axis=1)
    earlier = np.minimum.outer(np.arange(n), np.arange(n))
    kick_cov = kick[:, None, None] ** 2 * sums[:, earlier]
    error = np.diag((series.sigmas / series.limit) ** 2)
    cov = kick_cov + error + scatter[:, None, None] ** 2 * np.eye(n)
    inverse = np.linalg.inv(cov)
    shifted = (series.values - series.values[-1]) / series.limit
    size = max(AMPLITUDE_LIMITS, AMPLITUDE_SEEN * float(np.ptp(shifted)))
    columns = np.stack([np.ones_like(seen), seen], axis=2)
    weighed = columns.transpose(0, 2, 1) @ inverse
    precision = weighed @ columns + np.diag([1.0 / (LEVEL_WIDER * size) ** 2, 1.0 / size**2])
    target = weighed @ shifted
    mean = np.asarray(np.linalg.solve(precision, target[:, :, None]), dtype=float)[:, :, 0]
    chi2 = inverse @ shifted @ shifted - (target * mean).sum(axis=1)
    log_det = np.linalg.slogdet(cov)[1] + np.linalg.slogdet(precision)[1]
    return _Grid(
        series=series,
        shape=shape,
        kick=kick,
        kick_cov=kick_cov,
        inverse=inverse,
        shifted=shifted,
        mean=mean,
        precision=precision,
        log_weight=(-0.5 * (log_det + chi2)).reshape(KAPPA.size, -1),
    )


def _drawn(grid: _Grid, kappa: IntArray, at: IntArray, rng: np.random.Generator) -> Draws:
    """Draw coefficients, kicks so far and kicks to come at the grid points given."""
    n, limit = grid.shifted.size, grid.series.limit
    root = np.linalg.cholesky(np.linalg.inv(grid.precision))
    level, size = (grid.mean[at] + (root[at] @ rng.standard_normal((at.size, 2, 1)))[:, :, 0]).T
    seen, ahead = grid.shape[at, :n], grid.shape[at, n:]
    curve = level[:, None] + size[:, None] * seen
    apart = grid.inverse[at] @ (grid.shifted - curve)[:, :, None]
    kicked = (grid.kick_cov[at] @ apart)[:, :, 0]
    to_last = grid.kick_cov[:, -1:]
    known = (to_last @ grid.inverse @ to_last.transpose(0, 2, 1))[:, 0, 0]
    left = (grid.kick_cov[:, -1, -1] - known)[at]
    last = curve[:, -1] + kicked[:, -1]
    last += np.sqrt(np.maximum(left, 0.0)) * rng.standard_normal(at.size)
    kicks = grid.kick[at, None] * ahead * rng.standard_normal(ahead.shape)
    change = size[:, None] * (ahead - seen[:, -1:]) + np.cumsum(kicks, axis=1)
    future = np.column_stack([np.zeros(at.size), change])
    offset = grid.series.values[-1]
    return Draws(
        kappa=KAPPA[kappa],
        amplitude=limit * size,
        final=offset + limit * (last + future[:, -1]),
        past=offset + limit * (curve + kicked),
        future=limit * future,
        needed=cycles_needed(future, 1.0),
    )


def cycles_needed(path: FloatArray, limit: float) -> IntArray:
    """Return after how many cycles a path never again changes by more than a limit.

    Parameters
    ----------
    path : ndarray, shape (m, k)
    limit : float

    Returns
    -------
    ndarray of int, shape (m,)
        The first place from which on everything stays within the limit of the value there.
    """
    highest = np.maximum.accumulate(path[:, ::-1], axis=1)[:, ::-1]
    lowest = np.minimum.accumulate(path[:, ::-1], axis=1)[:, ::-1]
    steady = (highest - path <= limit) & (path - lowest <= limit)
    return np.asarray(np.argmax(steady, axis=1), dtype=np.intp)
