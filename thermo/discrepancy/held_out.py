"""The gap on runs that the choice of effect has not seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.choices import Choice
from errormodel.discrepancy.search import Search
from errormodel.errors import NotSeparableError
from errormodel.noise.shapes import NoiseShape
from errormodel.terms import Term
from thermo.discrepancy.source import Fitted, ThermalSource
from thermo.library.effects import foreseen
from thermo.recording.channel import Channel

# Predictions weigh readings alike: the smallest rms, whatever colour the noise is taken to have.
EQUAL = NoiseShape()


@dataclass(frozen=True, slots=True, kw_only=True)
class RunGap:
    """One run held out: its residual predicted by models fitted to the others, µg rms.

    `names` are the effects that the others alone would have named.
    """

    run: str
    before_ug: float
    after_ug: float
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """The gap on held-out runs, rms over all their readings.

    `predictive` is False when an effect belongs to one run or moment and cannot be predicted.
    """

    before_ug: float
    after_ug: float
    runs: tuple[RunGap, ...]
    predictive: bool


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def reading_residual_ug(channel: Channel, fitted: Fitted) -> FloatArray:
    """Return the residual of every reading, µg at the input, shape (n,)."""
    return _residual_ug(channel, fitted, fitted.values)


def _residual_ug(channel: Channel, fitted: Fitted, values: Mapping[str, float]) -> FloatArray:
    predicted = fitted.model.simulate(channel.record, values)
    return 1e6 * (np.asarray(channel.record.output) - predicted)


def held_out(source: ThermalSource, search: Search, choices: Sequence[Choice]) -> HeldOut | None:
    """Predict each run from the others, the choice of effect repeated without it.

    Returns
    -------
    HeldOut or None
        None with a single run, and where the other runs cannot give the present model.
    """
    channel = source.channel
    if len(channel.run_ids) < 2:
        return None
    gaps: list[RunGap] = []
    squares = np.zeros(2)
    count = 0
    for run in channel.run_ids:
        others = tuple(r for r in channel.run_ids if r != run)
        seen = channel.take(channel.runs_mask(others))
        unseen = channel.take(channel.runs_mask((run,)))
        part = ThermalSource(seen, source.model, source.effects)
        try:
            chosen = _chosen(part, search) if choices else ()
            before = _predicted(unseen, part.fitted((), EQUAL))
            after = _predicted(unseen, part.fitted(chosen, EQUAL))
        except (NotSeparableError, np.linalg.LinAlgError):
            return None
        gaps.append(
            RunGap(
                run=run,
                before_ug=rms(before),
                after_ug=rms(after),
                names=tuple(c.name for c in chosen),
            )
        )
        squares += [float(np.sum(before**2)), float(np.sum(after**2))]
        count += before.size
    before_ug, after_ug = np.sqrt(squares / count).tolist()
    events = {e.name for e in source.effects if e.event}
    return HeldOut(
        before_ug=before_ug,
        after_ug=after_ug,
        runs=tuple(gaps),
        predictive=not any(c.name in events for c in choices),
    )


def _chosen(part: ThermalSource, search: Search) -> tuple[Choice, ...]:
    """Repeat the choice on fewer runs, under the noise and the null laws of all."""
    laws = replace(search.laws, shapes=())
    return Search(part, search.floor, laws, search.rules, start=search.start).chosen()


def _predicted(unseen: Channel, fitted: Fitted) -> FloatArray:
    """Return the residual of unseen readings; what cannot be predicted is left out."""
    values = dict(fitted.values)
    for one in fitted.model.terms:
        if isinstance(one, Term) and not foreseen(one):
            values.update({c.name: 0.0 for c in one.coefficients})
    return _residual_ug(unseen, fitted, values)
