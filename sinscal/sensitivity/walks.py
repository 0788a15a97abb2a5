"""Random walks of gyros and accelerometers together, as large as a run leaves them likely.

Where one kind wanders the other often does, and beside the larger walk the smaller one does not
show by itself. So once a run shows a walk, both are given one: of the most likely correlation time,
and of the mean variance over all pairs of sizes, each weighted by its probability. The size that is
itself most likely would be zero wherever a walk just does not show; the mean is as large as the run
leaves open, and the sigmas carry it. A walk of standard deviation σ and correlation time τ over a
run of length T is a sum of waves cos(kπt/T) of variances 4σ²τ / (T(1 + (kπτ/T)²)); sent through the
gains of a filter that knows of no walk, they tell the likelihood of every σ and τ.

References
----------
Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
related problems, J. Am. Stat. Assoc. 72.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import independent
from sinscal.library.jump import DRIFT_SIGMAS, DRIFTS
from sinscal.sensitivity.problem import FilterProblem

WAVES = 20  # half waves over the run: a walk of T/32 still has three quarters of its power in them
TAU_SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)  # correlation times tried, of the run
SIZES = np.logspace(-3.0, 1.0, 41)  # sigmas tried, in those expected: `DRIFT_SIGMAS`


@dataclass(frozen=True, slots=True, kw_only=True)
class Walks:
    """Sigmas of both kinds' walks about their mean, rad/s and m/s², and their common time, s."""

    gyro: float
    accel: float
    tau_s: float


def likely_walks(problem: FilterProblem, variance: float) -> Walks:
    """Return the walks of both kinds that a run leaves likely.

    Parameters
    ----------
    problem : FilterProblem
        Of a calibration whose filter allows for no walk.
    variance : float
        Of the normalised innovations, 1 where the noise is as stated.
    """
    at = problem.elapsed_s - problem.elapsed_s[0]
    span_s = float(at[-1])
    information, score = _of_waves(problem, at / span_s)
    information, score = information / variance, score / variance
    shapes = [np.tile(_shape(share * span_s, span_s), 3) for share in TAU_SHARES]
    likelihood = np.array([walks_likelihood(information, score, shape) for shape in shapes])
    # beforehand a size is |N(0, 1)|, and a point of a logarithmic grid stands for its width
    before = np.log(SIZES) - 0.5 * SIZES**2
    weight = likelihood + before[:, None] + before
    k = int(np.argmax(logsumexp(weight, axis=(1, 2))))
    share = np.exp(weight[k] - logsumexp(weight[k]))
    rms = np.sqrt([share.sum(axis=1 - kind) @ SIZES**2 for kind in range(2)])
    sigmas = {e.drift: s for e, s in zip(DRIFTS, rms.tolist(), strict=True)}
    return Walks(
        gyro=sigmas["gyro"] * DRIFT_SIGMAS["gyro"],
        accel=sigmas["accel"] * DRIFT_SIGMAS["accel"],
        tau_s=TAU_SHARES[k] * span_s,
    )


def _of_waves(problem: FilterProblem, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return information and score of all waves of all kinds, in expected sigmas."""
    waves = np.cos(np.pi * np.outer(share, np.arange(1, WAVES + 1)))
    parts: list[FloatArray] = []
    for effect in DRIFTS:
        _, h, phi = problem.columns_of(effect)
        wide = [(a[:, :, :, None] * waves[:, None, None, :]).reshape(*a.shape[:2], -1)
                for a in (h, phi)]  # fmt: skip
        parts.append((effect.prior_sigma or 0.0) * problem.normalised(*wide))
    columns = np.hstack(parts)
    bearing = independent(problem.bearing())
    columns -= bearing @ (bearing.T @ columns)
    residual = problem.residual - bearing @ (bearing.T @ problem.residual)
    return columns.T @ columns, columns.T @ residual


def _shape(tau_s: float, span_s: float) -> FloatArray:
    """Return the sigma of every wave of a walk of unit sigma, shape (WAVES,)."""
    turned = np.pi * np.arange(1, WAVES + 1) * tau_s / span_s
    return np.sqrt(4.0 * tau_s / span_s / (1.0 + turned**2))


def walks_likelihood(information: FloatArray, score: FloatArray, shape: FloatArray) -> FloatArray:
    """Return by how much walks of all pairs of `SIZES` raise the log likelihood, shape (s, s).

    The first kind's waves are eliminated at each of its sizes; of what is left of the second's the
    eigenvalues tell every size.

    Parameters
    ----------
    information : ndarray, shape (2n, 2n)
        Of the n waves of the first kind and the n of the second.
    score : ndarray, shape (2n,)
    shape : ndarray, shape (n,)
        Sigmas of the waves of a walk of size one, of either kind.
    """
    n = shape.size
    both = np.tile(shape, 2)
    scaled, seen = both[:, None] * information * both, both * score
    of_first, axes = np.linalg.eigh(scaled[:n, :n])
    across, seen_first = axes.T @ scaled[:n, n:], axes.T @ seen[:n]
    out = np.empty((SIZES.size, SIZES.size))
    for i, power in enumerate(SIZES**2):
        more = 1.0 + power * np.maximum(of_first, 0.0)
        taken = power / more
        first = np.sum(taken * seen_first**2 - np.log(more))
        of_second, axes = np.linalg.eigh(scaled[n:, n:] - across.T @ (taken[:, None] * across))
        left = axes.T @ (seen[n:] - across.T @ (taken * seen_first))
        more = 1.0 + SIZES[:, None] ** 2 * np.maximum(of_second, 0.0)
        out[i] = 0.5 * (first + np.sum(SIZES[:, None] ** 2 * left**2 / more - np.log(more), axis=1))
    return out
