"""Rival processes in a coefficient from cycle to cycle, by which a run-in is judged.

Estimate k = 0, 1, … of a coefficient is ``c∞ + A·g(k/κ) + B·v(k) + slips so far + error``.

- g is the law of relaxation: exp(−k/κ), or the slow 1/(1 + k/κ); A may be 0: nothing relaxes.
- v is something slower beside it: a second exponential or a creep without end; B may be 0.
- Slips are kicks before each cycle, of the standard deviation h·g(k/κ) (the less stress is left,
  the smaller), or a random walk of equal steps.
- The error is the estimate's own (its sigma is given) and a scatter ρ between runs that no
  estimate knows of.

κ, h, ρ and the kind and size of what is slow are on a grid of rival hypotheses.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray, IntArray

Law = Literal["exponential", "hyperbolic"]
PLAIN, SECOND, CREEP, WALKS = range(4)  # kinds of what is slow; nothing is, in the first
SLOW_NAMES = {SECOND: "a second relaxation", CREEP: "a creep", WALKS: "a random walk"}

# Odds, beforehand, at which each kind is held against all rivals together. Even odds would bound
# the risk under each strictly, and few accelerometers whose relaxation slips would stop within 25
# cycles; the risk with these was measured (docs/explanation/run-in.md).
SLOW_ODDS = 1.0 / 6.0
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
HORIZON = 60  # cycles looked ahead; what is left after them is counted as one more


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hypotheses:
    """Prior of the rivals under a law for estimates with given sigmas, in limits.

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
    kind: IntArray  # (g,) of what is slow: 0 nothing, 1 a second process, 2 creep, 3 a random walk


def law_shape(law: Law, cycle: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return how much is left after so many cycles, 1 at first."""
    ratio = cycle / kappa
    return np.exp(-ratio) if law == "exponential" else 1.0 / (1.0 + ratio)


def law_bend(law: Law, cycle: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return the derivative of `law_shape` by ln κ."""
    ratio = cycle / kappa
    return ratio * np.exp(-ratio) if law == "exponential" else ratio / (1.0 + ratio) ** 2


def slow_shape(cycle: FloatArray, kappa: float) -> FloatArray:
    """Return the way of a slow process over cycles: 0 at first, 1 after `HORIZON` (creep)."""
    if kappa == 0.0:
        return np.zeros_like(cycle)
    return cycle / HORIZON if np.isinf(kappa) else 1.0 - np.exp(-cycle / kappa)


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

    @property
    def kind(self) -> int:
        """Kind of slow process, as in `Hypotheses`."""
        if self.slow_kappa > 0.0:
            return CREEP if np.isinf(self.slow_kappa) else SECOND
        return WALKS if self.walk > 0.0 else PLAIN


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
        # the same h and ρ whatever goes on: else a kind gains odds by its grid alone
        for rho in scatters:
            for relaxes, h, share in [(False, 0.0, STILL)] + [
                (True, h, (1.0 - STILL) / len(kicks)) for h in kicks
            ]:
                log_prior = float(np.log(prior * share / len(scatters)))
                found.append(_Rival(h, rho, relaxes, kappa, size, walk, log_prior))
    return found


def lay_out(law: Law, sigmas: tuple[float, ...], weigh_slow: bool) -> Hypotheses:
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
    return Hypotheses(
        shape=shape,
        bend=bend,
        slow=slow,
        slow_size=np.tile([r.slow_size or 1.0 for r in rivals], KAPPA.size),
        slip=slip,
        slip_cov=slip_cov,
        inverse=inverse,
        weighed=weighed,
        gram=weighed @ columns,
        log_det=log_det_of(cov),
        log_prior=np.tile([r.log_prior for r in rivals], KAPPA.size),
        kind=np.tile([r.kind for r in rivals], KAPPA.size),
    )


def log_det_of(cov: FloatArray) -> FloatArray:
    """Return the logarithm of the determinants of positive definite matrices (g, n, n)."""
    root = np.diagonal(np.linalg.cholesky(cov), axis1=1, axis2=2)
    return np.asarray(2.0 * np.log(root).sum(axis=1))
