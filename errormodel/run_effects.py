"""Run effects: effects that take a new value in each run, and their sigmas.

Each run r adds ``J_r C u_r`` to the output, with J_r the derivative of the model in that run, C
fixed directions (the bias, the scale factor, the temperature) and u_r ~ N(0, diag(σ²)). With few
runs a σ is hardly known. So it is not one number but a distribution over none at all and each
octave from half of what a run can show up to 8000 times that, weighed by the restricted likelihood
of the readings. Whether runs differ is asked with even odds beforehand. What they may differ by,
with none as likely as each octave: even odds would take few runs that agree by chance for proof,
and of two runs that differ by five times what they show 83 % would lie within 1.96 sigma. What is
stated is the sigma of which 1.96 hold 95 % of the mixture: with few runs it widens as Student's t
does.

References
----------
Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
related problems, JASA 72, 320-338.
Gelman, A. (2006), Prior distributions for variance parameters in hierarchical models, Bayesian
Analysis 1, 515-534: why a best value alone is too sure with few groups.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import optimize, stats

from errormodel.arrays import FloatArray, IntArray
from errormodel.blocks import parts_of_runs
from errormodel.columns import Columns
from errormodel.noise.model import NoiseModel
from errormodel.record import Record

OCTAVES = 15
COARSE = 2  # octaves between the tries of all effects together
LEAST_SHARE = 0.01  # of a combination that is looked at closer
# In units of what a run can show; and how likely each is before anything was read.
GRID = np.concatenate([[0.0], 2.0 ** np.arange(-1, OCTAVES - 1)])
PRIOR = np.concatenate([[0.5], np.full(OCTAVES, 0.5 / OCTAVES)])
Z95 = 1.959964


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEffect:
    """Difference of an effect from run to run.

    Attributes
    ----------
    name : str
    likely : float
        The sigma that is most likely; 0 when none is.
    mean_sigma : float
        Allows for it in what is common to the runs: 1.96 of it, with the noise, hold 95 %.
    seen_sigma : float
        The median: of what differs between these runs, which the readings show.
    next_sigma : float
        The same for one run more.
    odds : float
        Probability that there is any.
    sigmas, shares : tuple of float
        The mixture: sigmas, and how likely each is.
    by_run, noise_by_run : tuple of float
        What each run shows, and how well it does.
    """

    name: str
    likely: float
    mean_sigma: float
    seen_sigma: float
    next_sigma: float
    odds: float
    sigmas: tuple[float, ...]
    shares: tuple[float, ...]
    by_run: tuple[float, ...]
    noise_by_run: tuple[float, ...]


def run_grams(
    record: Record, noise: NoiseModel, columns: Columns, residual: FloatArray
) -> FloatArray:
    """Return the Gram matrix of each run's whitened columns and residual, (runs, p + 1, p + 1)."""
    width, runs = columns.shape[1] + 1, record.run_slices
    grams = np.zeros((len(runs), width, width))
    whitener = noise.block_whitener(width)  # it begins afresh with each run
    for rows, block in columns.blocks():
        joint = np.column_stack([block, residual[rows]])
        white = whitener.whiten(record.view(rows), joint)
        for number, part in parts_of_runs(runs, rows):
            mine = white[part.start - rows.start : part.stop - rows.start]
            grams[number] += mine.T @ mine
    return grams / noise.white**2


def estimate_run_effects(
    grams: FloatArray,
    directions: FloatArray,
    names: Sequence[str],
    reach: FloatArray,
    noise_variance: FloatArray,
) -> tuple[RunEffect, ...]:
    """Estimate how the runs differ.

    Parameters
    ----------
    grams : ndarray, shape (runs, p + 1, p + 1)
        As `run_grams` returns them, of derivative and residual.
    directions : ndarray, shape (p, q)
        Each effect as a change of the coefficients.
    names : sequence of str, length q
    reach : ndarray, shape (q,)
        Variance of what is common to the runs, per variance of the effect: 1/runs when they
        count alike.
    noise_variance : ndarray, shape (q,)
        Variance of what is common to the runs by the noise alone.

    Returns
    -------
    tuple of RunEffect, length q
        Empty with a single run.
    """
    if len(grams) < 2 or not names:
        return ()
    p, q = directions.shape
    seen = np.einsum("pi,rpk,kj->rij", directions, grams[:, :p, :p], directions)
    unit = 1.0 / np.sqrt(np.mean(np.einsum("rii->ri", seen), axis=0))
    joint, points = _joint(grams, directions, seen, unit)
    shares = np.array(
        [_marginal(grams, directions, seen, unit, k, joint, points) for k in range(q)]
    )
    grid = GRID
    at = np.argmax(shares, axis=1)
    wide = shares / PRIOR
    wide /= wide.sum(axis=1, keepdims=True)
    shown, sure = _shown(grams, directions, seen)
    return tuple(
        RunEffect(
            name=names[k],
            likely=float(grid[at[k]] * unit[k]),
            mean_sigma=_held(wide[k], (grid * unit[k]) ** 2 * reach[k], noise_variance[k])
            / float(np.sqrt(reach[k])),
            seen_sigma=_median(shares[k], grid * unit[k]),
            next_sigma=_held(wide[k], (grid * unit[k]) ** 2, 0.0),
            odds=float(1.0 - shares[k, 0]),
            sigmas=tuple((grid * unit[k]).tolist()),
            shares=tuple(wide[k].tolist()),
            by_run=tuple(shown[:, k].tolist()),
            noise_by_run=tuple(sure[:, k].tolist()),
        )
        for k in range(q)
    )


