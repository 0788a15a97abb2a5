"""Robust statistics that a few wrong values do not move: regression, running median, sequences."""

from bisect import bisect_left

import numpy as np
from scipy.ndimage import median_filter

from errormodel.arrays import BoolArray, FloatArray

MAD_TO_SIGMA = 1.4826  # of a normal distribution: 1 / Φ⁻¹(3/4)
BISQUARE = 4.685  # Tukey's constant for 95 % efficiency at the normal distribution
STEPS = 20


def robust_sigma(values: FloatArray) -> float:
    """Return 1.4826 times the median absolute value: the sigma of a normal variable of mean 0."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values))) if len(values) else 0.0


def running_median(values: FloatArray, half: int) -> FloatArray:
    """Return the median over each value and its `half` neighbours on either side, shape (n,).

    At the ends the series is mirrored, so that the first and the last value stand once in their
    own windows. A monotone series and a lasting step come back as they are.
    """
    half = min(half, max(len(values) - 1, 0))
    if half == 0:
        return values.copy()
    return np.asarray(median_filter(values, size=2 * half + 1, mode="mirror"), dtype=np.float64)


def bisquare_fit(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Fit a linear model by Tukey's bisquare, from a start that minimises absolute residuals.

    Parameters
    ----------
    columns : ndarray, shape (n, p)
        Regressors; may be rank deficient, the solution is then one of minimum norm.
    values : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (p,)

    References
    ----------
    Huber and Ronchetti, Robust Statistics, 2nd ed., chapter 7 (iteratively reweighted least
    squares).
    """
    scale = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(scale > 0, scale, 1.0)
    weight = np.ones(len(values))
    solution = np.zeros(columns.shape[1])
    for step in range(STEPS):
        root = np.sqrt(weight)[:, None]
        before = solution
        solution = np.linalg.lstsq(root * scaled, root[:, 0] * values, rcond=1e-10)[0]
        residual = values - scaled @ solution
        sigma = robust_sigma(residual)
        if sigma == 0:
            break
        if step < STEPS // 2:  # absolute residuals: any start leads to the one minimum
            weight = 1.0 / np.maximum(np.abs(residual), 1e-3 * sigma)
            weight /= weight.max()
        else:
            weight = np.clip(1 - (residual / (BISQUARE * sigma)) ** 2, 0, None) ** 2
            if np.allclose(solution, before, rtol=1e-9, atol=1e-12 * np.abs(solution).max()):
                break
    return solution / np.where(scale > 0, scale, 1.0)


def longest_increasing(values: FloatArray) -> BoolArray:
    """Return which values make the longest strictly increasing sequence, shape (n,).

    Values that are no number are left out.

    References
    ----------
    Fredman, On computing the length of longest increasing subsequences, Discrete Mathematics 11
    (1975).
    """
    tails: list[float] = []
    ends: list[int] = []
    before = np.full(len(values), -1, dtype=np.int64)
    for i, value in enumerate(values.tolist()):
        if value != value:
            continue
        at = bisect_left(tails, value)
        if at == len(tails):
            tails.append(value)
            ends.append(i)
        elif value < tails[at]:  # of equal values the first stays
            tails[at], ends[at] = value, i
        else:
            continue
        before[i] = ends[at - 1] if at else -1
    keep = np.zeros(len(values), dtype=np.bool_)
    i = ends[-1] if ends else -1
    while i >= 0:
        keep[i] = True
        i = int(before[i])
    return keep
