"""The residual on runs that were not used to select the effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, rms
from errormodel.discrepancy.search.choices import Choice
from errormodel.noise.model import NoiseModel
from errormodel.terms import Term
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library.effects import foreseen
from thermo.recording.channel import Channel

# Predictions use equal weights, which give the smallest rms for any assumed noise.
EQUAL = NoiseModel()


@dataclass(frozen=True, slots=True, kw_only=True)
class RunGap:
    """One run held out: its residual predicted by models fitted to the others, µg rms.

    `names` are the effects that the others alone would have named; `readings` is their number.
    """

    run: str
    before_ug: float
    after_ug: float
    names: tuple[str, ...]
    readings: int


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """The residual on held-out runs, rms over all their readings.

    `predictive` is False if an effect does not repeat and cannot be predicted.
    """

    before_ug: float
    after_ug: float
    runs: tuple[RunGap, ...]
    predictive: bool


def reading_residual_ug(channel: Channel, fitted: Fitted) -> FloatArray:
    """Return the residual of every reading, µg at the input, shape (n,)."""
    return _residual_ug(channel, fitted, fitted.values)


def _residual_ug(channel: Channel, fitted: Fitted, values: Mapping[str, float]) -> FloatArray:
    predicted = fitted.model.simulate(channel.record, values)
    return 1e6 * (np.asarray(channel.record.output) - predicted)


def gap_of_run(
    source: ThermalSource, run: str, others: ThermalSource, chosen: Sequence[Choice]
) -> RunGap:
    """Predict a run from the others, by the present model and with the effects they chose.

    Parameters
    ----------
    source : ThermalSource
        Source of all runs.
    run : str
    others : ThermalSource
        Source of the other runs.
    chosen : sequence of Choice
    """
    channel = source.channel
    unseen = channel.take(channel.runs_mask((run,)))
    before = _predicted(unseen, others.fitted((), EQUAL))
    after = _predicted(unseen, others.fitted(chosen, EQUAL))
    return RunGap(
        run=run,
        before_ug=rms(before),
        after_ug=rms(after),
        names=tuple(c.name for c in chosen),
        readings=before.size,
    )


def gap_of_all(
    gaps: Sequence[RunGap], source: ThermalSource, choices: Sequence[Choice]
) -> HeldOut | None:
    """Return the gap over the readings of all runs held out; None without any."""
    if not gaps:
        return None
    weights = np.array([g.readings for g in gaps], dtype=float)
    squares = np.array([[g.before_ug**2, g.after_ug**2] for g in gaps])
    before_ug, after_ug = np.sqrt(weights @ squares / weights.sum()).tolist()
    events = {e.name for e in source.effects if e.event}
    return HeldOut(
        before_ug=before_ug,
        after_ug=after_ug,
        runs=tuple(gaps),
        predictive=not any(c.name in events for c in choices),
    )


def _predicted(unseen: Channel, fitted: Fitted) -> FloatArray:
    """Return the residual of held-out readings; unpredictable effects are left out."""
    values = dict(fitted.values)
    for one in fitted.model.terms:
        if isinstance(one, Term) and not foreseen(one):
            values.update({c.name: 0.0 for c in one.coefficients})
    return _residual_ug(unseen, fitted, values)
