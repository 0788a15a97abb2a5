"""The Kalman filter core, in UD-factorised form: as stable as a square root, no square roots.

The covariance is P = U diag(d) Uᵀ with U unit upper triangular, so it cannot lose symmetry or
become negative however sharp a measurement is against the prior. A measurement is processed as a
scalar (Bierman), a propagation by weighted Gram-Schmidt (Thornton).

References
----------
Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, ch. V-VI.
Grewal, M. S. and Andrews, A. P., Kalman Filtering, ch. 6: the algorithms in code form.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike

from errormodel.arrays import FloatArray, freeze, readonly

# Sums may be taken in another order, so that several of their parts are added at once; not a number
# stays not a number.
REORDERED = {"reassoc", "contract"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class State:
    """An estimate and its covariance, factorised.

    Attributes
    ----------
    x : ndarray, shape (n,)
    u : ndarray, shape (n, n)
        Unit upper triangular.
    d : ndarray, shape (n,)
        Not negative.
    """

    x: FloatArray
    u: FloatArray
    d: FloatArray

    def __post_init__(self) -> None:
        freeze(self, x=readonly(self.x), u=readonly(self.u), d=readonly(self.d))

    @property
    def cov(self) -> FloatArray:
        """Covariance, shape (n, n)."""
        return (self.u * self.d) @ self.u.T

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, shape (n,)."""
        return np.sqrt((self.u**2) @ self.d)


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovation:
    """Innovation of a measurement: observed less predicted, and the expected variance."""

    value: float
    variance: float

    @property
    def nis(self) -> float:
        """Normalised innovation squared: χ² with one degree of freedom when the model is right."""
        return self.value**2 / self.variance


@numba.njit(cache=True)
def factorise(cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return U and d of a covariance; a variance of zero is allowed."""
    n = cov.shape[0]
    p = cov.copy()
    u = np.eye(n)
    d = np.zeros(n)
    for j in range(n - 1, -1, -1):
        d[j] = max(p[j, j], 0.0)
        if d[j] > 0.0:
            for i in range(j):
                u[i, j] = p[i, j] / d[j]
        for k in range(j):
            for i in range(k + 1):
                p[i, k] -= u[i, j] * d[j] * u[k, j]
    return u, d


@numba.njit(cache=True, fastmath=REORDERED)
def bierman_gain(
    u: FloatArray, d: FloatArray, h: FloatArray, variance: float
) -> tuple[FloatArray, float]:
    """Process the covariance of a scalar measurement in place.

    Returns the gain and the variance of the innovation. The columns of `u` are gone through one
    after another: stored by columns it takes a fraction of the time.
    """
    n = d.size
    a = np.zeros(n)
    for j in range(n):
        total = h[j]
        for i in range(j):
            total += u[i, j] * h[i]
        a[j] = total
    b = d * a
    alpha = variance
    for j in range(n):
        before = alpha
        alpha += a[j] * b[j]
        if alpha > 0.0:
            ratio = -a[j] / before if before > 0.0 else 0.0
            d[j] *= before / alpha
            for i in range(j):
                old = u[i, j]
                u[i, j] = old + b[i] * ratio
                b[i] += b[j] * old
    return b / alpha, alpha


@numba.njit(cache=True)
def bierman_update(
    x: FloatArray, u: FloatArray, d: FloatArray, h: FloatArray, variance: float, z: float
) -> tuple[float, float]:
    """Process a scalar measurement in place; return the innovation and its variance."""
    innovation = z - np.dot(h, x)
    gain, total = bierman_gain(u, d, h, variance)
    x += gain * innovation
    return innovation, total


@numba.njit(cache=True, fastmath=REORDERED)
def orthogonalise(u: FloatArray, d: FloatArray, w: FloatArray, weight: FloatArray) -> None:
    """Put U and d of W diag(weight) Wᵀ into the leading part of the factors; W is used up.

    Parameters
    ----------
    u : ndarray, shape (≥ n, ≥ n)
    d : ndarray, shape (≥ n,)
    w : ndarray, shape (n, m)
    weight : ndarray, shape (m,)
    """
    n, m = w.shape
    for j in range(n - 1, -1, -1):
        total = 0.0
        for k in range(m):
            total += weight[k] * w[j, k] * w[j, k]
        d[j] = total
        u[j, j] = 1.0
        for i in range(j):
            share = 0.0
            if total > 0.0:
                for k in range(m):
                    share += weight[k] * w[i, k] * w[j, k]
                share /= total
            u[i, j] = share
            u[j, i] = 0.0
            for k in range(m):
                w[i, k] -= share * w[j, k]


@numba.njit(cache=True)
def thornton_propagate(
    u: FloatArray, d: FloatArray, phi: FloatArray, g: FloatArray, q: FloatArray
) -> None:
    """Propagate the factors in place through P → Φ P Φᵀ + G diag(q) Gᵀ."""
    n = d.size
    m = q.size
    w = np.empty((n, n + m))
    w[:, :n] = phi @ u
    w[:, n:] = g
    weight = np.empty(n + m)
    weight[:n] = d
    weight[n:] = q
    orthogonalise(u, d, w, weight)


def initial_state(x: ArrayLike, cov: ArrayLike) -> State:
    """Return the state before any measurement.

    Parameters
    ----------
    x : array_like, shape (n,)
    cov : array_like, shape (n, n) or (n,)
        Covariance, or the variances of independent unknowns.

    Raises
    ------
    ValueError
        If the shapes do not fit or a variance is negative.
    """
    mean = np.array(x, dtype=float)
    given = np.array(cov, dtype=float)
    matrix = np.diag(given) if given.ndim == 1 else given
    if matrix.shape != (mean.size, mean.size):
        raise ValueError(f"covariance of shape {given.shape} does not fit {mean.size} states")
    if np.any(np.diag(matrix) < 0):
        raise ValueError("a variance is negative")
    u, d = factorise(matrix)
    return State(x=mean, u=u, d=d)


def update(state: State, h: ArrayLike, variance: float, z: float) -> tuple[State, Innovation]:
    """Process a scalar measurement z = h·x + noise.

    Parameters
    ----------
    state : State
    h : array_like, shape (n,)
    variance : float
        Of the measurement noise, > 0.
    z : float

    Returns
    -------
    State, Innovation

    Raises
    ------
    ValueError
        If `variance` is not positive or the measurement is not finite.
    """
    if not variance > 0 or not np.isfinite(z):
        raise ValueError(f"measurement {z} with variance {variance}: both must be finite, > 0")
    x, u, d = state.x.copy(), state.u.copy(), state.d.copy()
    innovation, total = bierman_update(x, u, d, np.asarray(h, dtype=float), variance, float(z))
    return State(x=x, u=u, d=d), Innovation(value=innovation, variance=total)


def propagate(state: State, phi: ArrayLike, g: ArrayLike, q: ArrayLike) -> State:
    """Move the state on: x → Φ x, P → Φ P Φᵀ + G diag(q) Gᵀ.

    Parameters
    ----------
    state : State
    phi : array_like, shape (n, n)
    g : array_like, shape (n, m)
        How the process noises enter.
    q : array_like, shape (m,)
        Their variances over the step.
    """
    matrix = np.ascontiguousarray(phi, dtype=float)
    u, d = state.u.copy(), state.d.copy()
    thornton_propagate(
        u, d, matrix, np.ascontiguousarray(g, dtype=float), np.asarray(q, dtype=float)
    )
    return State(x=matrix @ state.x, u=u, d=d)
