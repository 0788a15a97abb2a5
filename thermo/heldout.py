"""How a model predicts runs that it was not fitted to."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray
from errormodel.errors import NotSeparableError
from errormodel.fit import ModelFit, fit_values
from errormodel.model import ErrorModel
from errormodel.record import Record
from thermo.inputs import Channel
from thermo.residuals import ResidualSummary, summarise


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """What is left of readings that were not fitted, and the sigma of its rms."""

    summary: ResidualSummary | None
    sigma_ug: float | None


def held_out(result: ModelFit, everything: Channel, holdout: tuple[str, ...]) -> HeldOut | None:
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
    HeldOut or None
        None with a single run, or where a run alone carries some coefficient.
    """
    if holdout:
        unseen = everything.take(everything.runs_mask(holdout))
        left = _left_ug(result.model, unseen.record, result.as_dict())
        return _summed(unseen, left) if holdout else None
    if len(everything.run_ids) < 2:
        return None
    model = result.model
    residual_ug = np.empty(len(everything.record))
    record = everything.record.with_only(model.needs)  # parts of it are then small
    for rows in record.run_slices:
        mine = np.arange(len(record))[rows]
        try:
            seen = record.take(np.delete(np.arange(len(record)), mine))
            values = fit_values(model, seen, start=result.as_dict())
        except NotSeparableError:
            return None  # this run alone carries some coefficient: it cannot be predicted
        residual_ug[rows] = _left_ug(model, record.take(mine), values)
    return _summed(everything, residual_ug)


def _left_ug(model: ErrorModel, record: Record, values: Mapping[str, float]) -> FloatArray:
    left = model.simulate(record, values)
    np.subtract(np.asarray(record.output), left, out=left)
    return np.multiply(left, 1e6, out=left)


def _summed(channel: Channel, residual_ug: FloatArray) -> HeldOut:
    summary = summarise(channel, residual_ug)
    return HeldOut(summary=summary, sigma_ug=rms_sigma_ug(summary))


def rms_sigma_ug(summary: ResidualSummary) -> float | None:
    """Return the sigma of an rms by the scatter of its runs, wider with few; None with one.

    1.96 of it hold 95 % (Student's t, a degree of freedom less than runs).
    """
    count = len(summary.by_run)
    if count < 2 or not summary.rms_ug:
        return None
    squares = np.array([g.rms_ug**2 for g in summary.by_run])
    of_mean = float(np.std(squares, ddof=1)) / np.sqrt(count)
    wider = float(stats.t.ppf(0.975, count - 1)) / 1.96
    return float(wider * of_mean / (2.0 * summary.rms_ug))
