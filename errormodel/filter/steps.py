"""A Kalman filter over many steps, for states of which only the leading few move.

The state is [moving, constant]: attitude errors and the like first, the unknowns of an error model
after them. In the factors P = U diag(d) Uᵀ the block of the constants is not touched when the
leading states move, so that a step costs no more than a measurement. `errormodel.filter.gains`
tells what goes through the gains of a run.

References
----------
Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, ch. V-VI.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import REORDERED, State, bierman_gain, orthogonalise

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


def join_steps(parts: Sequence[Steps]) -> Steps:
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
    """Result of a filter over its steps.

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


@numba.njit(cache=True, fastmath=REORDERED)
def move_leading(u: FloatArray, d: FloatArray, phi: FloatArray, q: FloatArray) -> None:
    """Move the leading states of the factors in place; the others stay as they are.

    The columns of `u` are gone through one after another: it should be stored by columns.
    """
    lead, n = phi.shape
    top = np.empty((lead, n))
    for j in range(n):
        for i in range(lead):
            total = 0.0
            for k in range(j + 1):
                total += phi[i, k] * u[k, j]
            top[i, j] = total
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
    orthogonalise(u, d, w, weight)


@numba.njit(cache=True, fastmath=REORDERED)
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
    # the loops of the core run down the columns of U
    x, u, d = start.x.copy(), np.array(start.u, order="F"), start.d.copy()
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
