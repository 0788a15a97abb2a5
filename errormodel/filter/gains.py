"""Signatures and covariance shares, propagated through the gains of a filter that has run.

What a candidate that the filter does not know would have left in the innovations is had by sending
its signature through the same gains, and what a single source of error contributes to the final
covariance by sending its covariance through them.

References
----------
Willsky, A. S. and Jones, H. L. (1976), A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems, IEEE Trans. AC-21, for the signatures.
"""

import numba
import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Steps


@numba.njit(cache=True)
def _followed(
    h: FloatArray,
    phi: FloatArray,
    gains: FloatArray,
    by_measurement: FloatArray,
    by_motion: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    steps, m, n = h.shape
    lead = phi.shape[1]
    c = by_measurement.shape[2]
    out = np.zeros((steps, m, c))
    left = np.zeros((n, c))  # what of the candidate the estimate has not followed
    moved = np.zeros((lead, c))
    for k in range(steps):
        for j in range(m):
            nu = out[k, j]
            nu += by_measurement[k, j]
            for i in range(n):
                by = h[k, j, i]
                if by != 0.0:
                    for e in range(c):
                        nu[e] += by * left[i, e]
            for i in range(n):
                gain = gains[k, j, i]
                if gain != 0.0:
                    for e in range(c):
                        left[i, e] -= gain * nu[e]
        for i in range(lead):
            moved[i] = by_motion[k, i]
            for s in range(n):
                by = phi[k, i, s]
                if by != 0.0:
                    for e in range(c):
                        moved[i, e] += by * left[s, e]
        left[:lead] = moved
    return out, left


def candidate_responses(
    steps: Steps, gains: FloatArray, by_measurement: FloatArray, by_motion: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute what c candidates, each of unit size, do to a filter that does not know them.

    Parameters
    ----------
    steps : Steps
        Of the filter that does not know them.
    gains : ndarray, shape (K, m, n)
        `Filtered.gains` of its run.
    by_measurement : ndarray, shape (K, m, c)
        How each enters the measurements.
    by_motion : ndarray, shape (K, ℓ, c)
        How each enters the moving states.

    Returns
    -------
    innovations : ndarray, shape (K, m, c)
        What they leave in the innovations.
    errors : ndarray, shape (n, c)
        Truth less estimate after the last step.
    """
    return _followed(
        np.ascontiguousarray(steps.h),
        np.ascontiguousarray(steps.phi),
        np.ascontiguousarray(gains),
        np.ascontiguousarray(by_measurement),
        np.ascontiguousarray(by_motion),
    )


def signatures(
    steps: Steps, gains: FloatArray, by_measurement: FloatArray, by_motion: FloatArray
) -> FloatArray:
    """Return the innovations of `candidate_responses`, shape (K, m, c)."""
    return candidate_responses(steps, gains, by_measurement, by_motion)[0]


@numba.njit(cache=True)
def _share(
    h: FloatArray, phi: FloatArray, gains: FloatArray, cov: FloatArray, r: FloatArray, q: FloatArray
) -> None:
    steps, m, n = h.shape
    lead = phi.shape[1]
    for k in range(steps):
        for j in range(m):
            gain = gains[k, j]
            ph = cov @ h[k, j]
            hph = np.dot(h[k, j], ph) + r[k, j]
            for a in range(n):
                for b in range(n):
                    cov[a, b] += gain[a] * gain[b] * hph - gain[a] * ph[b] - ph[a] * gain[b]
        top = phi[k] @ cov
        corner = top @ phi[k].T
        for a in range(lead):
            corner[a, a] += q[k, a]
            for b in range(lead, n):
                cov[a, b] = top[a, b]
                cov[b, a] = top[a, b]
        cov[:lead, :lead] = corner


def covariance_share(
    steps: Steps, gains: FloatArray, start_cov: FloatArray, r: FloatArray, q: FloatArray
) -> FloatArray:
    """Compute what some of the sources of error contribute to a filter's final covariance.

    Parameters
    ----------
    steps : Steps
    gains : ndarray, shape (K, m, n)
        Of the filter that knows all sources.
    start_cov : ndarray, shape (n, n)
        The part of the start's covariance to follow.
    r : ndarray, shape (K, m)
        The part of the measurement noise to follow.
    q : ndarray, shape (K, ℓ)
        The part of the motion's noise to follow.

    Returns
    -------
    ndarray, shape (n, n)
        Over sources that together make up all, the results add up to the filter's covariance.
    """
    cov = np.array(start_cov, dtype=float)
    _share(
        np.ascontiguousarray(steps.h),
        np.ascontiguousarray(steps.phi),
        np.ascontiguousarray(gains),
        cov,
        np.ascontiguousarray(r),
        np.ascontiguousarray(q),
    )
    return cov


@numba.njit(cache=True)
def _transition(h: FloatArray, phi: FloatArray, gains: FloatArray, across: FloatArray) -> None:
    steps, m, n = h.shape
    lead = phi.shape[1]
    for k in range(steps):
        for j in range(m):
            seen = h[k, j] @ across
            for a in range(n):
                for b in range(n):
                    across[a, b] -= gains[k, j, a] * seen[b]
        across[:lead] = phi[k] @ across


def start_transition(steps: Steps, gains: FloatArray) -> FloatArray:
    """Compute how the error at a filter's start goes over into that at its end.

    Parameters
    ----------
    steps : Steps
    gains : ndarray, shape (K, m, n)
        Of the filter.

    Returns
    -------
    ndarray, shape (n, n)
        A: a part P of the start's covariance contributes A P Aᵀ to the final one.
    """
    across = np.eye(steps.h.shape[2])
    _transition(
        np.ascontiguousarray(steps.h),
        np.ascontiguousarray(steps.phi),
        np.ascontiguousarray(gains),
        across,
    )
    return across
