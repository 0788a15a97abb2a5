"""A Kalman filter over many steps, for states of which only the leading few move.

The state is [moving, constant]: attitude errors and the like first, the unknowns of an error model
after them. In the factors P = U diag(d) Uᵀ the block of the constants is not touched when the
leading states move, so that a step costs no more than a measurement. What a candidate that the
filter does not know would have left in the innovations is had by sending its signature through the
same gains (`signatures`), and what a single source of error contributes to the final covariance by
sending its covariance through them (`covariance_share`).

References
----------
Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, ch. V-VI.
Willsky, A. S. and Jones, H. L. (1976), A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems, IEEE Trans. AC-21, for the signatures.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray
from errormodel.kalman import State, bierman_gain

BoolArray = NDArray[np.bool_]
NO_GATE = np.inf


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Steps:
    """K steps of a filter of n states of which the leading ℓ move: measure, then move.

    Attributes
    ----------
    h : ndarray, shape (K, m, n)
        Rows of m scalar measurements.
    z : ndarray, shape (K, m)
        What was measured; NaN where nothing was.
    r : ndarray, shape (K, m)
        Variances of their noise.
    phi : ndarray, shape (K, ℓ, n)
        The moving states after the step, from all states before it.
    q : ndarray, shape (K, ℓ)
        Variances of what noise adds to them.
    """

    h: FloatArray
    z: FloatArray
    r: FloatArray
    phi: FloatArray
    q: FloatArray


def joined(parts: Sequence[Steps]) -> Steps:
    """Return steps of the same states and measurements, one part after another."""
    return Steps(
        h=np.concatenate([p.h for p in parts]),
        z=np.concatenate([p.z for p in parts]),
        r=np.concatenate([p.r for p in parts]),
        phi=np.concatenate([p.phi for p in parts]),
        q=np.concatenate([p.q for p in parts]),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Filtered:
    """What a filter makes of its steps.

    Attributes
    ----------
    state : State
        After the last step.
    innovation, variance : ndarray, shape (K, m)
        Of every scalar measurement, NaN where there was none.
    used : ndarray of bool, shape (K, m)
        False where nothing was measured or the gate refused it.
    sigmas : ndarray, shape (K // every, n)
        Standard deviations after every so many steps.
    gains : ndarray, shape (K, m, n)
        Of the measurements used, 0 for the others; empty unless asked for.
    """

    state: State
    innovation: FloatArray
    variance: FloatArray
    used: BoolArray
    sigmas: FloatArray
    gains: FloatArray

    @property
    def normalised(self) -> FloatArray:
        """The innovations used, each over its sigma, in their order, shape (number used,)."""
        return self.innovation[self.used] / np.sqrt(self.variance[self.used])


@numba.njit(cache=True)
def move_leading(u: FloatArray, d: FloatArray, phi: FloatArray, q: FloatArray) -> None:
    """Move the leading states of the factors in place; the others stay as they are."""
    lead, n = phi.shape
    top = np.zeros((lead, n))
    for i in range(lead):
        for k in range(n):
            p = phi[i, k]
            if p != 0.0:
                for j in range(k, n):
                    top[i, j] += p * u[k, j]
    w = np.zeros((lead, 2 * lead))
    weight = np.empty(2 * lead)
    for i in range(lead):
        weight[i] = d[i]
        weight[lead + i] = q[i]
        w[i, lead + i] = 1.0
        for j in range(lead):
            w[i, j] = top[i, j]
        for j in range(lead, n):
            u[i, j] = top[i, j]
    for j in range(lead - 1, -1, -1):
        total = 0.0
        for k in range(2 * lead):
            total += weight[k] * w[j, k] * w[j, k]
        d[j] = total
        u[j, j] = 1.0
        for i in range(j):
            share = 0.0
            if total > 0.0:
                for k in range(2 * lead):
                    share += weight[k] * w[i, k] * w[j, k]
                share /= total
            u[i, j] = share
            u[j, i] = 0.0
            for k in range(2 * lead):
                w[i, k] -= share * w[j, k]


@numba.njit(cache=True)
def _predicted_variance(u: FloatArray, d: FloatArray, h: FloatArray) -> float:
    total = 0.0
    for j in range(d.size):
        a = h[j]
        for i in range(j):
            a += u[i, j] * h[i]
        total += d[j] * a * a
    return total


@numba.njit(cache=True)
def _run(
    x: FloatArray,
    u: FloatArray,
    d: FloatArray,
    h: FloatArray,
    z: FloatArray,
    r: FloatArray,
    phi: FloatArray,
    q: FloatArray,
    gate2: float,
    every: int,
    gains: FloatArray,
    sigmas: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    steps, m, n = h.shape
    lead = phi.shape[1]
    innovation = np.full((steps, m), np.nan)
    variance = np.full((steps, m), np.nan)
    used = np.zeros((steps, m), dtype=np.bool_)
    keep = gains.shape[0] > 0
    for k in range(steps):
        for j in range(m):
            if np.isnan(z[k, j]):
                continue
            nu = z[k, j] - np.dot(h[k, j], x)
            if gate2 < np.inf:
                s = _predicted_variance(u, d, h[k, j]) + r[k, j]
                if nu * nu > gate2 * s:
                    innovation[k, j] = nu
                    variance[k, j] = s
                    continue
            gain, s = bierman_gain(u, d, h[k, j], r[k, j])
            x += gain * nu
            if keep:
                gains[k, j] = gain
            innovation[k, j] = nu
            variance[k, j] = s
            used[k, j] = True
        moved = np.zeros(lead)
        for i in range(lead):
            moved[i] = np.dot(phi[k, i], x)
        x[:lead] = moved
        move_leading(u, d, phi[k], q[k])
        if (k + 1) % every == 0:
            for i in range(n):
                total = 0.0
                for j in range(i, n):
                    total += u[i, j] * u[i, j] * d[j]
                sigmas[k // every, i] = np.sqrt(total)
    return innovation, variance, used


def run_filter(
    start: State,
    steps: Steps,
    *,
    gate: float = NO_GATE,
    every: int = 60,
    with_gains: bool = False,
) -> Filtered:
    """Run a filter over its steps.

    Parameters
    ----------
    start : State
        Of n states, the moving ones first.
    steps : Steps
    gate : float
        A scalar measurement is refused when its innovation exceeds so many of its sigmas.
    every : int
        Steps between two entries of `sigmas`.
    with_gains : bool
        Whether the gains are kept: K·m·n numbers.

    Returns
    -------
    Filtered

    Raises
    ------
    ValueError
        If the shapes do not fit.
    """
    count, m, n = steps.h.shape
    lead = steps.phi.shape[1]
    if steps.phi.shape != (count, lead, n) or start.x.size != n or steps.q.shape != (count, lead):
        raise ValueError(
            f"h {steps.h.shape}, phi {steps.phi.shape}, q {steps.q.shape} do not fit "
            f"{start.x.size} states"
        )
    x, u, d = start.x.copy(), start.u.copy(), start.d.copy()
    gains = np.zeros((count if with_gains else 0, m, n))
    sigmas = np.zeros((count // every, n))
    innovation, variance, used = _run(
        x,
        u,
        d,
        np.ascontiguousarray(steps.h),
        np.ascontiguousarray(steps.z, dtype=float),
        np.ascontiguousarray(steps.r),
        np.ascontiguousarray(steps.phi),
        np.ascontiguousarray(steps.q),
        gate**2,
        every,
        gains,
        sigmas,
    )
    return Filtered(
        state=State(x=x, u=u, d=d),
        innovation=innovation,
        variance=variance,
        used=used,
        sigmas=sigmas,
        gains=gains,
    )


@numba.njit(cache=True)
def _signatures(
    h: FloatArray,
    phi: FloatArray,
    gains: FloatArray,
    by_measurement: FloatArray,
    by_motion: FloatArray,
) -> FloatArray:
    steps, m, n = h.shape
    lead = phi.shape[1]
    c = by_measurement.shape[2]
    out = np.zeros((steps, m, c))
    left = np.zeros((n, c))  # what of the candidate the estimate has not followed
    for k in range(steps):
        for j in range(m):
            for e in range(c):
                nu = by_measurement[k, j, e]
                for i in range(n):
                    nu += h[k, j, i] * left[i, e]
                out[k, j, e] = nu
                for i in range(n):
                    left[i, e] -= gains[k, j, i] * nu
        moved = np.zeros((lead, c))
        for i in range(lead):
            for e in range(c):
                total = by_motion[k, i, e]
                for s in range(n):
                    total += phi[k, i, s] * left[s, e]
                moved[i, e] = total
        left[:lead] = moved
    return out


def signatures(
    steps: Steps, gains: FloatArray, by_measurement: FloatArray, by_motion: FloatArray
) -> FloatArray:
    """Compute what c candidates, each of unit size, leave in the innovations of a filter.

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
    ndarray, shape (K, m, c)
    """
    return _signatures(
        np.ascontiguousarray(steps.h),
        np.ascontiguousarray(steps.phi),
        np.ascontiguousarray(gains),
        np.ascontiguousarray(by_measurement),
        np.ascontiguousarray(by_motion),
    )


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
