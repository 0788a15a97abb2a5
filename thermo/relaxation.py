"""A coefficient that relaxes from cycle to cycle: what its estimates say of its future.

Estimate k = 0, 1, … of a coefficient is ``c∞ + A·g(k/κ) + B·v(k) + slips so far + error``.

- g is the law of relaxation: exp(−k/κ), or the slow 1/(1 + k/κ); A may be 0: nothing relaxes.
- v is something slower beside it: a second exponential or a creep without end; B may be 0.
- Slips are kicks before each cycle, of the standard deviation h·g(k/κ) (the less stress is left,
  the smaller), or a random walk of equal steps.
- The error is the estimate's own (its sigma is given) and a scatter ρ between runs that no
  estimate knows of.

κ, h, ρ and the kind and size of what is slow are on a grid of rival hypotheses; given them
everything is Gaussian and exact (κ between two points of the grid to first order: otherwise a slow
process would pose as what the grid cannot hold). The evidence weighs them (Bayesian model
averaging; Hoeting et al. 1999, Stat. Sci. 14, 382). All is in units of the limit, so that the
priors need no unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from errormodel.arrays import BoolArray, FloatArray, IntArray, freeze, readonly

Law = Literal["exponential", "hyperbolic"]

KAPPA = np.geomspace(0.5, 60.0, 32)  # cycles
KICK = (0.05, 20.0, 4)  # h, in limits: from, to, how many
SCATTER = (0.03, 3.0, 3)  # ρ, in limits
# Nothing relaxes, beforehand, in this share of coefficients; beside what relaxes, nothing slow
# goes on in that one, a second process or creep in that, a random walk in the rest. With rarer
# rivals a creep of 1.5 µg a cycle (known to 2 µg) is called settled before it shows; with more
# frequent ones a plain exponential is kept in the chamber for more than twice as long.
STILL, NOT_SLOW, SLOW = 0.3, 0.9, 0.06
SLOW_KAPPA = (20.0, np.inf)  # cycles; the last is creep
SLOW_SIZE = (2.0, 10.0)  # its change within HORIZON cycles, limits, 1 sigma
WALK = (0.1, 0.4)  # step a cycle, limits
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
class _Hypotheses:
    """What the rivals under a law say beforehand of estimates with given sigmas, in limits.

    The coefficients are c∞, A, A times the deviation of ln κ from the grid, and B.
    """

    shape: FloatArray  # (g, n + HORIZON + 1): A's g(k/κ), the last 0; 0 where nothing relaxes
    bend: FloatArray  # (g, n + HORIZON + 1): the derivative of `shape` by ln κ
    slow: FloatArray  # (g, n + HORIZON + 1): B's v(k)
    slow_size: FloatArray  # (g,) 1 sigma of B
    slip: FloatArray  # (g, n + HORIZON + 1): standard deviation of the slip before each cycle
    slip_cov: FloatArray  # (g, n, n) of the slips so far
    inverse: FloatArray  # (g, n, n) of the estimates' covariance
    weighed: FloatArray  # (g, 4, n): the columns' transpose times `inverse`
    gram: FloatArray  # (g, 4, 4): `weighed` times the columns
    log_det: FloatArray  # (g,) of the estimates' covariance
    log_prior: FloatArray  # (g,)
    plain: BoolArray  # (g,) nothing slow goes on


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Grid:
    """The Gaussian posterior under every hypothesis for one series, in limits."""

    series: Series
    hypotheses: _Hypotheses
    shifted: FloatArray  # (n,) estimates less the last one
    mean: FloatArray  # (g, 4)
    precision: FloatArray  # (g, 4, 4)
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


def weigh(series: Sequence[Series], law: Law, *, slow: bool = True) -> Relaxing:
    """Infer the coefficients of one accelerometer under a law.

    Parameters
    ----------
    series : sequence of Series
        Of one length; their κ are near one another (`KAPPA_SPREAD`).
    law : {"exponential", "hyperbolic"}
    slow : bool
        Whether what is slower than the relaxation is weighed too; else it is taken not to be there.
    """
    grids = tuple(_posterior(one, law, slow) for one in series)
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


@dataclass(frozen=True, slots=True)
class _Rival:
    """One kind of hypothesis: kick h and scatter ρ in limits, what is slow, and the prior."""

    kick: float
    scatter: float
    relaxes: bool
    slow_kappa: float  # 0 where nothing slow goes on
    slow_size: float
    walk: float
    log_prior: float


def _rivals(quiet: float, weigh_slow: bool) -> list[_Rival]:
    """Return the hypotheses for each κ."""
    kicks, scatters = (
        np.geomspace(min(lo, quiet), hi, m).tolist() for lo, hi, m in (KICK, SCATTER)
    )
    slow = [(0.0, 0.0, 0.0, NOT_SLOW)]
    each = SLOW / (len(SLOW_KAPPA) * len(SLOW_SIZE))
    slow += [(kappa, size, 0.0, each) for kappa in SLOW_KAPPA for size in SLOW_SIZE]
    slow += [(0.0, 0.0, q, (1.0 - NOT_SLOW - SLOW) / len(WALK)) for q in WALK]
    found: list[_Rival] = []
    for kappa, size, walk, prior in slow if weigh_slow else slow[:1]:
        # beside what is slow every other h and ρ do
        thin = slice(None) if kappa == walk == 0.0 else slice(0, None, 2)
        hs, rhos = kicks[thin], scatters[thin]
        for rho in rhos:
            for relaxes, h, share in [(False, 0.0, STILL)] + [
                (True, h, (1.0 - STILL) / len(hs)) for h in hs
            ]:
                log_prior = float(np.log(prior * share / len(rhos)))
                found.append(_Rival(h, rho, relaxes, kappa, size, walk, log_prior))
    return found


def slow_shape(cycle: FloatArray, kappa: float) -> FloatArray:
    """Return the way of a slow process over cycles: 0 at first, 1 after `HORIZON` (creep)."""
    if kappa == 0.0:
        return np.zeros_like(cycle)
    return cycle / HORIZON if np.isinf(kappa) else 1.0 - np.exp(-cycle / kappa)


def law_bend(law: Law, cycle: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return the derivative of `law_shape` by ln κ."""
    ratio = cycle / kappa
    return ratio * np.exp(-ratio) if law == "exponential" else ratio / (1.0 + ratio) ** 2