def _joint(
    grams: FloatArray, directions: FloatArray, seen: FloatArray, unit: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return the shares of a coarse grid over all effects together, and its points.

    One effect at a time would give what belongs to one of two that are alike to the first.
    """
    coarse = np.arange(0, GRID.size, COARSE)
    points = np.array(list(product(coarse.tolist(), repeat=unit.size)))
    likely = _restricted(grams, directions, seen, GRID[points] * unit)
    share = np.prod(PRIOR[points], axis=1) * np.exp(likely - likely.max())
    return share / share.sum(), points


def _marginal(
    grams: FloatArray,
    directions: FloatArray,
    seen: FloatArray,
    unit: FloatArray,
    k: int,
    joint: FloatArray,
    points: IntArray,
) -> FloatArray:
    """Return the shares of one effect's sigmas, over the others as they are likely."""
    others = np.delete(points, k, axis=1)
    cases, which = np.unique(others, axis=0, return_inverse=True)
    kept = cases[np.bincount(which.ravel(), weights=joint) > LEAST_SHARE]
    tried = np.repeat(np.insert(kept, k, 0, axis=1), GRID.size, axis=0)
    tried[:, k] = np.tile(np.arange(GRID.size), len(kept))
    likely = _restricted(grams, directions, seen, GRID[tried] * unit)
    share = np.prod(PRIOR[tried], axis=1) * np.exp(likely - likely.max())
    by_sigma = share.reshape(len(kept), GRID.size).sum(axis=0)
    return np.asarray(by_sigma / by_sigma.sum())


def _restricted(
    grams: FloatArray, directions: FloatArray, seen: FloatArray, sigmas: FloatArray
) -> FloatArray:
    """Return the restricted log-likelihood of sets of sigmas (m, q), shape (m,)."""
    p, q = directions.shape
    across = np.einsum("pi,rpk->rik", directions, grams[:, :p, :])
    scaled = sigmas[:, None, :, None] * across  # (m, r, q, p + 1)
    inner = sigmas[:, None, :, None] * seen * sigmas[:, None, None, :] + np.eye(q)
    solved = _solved(inner, scaled)
    total = grams.sum(axis=0) - np.einsum("mriw,mriv->mwv", scaled, solved)
    norms = np.sqrt(np.diag(grams.sum(axis=0)))[:p]
    norms = np.where(norms > 0, norms, 1.0)
    information = total[:, :p, :p] / np.outer(norms, norms) + 1e-13 * np.eye(p)
    target = total[:, :p, p] / norms
    found = _solved(information, target[:, :, None])[:, :, 0]
    rest = total[:, p, p] - np.einsum("mp,mp->m", found, target)
    by_runs = np.linalg.slogdet(inner)[1].sum(axis=1)
    return np.asarray(-0.5 * (by_runs + np.linalg.slogdet(information)[1] + rest))


def _solved(matrices: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions of many small systems."""
    same = np.asarray(matrices, dtype=np.float64), np.asarray(right, dtype=np.float64)
    return np.asarray(np.linalg.solve(*same))


def _shown(
    grams: FloatArray, directions: FloatArray, seen: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return each effect as each run's residual shows it alone, and its sigma, shape (runs, q)."""
    p = directions.shape[0]
    length = np.einsum("rii->ri", seen)
    length = np.where(length > 0, length, np.inf)
    along = np.einsum("pi,rp->ri", directions, grams[:, :p, p])
    return along / length, 1.0 / np.sqrt(length)


def _median(share: FloatArray, sigmas: FloatArray) -> float:
    """Return the sigma that half of the mixture lies below, between those of the grid."""
    below = np.cumsum(share) - 0.5 * share
    return float(np.interp(0.5, below, sigmas))


def _held(share: FloatArray, variance: FloatArray, noise: float) -> float:
    """Return the sigma beyond the noise of which 1.96 hold 95 % of a mixture of normals."""
    sigma = np.sqrt(variance + noise)
    if not sigma.max() > 0:
        return 0.0

    def outside(log_half: float) -> float:
        z = np.exp(log_half) / np.where(sigma > 0, sigma, 1e-300)
        tail = np.asarray(stats.norm.sf(z), dtype=np.float64)
        return 2.0 * float(share @ tail) - 0.05

    low = np.log(1e-6 * sigma.max())
    if outside(low) <= 0:
        return 0.0
    half = float(np.exp(optimize.brentq(outside, low, np.log(4.0 * sigma.max()))))
    return float(np.sqrt(max((half / Z95) ** 2 - noise, 0.0)))
