"""Overlapping Allan deviation of evenly spaced readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from errormodel.arrays import FloatArray, freeze, readonly


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AllanDeviation:
    """Allan deviation over averaging times.

    Attributes
    ----------
    tau_s : ndarray, shape (k,)
    deviation : ndarray, shape (k,)
        Unit of the readings.
    terms : ndarray, shape (k,)
        Squares that were averaged.
    """

    tau_s: FloatArray
    deviation: FloatArray
    terms: FloatArray

    def __post_init__(self) -> None:
        freeze(
            self,
            tau_s=readonly(self.tau_s),
            deviation=readonly(self.deviation),
            terms=readonly(self.terms),
        )


def allan_deviation(series: Sequence[ArrayLike], period_s: float) -> AllanDeviation:
    """Compute the overlapping Allan deviation, pooled over series, at octaves of the period.

    Parameters
    ----------
    series : sequence of array_like
        Readings `period_s` apart, without gaps; the squares of all are averaged together.
    period_s : float

    Returns
    -------
    AllanDeviation
        Averaging times up to a third of the longest series; empty when all are too short.

    References
    ----------
    NIST SP 1065 (2008), eq. 11: σ²(mτ₀) = Σ (x_{i+2m} − 2x_{i+m} + x_i)² / (2(mτ₀)²(N − 2m)) with
    x the integral of the readings.
    """
    integrals = [np.concatenate([[0.0], np.cumsum(np.asarray(s, float))]) for s in series]
    longest = max((x.size - 1 for x in integrals), default=0)
    found: list[tuple[float, float, int]] = []
    m = 1
    while 3 * m <= longest:
        second = [x[2 * m :] - 2 * x[m:-m] + x[: -2 * m] for x in integrals if x.size > 2 * m]
        squares = np.concatenate(second) ** 2
        found.append((m * period_s, float(np.sqrt(squares.mean() / 2)) / m, squares.size))
        m *= 2
    tau_s, deviation, terms = (np.array([f[k] for f in found], dtype=float) for k in range(3))
    return AllanDeviation(tau_s=tau_s, deviation=deviation, terms=terms)
