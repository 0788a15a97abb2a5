"""Residual of noise alone on a held-out run: the floor.

The scale is estimated from the data: the residual of these runs beside everything that repeats. The
estimated noise model only gives the share that so many columns absorb, and the additional error of
a prediction (coefficient errors, drift of the predicted run).
"""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.linear import independent
from errormodel.noise.model import NoiseFit
from thermo.discrepancy.held_out import reading_residual_ug
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library.effects import foreseen

DRAWS = 80


def floor_ug(source: ThermalSource, after: Fitted, floor: NoiseFit, saturated: FloatArray) -> float:
    """Return the rms over readings that noise alone would leave on a held-out run, µg.

    Parameters
    ----------
    source : ThermalSource
    after : Fitted
        The model with the effects found.
    floor : NoiseFit
    saturated : ndarray, shape (b, m)
        Everything that repeats, block means.
    """
    blocks = source.blocks
    weights: FloatArray = blocks.counts / float(np.sum(blocks.counts))
    mean = independent(np.hstack([saturated, after.jacobian]), 1e-5)
    # the level of a walk that continues through the rests is not part of the noise of a run
    own = replace(floor.noise, continued=False)
    white: FloatArray = np.random.default_rng(1).standard_normal((weights.size, DRAWS))
    noise: FloatArray = own.whitener(blocks.times).colour(white)
    left = after.residual - mean @ (mean.T @ after.residual)
    noise_left = noise - mean @ (mean.T @ noise)
    scale2 = float(weights @ left**2) / float(np.mean(weights @ noise_left**2))
    predicted = _predicted(source, after, noise)
    within, dof = blocks.spread(reading_residual_ug(source.channel, after))
    within2 = within**2 * dof / float(np.sum(blocks.counts))
    return float(np.sqrt(scale2 * np.mean(weights @ predicted**2) + within2))


def _predicted(source: ThermalSource, after: Fitted, noise: FloatArray) -> FloatArray:
    """Return the error of predicting each run's noise from the others' fit, or of the fit."""
    coefficients = {c.name for t in after.model.terms if foreseen(t) for c in t.coefficients}
    coefficients |= {p.name for t in after.model.terms if foreseen(t) for p in t.parameters}
    kept = [k for k, name in enumerate(after.free) if name in coefficients]
    columns = after.jacobian[:, kept]
    norms = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(norms > 0, norms, 1.0)
    if source.seen.runs < 2:
        return noise - columns @ np.linalg.lstsq(columns, noise, rcond=1e-9)[0]
    out = np.empty_like(noise)
    for run in range(source.seen.runs):
        mine = source.seen.run == run
        fitted = np.linalg.lstsq(columns[~mine], noise[~mine], rcond=1e-9)[0]
        out[mine] = noise[mine] - columns[mine] @ fitted
    return out
