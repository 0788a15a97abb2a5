"""Effect of an indexing head's errors on the estimates: they repeat, so no scatter shows them."""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.fit import ModelFit
from errormodel.record import Record
from thermo.uncertainty.linearised import Effects, LinearisedFit

ARCSEC = np.pi / 180.0 / 3600.0
SIGMAS = 3.0  # of the noise: errors of single positions count when they stand out by that
HARDLY = 1e-4  # of its size left over: nothing is
MANY = 72  # positions; of more, each is visited too seldom to show its own
FUNCTIONS = 5  # an offset and two harmonics
STEP_RAD = 1e-4  # of the central difference: what is left of it is 1e-9 of the slope


def with_head_accuracy(line: LinearisedFit, sigma_arcsec: float) -> LinearisedFit:
    """Add to a fit's covariance what the head's angle may be wrong by.

    The head's error is an unknown smooth function of its own angle, the same at every visit: an
    offset and two harmonics, a third of the variance each, so that the sigma is `sigma_arcsec` at
    every angle. Where the residual shows that positions err each on its own, each may besides be
    wrong by that. The estimates are left as they are; a parameter that is considered and not
    estimated adds G S Gᵀ to their covariance, with G how far it moves them and S its own
    (Schmidt 1966; Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. 8).

    Parameters
    ----------
    line : LinearisedFit
        Of a record with the signals ``a_i_g``, ``a_p_g`` and ``head_deg``.
    sigma_arcsec : float
        1 sigma of the head's angle, ″.
    """
    head_deg, sigma = line.record["head_deg"], sigma_arcsec * ARCSEC
    by_angle = output_by_angle(line.fit, line.record)

    def smooth(rows: slice) -> FloatArray:
        return by_angle[rows, None] * _functions(head_deg[rows])

    moved = [line.by_normal(line.pull(smooth)) * sigma]
    positions, which = np.unique(np.round(head_deg, 2) % 360.0, return_inverse=True)
    if positions.size <= MANY:

        def own(rows: slice) -> FloatArray:
            return by_angle[rows, None] * (which[rows, None] == np.arange(positions.size))

        if _stand_out(line, own, smooth, positions.size):
            moved.append(line.by_normal(line.pull(own)) * sigma)
    cov = line.fit.cov + sum(m @ m.T for m in moved)
    return replace(line, fit=replace(line.fit, cov=cov))


def _stand_out(line: LinearisedFit, own: Effects, smooth: Effects, count: int) -> bool:
    """Tell whether single positions err by what neither the model nor a smooth function holds."""
    gram, size2, own2 = np.zeros((FUNCTIONS + count,) * 2), 0.0, 0.0
    for rows, left in line.left(lambda rows: np.hstack([smooth(rows), own(rows)])):
        gram += left.T @ left
        size2 += float(np.sum(smooth(rows) ** 2))
        own2 += float(np.sum(own(rows) ** 2))
    strengths2, vectors = np.linalg.eigh(gram[:FUNCTIONS, :FUNCTIONS])
    seen = strengths2 > HARDLY**2 * size2
    even = vectors[:, seen] / np.sqrt(strengths2[seen])
    taken = even @ (even.T @ gram[:FUNCTIONS, FUNCTIONS:])
    sums = line.sums(line.left(lambda rows: own(rows) - smooth(rows) @ taken), count)
    if not float(np.trace(sums.gram)) > HARDLY * own2:
        return False  # too few positions to show it
    return float(sums.along @ sums.along) > SIGMAS**2 * float(np.trace(sums.cov))


def _functions(head_deg: FloatArray) -> FloatArray:
    angle = np.deg2rad(head_deg)
    harmonics = [f(k * angle) for k in (1, 2) for f in (np.sin, np.cos)]
    return np.column_stack([np.ones(angle.size), *harmonics]) / np.sqrt(3.0)


def output_by_angle(fitted: ModelFit, record: Record) -> FloatArray:
    """Return the output's derivative by the angle the accelerometer stands at, per rad."""
    a_i, a_p = record["a_i_g"], record["a_p_g"]
    cosine, sine = np.cos(STEP_RAD), np.sin(STEP_RAD)

    def turned(way: float) -> FloatArray:
        at = record.with_signals(
            a_i_g=a_i * cosine + way * a_p * sine, a_p_g=a_p * cosine - way * a_i * sine
        )
        return fitted.model.simulate(at, fitted.as_dict())

    return (turned(1.0) - turned(-1.0)) / (2.0 * STEP_RAD)
