"""A coefficient that relaxes from cycle to cycle: what its estimates say of its future.

The rivals of `thermo.run_in.rivals` are weighed by their evidence (Bayesian model averaging;
Hoeting et al. 1999, Stat. Sci. 14, 382). Given κ, h, ρ and what is slow everything is Gaussian and
exact (κ between two points of the grid to first order: otherwise a slow process would pose as what
the grid cannot hold). All is in units of the limit, so that the priors need no unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from errormodel.arrays import BoolArray, FloatArray, IntArray, freeze, readonly
from thermo.run_in.rivals import (
    HORIZON,
    KAPPA,
    PLAIN,
    SLOW_NAMES,
    SLOW_ODDS,
    Hypotheses,
    Law,
    lay_out,
    log_det_of,
)

NEVER = -1e300  # logarithm of no weight at all
# Prior of A: so many limits, or so many times what was seen, whichever is more.
AMPLITUDE_LIMITS, AMPLITUDE_SEEN = 50.0, 3.0
LEVEL_WIDER = 20.0  # c∞ is known that much less than A beforehand
# One stress relaxes in an accelerometer, so its coefficients' κ agree about as well as this.
KAPPA_SPREAD = 0.15


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CoefficientSeries:
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

    def first(self, cycles: int) -> "CoefficientSeries":
        """Return the series as it was after so many cycles."""
        return CoefficientSeries(
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
    slow : ndarray, shape (m,)
        What a slow process beside the relaxation will change within `HORIZON` cycles.
    plain : ndarray of bool, shape (m,)
        Whether nothing slower than the relaxation goes on.
    """

    kappa: FloatArray
    amplitude: FloatArray
    final: FloatArray
    past: FloatArray
    future: FloatArray
    needed: IntArray
    slow: FloatArray
    plain: BoolArray

    def joined(self, other: "Draws", share: float) -> "Draws":
        """Return these draws with a share of them in place of those of another law."""
        mine = round((1.0 - share) * self.needed.size)
        both = {
            name: np.concatenate([getattr(self, name)[:mine], getattr(other, name)[mine:]])
            for name in (f.name for f in fields(Draws))
        }
        return Draws(**both)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Grid:
    """The Gaussian posterior under every hypothesis for one series, in limits."""

    series: CoefficientSeries
    hypotheses: Hypotheses
    shifted: FloatArray  # (n,) estimates less the last one
    mean: FloatArray  # (g, 4)
    precision: FloatArray  # (g, 4, 4)
    log_weight: FloatArray  # (len(KAPPA), g / len(KAPPA))

    @property
    def by_kappa(self) -> FloatArray:
        """The logarithm of the weight of each κ."""
        return np.logaddexp.reduce(self.log_weight, axis=1)

    def of_kind(self, kind: int) -> tuple["_Grid", float]:
        """Return the posterior where one kind of slow process goes on, and the log of its share."""
        log_prior = self.hypotheses.log_prior[self.hypotheses.kind == kind]
        other = (self.hypotheses.kind != kind).reshape(self.log_weight.shape)
        alone = replace(self, log_weight=np.where(other, NEVER, self.log_weight))
        return alone, float(np.logaddexp.reduce(log_prior)) - float(np.log(KAPPA.size))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SlowRival:
    """A slow process beside the relaxation, and what it would bring.

    Attributes
    ----------
    name : str
    odds : float
        Of it against all hypotheses together, from `SLOW_ODDS` beforehand; what share it was
        given among them does not enter.
    places : tuple of int
        The series in which it goes on; in the others anything may.
    draws : tuple of Draws
        Equally likely futures with it, one for each series.
    """

    name: str
    odds: float
    places: tuple[int, ...]
    draws: tuple[Draws, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Relaxing:
    """Posterior of one accelerometer's estimates under one law, made by `weigh`.

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
        return tuple(self._drawn(grid, centre, rng) for grid in self.grids)

    def _drawn(self, grid: _Grid, centre: IntArray, rng: np.random.Generator) -> Draws:
        kappa = _choose((self.log_near + grid.by_kappa)[centre], rng)
        rest = _choose(grid.log_weight[kappa], rng)
        return _drawn(grid, kappa, kappa * grid.log_weight.shape[1] + rest, rng)

    def slow_rivals(
        self, count: int, rng: np.random.Generator, least: float
    ) -> tuple[SlowRival, ...]:
        """Draw futures under every kind of slow process, in each series alone and in all.

        Those are left out under which the estimates are less than `least` times as likely as over
        all hypotheses.
        """
        numbers = range(len(self.grids))
        places = {frozenset({i}) for i in numbers} | {frozenset(numbers)}
        found: list[SlowRival] = []
        for kind, name in SLOW_NAMES.items():
            alone = [grid.of_kind(kind) for grid in self.grids]
            for place in sorted(places, key=sorted):
                parts = [alone[i][0] if i in place else self.grids[i] for i in numbers]
                by_centre = np.sum([self._near(part) for part in parts], axis=0)
                prior = sum(alone[i][1] for i in place)
                likelier = float(np.logaddexp.reduce(by_centre)) - prior - self.log_evidence
                if likelier < np.log(least):
                    continue
                odds = SLOW_ODDS * float(np.exp(min(likelier, 50.0)))
                centre = _choose(np.broadcast_to(by_centre, (count, KAPPA.size)), rng)
                draws = tuple(self._drawn(part, centre, rng) for part in parts)
                places_of = tuple(sorted(place))
                found.append(SlowRival(name=name, odds=odds, places=places_of, draws=draws))
        return tuple(found)

    def _near(self, grid: _Grid) -> FloatArray:
        """Return the logarithm of the weight of a series, by the κ that its own lies around."""
        return _around(self.log_near, grid)


def _around(log_near: FloatArray, grid: _Grid) -> FloatArray:
    return np.logaddexp.reduce(log_near + grid.by_kappa, axis=1)


def weigh(series: Sequence[CoefficientSeries], law: Law, *, slow: bool = True) -> Relaxing:
    """Infer the coefficients of one accelerometer under a law.

    Parameters
    ----------
    series : sequence of CoefficientSeries
        Of one length; their κ are near one another (`KAPPA_SPREAD`).
    law : {"exponential", "hyperbolic"}
    slow : bool
        Whether what is slower than the relaxation is weighed too; else it is taken not to be there.
    """
    sigmas = [tuple((one.sigmas / one.limit).tolist()) for one in series]
    # estimates with the same sigmas share all that their values do not enter
    laid = {s: lay_out(law, s, slow) for s in set(sigmas)}
    grids = tuple(_posterior(one, laid[s]) for one, s in zip(series, sigmas, strict=True))
    near = np.exp(-0.5 * (np.log(KAPPA[:, None] / KAPPA) / KAPPA_SPREAD) ** 2)
    log_near = np.log(near / near.sum(axis=1, keepdims=True) + 1e-300)
    of_centre = np.sum([_around(log_near, grid) for grid in grids], axis=0)
    return Relaxing(law=law, grids=grids, log_near=log_near, of_centre=of_centre)


def _choose(log_weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw one column of each row, shape (m,)."""
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    below = np.cumsum(weight, axis=1)
    level = rng.random(len(weight)) * below[:, -1]
    return np.asarray((below < level[:, None]).sum(axis=1), dtype=np.intp)


def _posterior(series: CoefficientSeries, made: Hypotheses) -> _Grid:
    shifted = (series.values - series.values[-1]) / series.limit
    seen = float(np.ptp(shifted))
    size = max(AMPLITUDE_LIMITS, AMPLITUDE_SEEN * seen)
    between = float(np.log(KAPPA[1] / KAPPA[0]) / np.sqrt(12.0))  # uniform over a step
    same = np.ones_like(made.slow_size)
    prior = np.stack(
        [
            same / (LEVEL_WIDER * size) ** 2,
            same / size**2,
            same / (between * max(seen, 1.0)) ** 2,
            1.0 / made.slow_size**2,
        ],
        axis=1,
    )
    precision = made.gram + prior[:, :, None] * np.eye(4)
    target = made.weighed @ shifted
    mean = np.asarray(np.linalg.solve(precision, target[:, :, None]), dtype=float)[:, :, 0]
    chi2 = made.inverse @ shifted @ shifted - (target * mean).sum(axis=1)
    log_det = made.log_det + log_det_of(precision) - np.log(prior).sum(axis=1)
    return _Grid(
        series=series,
        hypotheses=made,
        shifted=shifted,
        mean=mean,
        precision=precision,
        log_weight=(made.log_prior - 0.5 * (log_det + chi2)).reshape(KAPPA.size, -1),
    )


def _drawn(grid: _Grid, kappa: IntArray, at: IntArray, rng: np.random.Generator) -> Draws:
    """Draw coefficients, slips so far and slips to come under the hypotheses given."""
    n, limit, made = grid.shifted.size, grid.series.limit, grid.hypotheses
    used, of = np.unique(at, return_inverse=True)
    of = of.ravel()
    root = np.linalg.cholesky(np.linalg.inv(grid.precision[used]))[of]
    found = grid.mean[at] + (root @ rng.standard_normal((at.size, 4, 1)))[:, :, 0]
    level, size, apart, slow = found.T[:, :, None]
    way = size * made.shape[at] + apart * made.bend[at] + slow * made.slow[at]
    curve = level + way[:, :n]
    slip_cov = made.slip_cov[used]
    gain = slip_cov @ made.inverse[used]
    slipped = (gain[of] @ (grid.shifted - curve)[:, :, None])[:, :, 0]
    known = (gain[:, -1:] @ slip_cov[:, :, -1:])[:, 0, 0]
    left = np.maximum(slip_cov[:, -1, -1] - known, 0.0)[of]
    last = curve[:, -1] + slipped[:, -1] + np.sqrt(left) * rng.standard_normal(at.size)
    slips = made.slip[at, n:] * rng.standard_normal((at.size, HORIZON + 1))
    change = way[:, n:] - way[:, n - 1 : n] + np.cumsum(slips, axis=1)
    future = np.column_stack([np.zeros(at.size), change])
    offset = grid.series.values[-1]
    return Draws(
        kappa=KAPPA[kappa],
        amplitude=limit * size[:, 0],
        final=offset + limit * (last + future[:, -1]),
        past=offset + limit * (curve + slipped),
        future=limit * future,
        needed=cycles_needed(future, 1.0),
        slow=limit * (slow * (made.slow[at, n:] - made.slow[at, n - 1 : n]))[:, -1],
        plain=made.kind[at] == PLAIN,
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
