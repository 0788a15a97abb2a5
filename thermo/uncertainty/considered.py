"""Errors that repeat, or hide, and that no scatter of the residual shows: they widen the sigmas.

Each is *considered*, not estimated: the estimates stay, and how far it may move them is added to
their covariance (Schmidt 1966; Bierman, Factorization Methods for Discrete Sequential Estimation,
1977, ch. 8).
"""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from errormodel.fit import ModelFit
from errormodel.linear import triangle_of
from thermo.uncertainty.linearised import LinearisedFit

# The shift by noise in the temperature is second order in it: below this share of the
# temperature's own variance it is beneath every sigma.
NOISE_SHARE = 1e-5
STEP_SHARE = 0.05  # of the range, in differences by temperature: exact for polynomials to 1 %
COARSE = 2.0  # steps above this many sigma of the residual are no white noise
DRAWS = 48  # a sigma from these is known to 10 %


def with_moves(fit: ModelFit, moves: FloatArray) -> ModelFit:
    """Return a fit whose covariance allows for moves of the estimates (p, m), 1 sigma each."""
    return replace(fit, cov=fit.cov + moves @ moves.T)


def thermometer_moves(line: LinearisedFit, sigma_c: float, gain_ppm: float, t_ref_c: float) -> (
    FloatArray
):  # fmt: skip
    """Return how far a thermometer's offset and gain, 1 sigma each, move the estimates (p, 2).

    The gain is about 0 °C.
    """
    by_temperature = line.by_temperature()
    temp_c = line.record["x_c"] + t_ref_c
    off = np.column_stack([by_temperature, by_temperature * temp_c])
    return line.moved(off) * np.array([sigma_c, 1e-6 * gain_ppm])


def temperature_noise_moves(line: LinearisedFit, sigma_c: float) -> FloatArray:
    """Return how far noise in the temperature moves the estimates, (p, p + 1 or 0).

    With readings at x + η the normal equations expect Σ (J'f' + J f''/2) σ² more than zero
    (Fuller, Measurement Error Models, 1987, ch. 3), which moves the estimates by that. Besides,
    the noise f'η is not alike at all positions, as the fit takes it to be.
    """
    x = line.record["x_c"]
    none = np.zeros((line.columns.shape[1], 0))
    spread2 = float(np.var(x))
    if not sigma_c**2 > NOISE_SHARE * spread2:
        return none
    fit, values = line.fit, line.fit.as_dict()
    step = STEP_SHARE * float(np.ptp(x))
    above, below = (line.record.with_signals(x_c=x + s * step) for s in (1.0, -1.0))
    up, down = (fit.model.simulate(r, values) for r in (above, below))
    middle = fit.model.simulate(line.record, values)
    slope, bend = (up - down) / (2 * step), (up - 2 * middle + down) / step**2
    by_x = [Columns(fit.model, r, values).transposed_times(slope) for r in (above, below)]
    pull = (by_x[0] - by_x[1]) / (2 * step) + 0.5 * line.columns.transposed_times(bend)
    noisy: FloatArray | None = None
    for rows, block in line.columns.blocks():
        noisy = triangle_of(block * (sigma_c * slope[rows])[:, None], noisy)
    assert noisy is not None  # a fit has readings
    return np.column_stack([sigma_c**2 * line.by_normal(pull), line.by_normal(noisy.T)])


def output_step(output: FloatArray) -> float:
    """Return the step of a digitised output; 0 where it shows none."""
    gaps = np.diff(np.unique(output))
    if gaps.size < 5:
        return 0.0
    least = float(gaps.min())
    near = gaps[gaps < 3.5 * least]
    steps = np.round(near / least)
    if near.size < max(5, 0.3 * gaps.size) or np.mean(np.abs(near / least - steps) < 0.1) < 0.95:
        return 0.0
    return float(near.sum() / steps.sum())


def step_moves(line: LinearisedFit, step: float) -> FloatArray:
    """Return moves of the estimates by the steps of the output, (p, draws or 0).

    An output that is coarser than its noise errs by a sawtooth of itself: the same at each visit
    to a position until the temperature has moved it by a step. It is drawn here with its phase
    at random.
    """
    noise = line.noise
    size = float(np.hypot(noise.white, noise.drift))
    if step <= COARSE * size:
        return np.zeros((line.columns.shape[1], 0))
    rng = np.random.default_rng(0)
    predicted = np.asarray(line.record.output) - line.residual
    own = float(np.sqrt(max(size**2 - step**2 / 12.0, 0.0)))
    moves: list[FloatArray] = []
    for _ in range(DRAWS):
        exact = predicted + step * rng.random() + own * rng.standard_normal(predicted.size)
        moves.append(line.moved(step * np.round(exact / step) - exact))
    return np.array(moves).T / np.sqrt(DRAWS)
