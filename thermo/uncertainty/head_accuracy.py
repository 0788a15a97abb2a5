"""What an indexing head's own errors do to the estimates: they repeat, so no scatter shows them."""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.fit import ModelFit
from errormodel.record import Record
from thermo.uncertainty.linearised import Linearised

ARCSEC = np.pi / 180.0 / 3600.0
SIGMAS = 3.0  # of the noise: errors of single positions count when they stand out by that
HARDLY = 1e-4  # of its size left over: nothing is
MANY = 72  # positions; of more, each is visited too seldom to show its own
STEP_RAD = 1e-4  # of the central difference: what is left of it is 1e-9 of the slope


def with_head_accuracy(line: Linearised, sigma_arcsec: float) -> Linearised:
    """Add to a fit's covariance what the head's angle may be wrong by.

    The head's error is an unknown smooth function of its own angle, the same at every visit: an
    offset and two harmonics, a third of the variance each, so that the sigma is `sigma_arcsec` at
    every angle. Where the residual shows that positions err each on its own, each may besides be
    wrong by that. The estimates are left as they are; a parameter that is considered and not
    estimated adds G S Gᵀ to their covariance, with G how far it moves them and S its own
    (Schmidt 1966; Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. 8).

    Parameters
    ----------
    line : Linearised
        Of a record with the signals ``a_i_g``, ``a_p_g`` and ``head_deg``.
    sigma_arcsec : float
        1 sigma of the head's angle, ″.
    """
    head_deg, sigma = line.record["head_deg"], sigma_arcsec * ARCSEC
    by_angle = output_by_angle(line.fit, line.record)
    smooth = by_angle[:, None] * _functions(head_deg)
    moved = [line.moved(smooth) * sigma]
    positions, which = np.unique(np.round(head_deg, 2) % 360.0, return_inverse=True)
    if positions.size <= MANY:
        own = by_angle[:, None] * (which[:, None] == np.arange(positions.size))
        if _stand_out(line, own, smooth):
            moved.append(line.moved(own) * sigma)
    cov = line.fit.cov + sum(m @ m.T for m in moved)
    return replace(line, fit=replace(line.fit, cov=cov))


def _stand_out(line: Linearised, own: FloatArray, smooth: FloatArray) -> bool:
    """Tell whether single positions err by what neither the model nor a smooth function holds."""
    even = line.left(smooth)
    even, strengths, _ = np.linalg.svd(even, full_matrices=False)
    even = even[:, strengths > HARDLY * float(np.linalg.norm(smooth))]
    left = line.left(own)
    left -= even @ (even.T @ left)
    if not float(np.sum(left**2)) > HARDLY * float(np.sum(own**2)):
        return False  # too few positions to show it
    along = left.T @ line.residual
    return float(along @ along) > SIGMAS**2 * float(np.trace(line.variance(left)))


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
