"""What an indexing head's own errors do to the estimates: they repeat, so no scatter shows them."""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.fit import ModelFit
from errormodel.record import Record
from thermo.linearised import Linearised

ARCSEC = np.pi / 180.0 / 3600.0
SHOWN = 0.1  # of the head's sigma: errors of single positions that the residual shows
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
    moved = [line.moved(by_angle[:, None] * _functions(head_deg)) * sigma]
    positions, which = np.unique(np.round(head_deg, 2) % 360.0, return_inverse=True)
    if positions.size <= MANY:
        own = by_angle[:, None] * (which[:, None] == np.arange(positions.size))
        if _shown_rad(line, own) > SHOWN * sigma:
            moved.append(line.moved(own) * sigma)
    cov = line.fit.cov + sum(m @ m.T for m in moved)
    return replace(line, fit=replace(line.fit, cov=cov))


def _shown_rad(line: Linearised, own: FloatArray) -> float:
    """Return the angle errors of single positions that the residual shows, rms."""
    left = line.left(own)
    gram = left.T @ left
    along = left.T @ line.residual
    spread = float(np.sum(gram**2))  # expected of the along's square per variance of an angle
    return float(np.sqrt(along @ along / spread)) if spread > 0 else 0.0


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