def _hypotheses(law: Law, sigmas: tuple[float, ...], weigh_slow: bool) -> _Hypotheses:
    """Lay out every hypothesis for estimates with these sigmas, in limits."""
    n = len(sigmas)
    rivals = _rivals(QUIET * max(min(sigmas), 1e-6), weigh_slow)
    cycle = np.arange(n + HORIZON + 1, dtype=float)
    ahead = law_shape(law, cycle, KAPPA[:, None])
    bent = law_bend(law, cycle, KAPPA[:, None])
    ahead[:, -1] = bent[:, -1] = 0.0
    relaxes, kick, walk, scatter = (
        np.array([getattr(r, name) for r in rivals], dtype=float)
        for name in ("relaxes", "kick", "walk", "scatter")
    )
    each = (KAPPA.size, len(rivals), cycle.size)
    shape = (ahead[:, None, :] * relaxes[:, None]).reshape(-1, cycle.size)
    bend = (bent[:, None, :] * relaxes[:, None]).reshape(-1, cycle.size)
    slip = (np.hypot(kick[:, None] * ahead[:, None, :], walk[:, None])).reshape(-1, cycle.size)
    of_rival = np.array([slow_shape(cycle, r.slow_kappa) for r in rivals])
    slow = np.broadcast_to(of_rival, each).reshape(-1, cycle.size)
    sums = np.cumsum(np.where(np.arange(n) > 0, slip[:, :n] ** 2, 0.0), axis=1)
    slip_cov = sums[:, np.minimum.outer(np.arange(n), np.arange(n))]
    scattered = np.tile(scatter, KAPPA.size)[:, None, None] ** 2 * np.eye(n)
    cov = slip_cov + np.diag(np.square(sigmas)) + scattered
    inverse = np.linalg.inv(cov)
    ones = np.ones_like(shape[:, :n])
    columns = np.stack([ones, shape[:, :n], bend[:, :n], slow[:, :n]], axis=2)
    weighed = columns.transpose(0, 2, 1) @ inverse
    return _Hypotheses(
        shape=shape,
        bend=bend,
        slow=slow,
        slow_size=np.tile([r.slow_size or 1.0 for r in rivals], KAPPA.size),
        slip=slip,
        slip_cov=slip_cov,
        inverse=inverse,
        weighed=weighed,
        gram=weighed @ columns,
        log_det=_log_det(cov),
        log_prior=np.tile([r.log_prior for r in rivals], KAPPA.size),
        plain=np.tile([r.slow_kappa == r.walk == 0.0 for r in rivals], KAPPA.size),
    )


def _posterior(series: Series, law: Law, weigh_slow: bool) -> _Grid:
    made = _hypotheses(law, tuple((series.sigmas / series.limit).tolist()), weigh_slow)
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
    log_det = made.log_det + _log_det(precision) - np.log(prior).sum(axis=1)
    return _Grid(
        series=series,
        hypotheses=made,
        shifted=shifted,
        mean=mean,
        precision=precision,
        log_weight=(made.log_prior - 0.5 * (log_det + chi2)).reshape(KAPPA.size, -1),
    )


def _log_det(cov: FloatArray) -> FloatArray:
    """Return the logarithm of the determinants of positive definite matrices (g, n, n)."""
    root = np.diagonal(np.linalg.cholesky(cov), axis1=1, axis2=2)
    return np.asarray(2.0 * np.log(root).sum(axis=1))


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
        plain=made.plain[at],
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
