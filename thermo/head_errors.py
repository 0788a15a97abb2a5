"""What an indexing head's own errors do to the estimates: they repeat, so no scatter shows them."""

from dataclasses import replace

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.fit import ModelFit, derivative
from errormodel.record import Record

ARCSEC = np.pi / 180.0 / 3600.0
STEP_RAD = 1e-4  # of the central difference: what is left of it is 1e-9 of the slope


def with_head_accuracy(fitted: ModelFit, record: Record, sigma_arcsec: float) -> ModelFit:
    """Add to a fit's covariance what the head's angle may be wrong by.

    The head's error is an unknown smooth function of its own angle, the same at every visit: an
    offset and two harmonics, a third of the variance each, so that the sigma is `sigma_arcsec` at
    every angle. The estimates are left as they are; a parameter that is considered and not
    estimated adds G S Gᵀ to their covariance, with G how far it moves them and S its own
    (Schmidt 1966; Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. 8).

    Parameters
    ----------
    fitted : ModelFit
        Of `record`, with equal weights.
    record : Record
        With the signals ``a_i_g``, ``a_p_g`` and ``head_deg``.
    sigma_arcsec : float
        1 sigma of the head's angle, ″.

    Returns
    -------
    ModelFit
    """
    moved = _moved_by_head(fitted, record) * (sigma_arcsec * ARCSEC)
    return replace(fitted, cov=fitted.cov + moved @ moved.T)


def _moved_by_head(fitted: ModelFit, record: Record) -> FloatArray:
    """Return how far each unit function of the angle moves the estimates, shape (p, 5)."""
    columns = derivative(fitted.model, record, fitted.as_dict())
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    error = _output_by_angle(fitted, record)[:, None] * _functions(record["head_deg"])
    found, *_ = linalg.lstsq(columns / norms, error)
    return found / norms[:, None]


def _functions(head_deg: FloatArray) -> FloatArray:
    angle = np.deg2rad(head_deg)
    harmonics = [f(k * angle) for k in (1, 2) for f in (np.sin, np.cos)]
    return np.column_stack([np.ones(angle.size), *harmonics]) / np.sqrt(3.0)


def _output_by_angle(fitted: ModelFit, record: Record) -> FloatArray:
    """Return the output's derivative by the angle the accelerometer stands at, per rad."""
    a_i, a_p = record["a_i_g"], record["a_p_g"]
    cosine, sine = np.cos(STEP_RAD), np.sin(STEP_RAD)

    def turned(way: float) -> FloatArray:
        at = record.with_signals(
            a_i_g=a_i * cosine + way * a_p * sine, a_p_g=a_p * cosine - way * a_i * sine
        )
        return fitted.model.simulate(at, fitted.as_dict())

    return (turned(1.0) - turned(-1.0)) / (2.0 * STEP_RAD)
