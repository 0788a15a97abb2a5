"""Prediction error of a model on runs that it was not fitted to."""

from collections.abc import Mapping

import numpy as np
from scipy import stats

from errormodel.arrays import BoolArray, FloatArray
from errormodel.errors import NotSeparableError
from errormodel.fit import ModelFit, fit_values
from errormodel.model import ErrorModel
from errormodel.record import Record
from errormodel.run_effects import Z95, RunEffect
from thermo.recording.channel import Channel
from thermo.selection.residuals import ResidualSummary, summarise
from thermo.uncertainty.linearised import LinearisedFit

QUANTILES = 4000  # of what is not known exactly
FINE = 16  # steps of an octave
SEED = 1  # of what goes with what among them


def held_out(
    result: ModelFit, everything: Channel, holdout: tuple[str, ...]
) -> ResidualSummary | None:
    """Predict runs that were not fitted: those asked for, or each in turn.

    Parameters
    ----------
    result : ModelFit
    everything : Channel
        The runs fitted and those held out.
    holdout : tuple of str
        The runs asked for; none for each in turn.

    Returns
    -------
    ResidualSummary or None
        None with a single run, or where a run alone carries some coefficient.
    """
    if holdout:
        unseen = everything.take(everything.runs_mask(holdout))
        left = _left_ug(result.model, unseen.record, result.as_dict())
        return summarise(unseen, left)
    if len(everything.run_ids) < 2:
        return None
    model = result.model
    residual_ug = np.empty(len(everything.record))
    record = everything.record.with_only(model.needs)  # parts of it are then small
    for rows in record.run_slices:
        kept: BoolArray = np.ones(len(record), dtype=np.bool_)
        kept[rows] = False
        try:
            seen = record.take(kept)
            values = fit_values(model, seen, start=result.as_dict())
        except NotSeparableError:
            return None  # this run alone carries some coefficient: it cannot be predicted
        del seen
        mine = record.take(~kept)
        residual_ug[rows] = _left_ug(model, mine, values)
    return summarise(everything, residual_ug)


def _left_ug(model: ErrorModel, record: Record, values: Mapping[str, float]) -> FloatArray:
    left = model.simulate(record, values)
    np.subtract(np.asarray(record.output), left, out=left)
    return np.multiply(left, 1e6, out=left)


def heldout_sigma_ug(line: LinearisedFit, noise_cov: FloatArray, rms_ug: float) -> float | None:
    """Return the sigma of a held-out rms for what further runs leave; None with a single run.

    1.96 of it about the rms hold, with 95 %, what the model leaves of many further runs. Their
    mean square is that of the noise, of the coefficients' errors and of what differs from run to
    run; how well it is known hangs on how well the sigmas of the differences are, which few runs
    tell badly, and on how often the drift was seen anew.

    Parameters
    ----------
    line : LinearisedFit
        With its run effects.
    noise_cov : ndarray, shape (p, p)
        Covariance of the coefficients by the noise alone.
    rms_ug : float
        Held out.
    """
    if not line.run_effects:
        return None
    triangle = line.columns.triangle()
    gram = triangle.T @ triangle / len(line.record)
    draws = np.random.default_rng(SEED)
    squares = draws.permutation(_within_runs(line, float(np.sum(noise_cov * gram))))
    for k, effect in enumerate(line.run_effects):
        along, moves = line.run_directions[:, k], line.run_moves(k)
        once = float(along @ gram @ along) + float(np.sum((gram @ moves) * moves))
        squares = squares + once * draws.permutation(_likely_sigmas(effect)) ** 2
    return float(np.quantile(np.abs(1e6 * np.sqrt(squares) - rms_ug), 0.95)) / Z95


def _likely_sigmas(effect: RunEffect) -> FloatArray:
    """Return what runs may differ by, equally likely each: 0, or between the octaves of a sigma.

    Between two octaves the logarithm of the likelihood is taken for a straight line.
    """
    if not effect.sigmas[-1] > 0:
        return np.zeros(QUANTILES)
    octaves = np.log2(effect.sigmas[1:])
    count = FINE * (len(octaves) - 1) + 1
    fine: FloatArray = np.linspace(float(octaves[0]), float(octaves[-1]), count)
    heights = np.log(np.maximum(effect.shares[1:], np.finfo(float).tiny))
    density = np.exp(np.interp(fine, octaves, heights))
    none = effect.shares[0] / sum(effect.shares)
    reached = none + (1.0 - none) * np.cumsum(density) / density.sum()
    wanted = (np.arange(QUANTILES) + 0.5) / QUANTILES
    sigmas = np.asarray(2.0 ** np.interp(wanted, reached, fine), dtype=np.float64)
    return np.where(wanted < none, 0.0, sigmas)


def _within_runs(line: LinearisedFit, by_coefficients: float) -> FloatArray:
    """Return what the mean square within runs may be, as likely each (χ², Satterthwaite 1946)."""
    noise = line.noise
    white, slow = noise.white**2, noise.drift**2 + by_coefficients
    uncertain = white**2 / len(line.record) + slow**2 / line.drift_freedom
    freedom = (white + slow) ** 2 / uncertain
    quantiles = (np.arange(QUANTILES) + 0.5) / QUANTILES
    return np.asarray((white + slow) * freedom / stats.chi2.ppf(quantiles, freedom))
