"""The verdict on chamber runs: where they disagree with the model, and which effect is missing.

`find_discrepancy` is the whole work for recorded chamber runs: the present model is simulated on
the recorded inputs and compared with the outputs; the residual is located, a library of named
effects is tried, and the named effect is added and tested on held-out runs.
"""

import itertools
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Literal

from errormodel.arrays import rms
from errormodel.discrepancy.gate import FactorFinding, Judgement
from errormodel.discrepancy.investigation import Conclusion, Settings, Tell, investigate
from errormodel.discrepancy.search.choices import Rules
from errormodel.discrepancy.search.state import SearchState
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseFit
from thermo.discrepancy.baseline import bare_baseline, fitted_baseline
from thermo.discrepancy.experiment import Experiment
from thermo.discrepancy.experiment_menu import NO_LIMITS, Limits
from thermo.discrepancy.floor import floor_ug
from thermo.discrepancy.held_out import EQUAL, HeldOut, RunGap, gap_of_all, reading_residual_ug
from thermo.discrepancy.input import check_channel, in_own_scale
from thermo.discrepancy.measurement import ChamberRuns
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.discrepancy.shape.found import ShapeFound
from thermo.discrepancy.shared import SearchedChannel, SharedEffect, shared_effects
from thermo.discrepancy.words import EffectFound, effects_found, where_text
from thermo.fitting.fit import TermsFile
from thermo.library import thermal_library
from thermo.library.effects import ThermalEffect
from thermo.recording.channel import Channel, channel_of, refuse_without_signals
from thermo.recording.files import RecordedRuns
from thermo.selection.orders import mounted

RULES = Rules(pairs=True, most=5)
DRAWS = 300
SHAPE_NAME = "my_effect"  # of an effect without a name, with the accelerometer's number


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy(Conclusion[RunGap, Experiment]):
    """The verdict on one accelerometer and its basis.

    Attributes
    ----------
    channel : Channel
    t_ref_c : float
    source : ThermalSource
    before, after : Fitted
        The present model and the enlarged one, fitted under the estimated noise: parameters,
        sigmas.
    plain_before, plain_after : Fitted
        Both models fitted with equal weights: residuals.
    effects : tuple of EffectFound
    where : FactorFinding or None
        The factor that explains the excess.
    where_text : str
    rms_before_ug, rms_after_ug, floor_ug : float
        Over readings.
    heldout : HeldOut or None
    shared : tuple of SharedEffect
        Effects that other accelerometers also show, with their cause.
    fit_first : tuple of str
        Terms of the equation that the present model lacks at once.
    shape : ShapeFound or None
        The effect without a name for what repeats and has none; it is in `after`.
    """

    channel: Channel
    t_ref_c: float
    source: ThermalSource
    before: Fitted
    after: Fitted
    plain_before: Fitted
    plain_after: Fitted
    effects: tuple[EffectFound, ...]
    where: FactorFinding | None
    where_text: str
    rms_before_ug: float
    rms_after_ug: float
    floor_ug: float
    heldout: HeldOut | None
    shared: tuple[SharedEffect, ...]
    fit_first: tuple[str, ...]
    shape: ShapeFound | None

    @property
    def floor(self) -> NoiseFit:
        """The noise found."""
        return self.result.floor

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.channel.serial


def find_discrepancy(
    runs: RecordedRuns,
    *,
    model: TermsFile | Literal["bare"] | None = None,
    effects: Sequence[ThermalEffect] | None = None,
    rules: Rules | None = None,
    draws: int = DRAWS,
    seed: int = 1,
    workers: int = 1,
    with_shape: bool = True,
    limits: Limits = NO_LIMITS,
    tell: Tell | None = None,
) -> tuple[Discrepancy, ...]:
    """Find and name the missing effects of each accelerometer in recorded runs.

    Parameters
    ----------
    runs : RecordedRuns
    model : TermsFile or "bare", optional
        The present model's terms; by default those that `fit` selects for each accelerometer.
        "bare": k0 and k1, each quadratic in temperature.
    effects : sequence of ThermalEffect
        The library.
    rules : Rules, optional
        Thresholds.
    draws : int
        Simulated nulls that calibrate every statistic.
    seed : int
        Seed of the draws.
    workers : int
        Threads that simulate them; the verdict does not depend on it.
    with_shape : bool
        Whether what repeats and has no name gets a shape.
    limits : Limits
        What the laboratory can do, for the next experiment.
    tell : callable, optional
        Takes a line of progress.

    Returns
    -------
    tuple of Discrepancy
        One verdict per accelerometer.

    Raises
    ------
    InputError
        If an accelerometer's runs cannot be searched.
    """
    t_ref_c = model.t_ref_c if isinstance(model, TermsFile) else TermsFile().t_ref_c
    settings = Settings(
        rules=rules or RULES, draws=draws, seed=seed, workers=workers, tell=tell or _silent
    )
    channels = [channel_of(runs, serial, t_ref_c=t_ref_c) for serial in runs.serials]
    for channel in channels:
        check_channel(channel, runs.source)
    channels = [in_own_scale(channel) for channel in channels]
    sources = [ThermalSource(c, mounted(_baseline(model, c), c), effects) for c in channels]
    names = _shape_names(len(sources)) if with_shape else [None] * len(sources)
    runs_of = [ChamberRuns(s, name, limits) for s, name in zip(sources, names, strict=True)]
    found = investigate(runs_of, settings)
    shared = shared_effects(
        [SearchedChannel(m.source, c.result) for m, c in found if c.judgement.names_stand]
    )
    made: list[Discrepancy] = []
    for m, c in found:
        shape = c.rival if isinstance(c.rival, ShapeFound) else None
        with shape.in_library() if shape else nullcontext():
            made.append(_discrepancy(m.source, c, shared, t_ref_c, shape))
    return tuple(made)


def _shape_names(count: int) -> list[str]:
    """Return names for effects without one: numbered on from those that a library has."""
    taken = thermal_library().terms
    free = (name for k in itertools.count(1) if (name := f"{SHAPE_NAME}_{k}") not in taken)
    return list(itertools.islice(free, count))


def _baseline(model: TermsFile | Literal["bare"] | None, channel: Channel) -> ErrorModel:
    """Return the present model of an accelerometer."""
    if model == "bare":
        return bare_baseline(channel)
    given = model.model() if model else None
    if given is None:
        return fitted_baseline(channel)
    refuse_without_signals(given, channel, "recorded runs")
    return given


def _silent(line: str) -> None:
    """Tell nobody."""


def _discrepancy(
    source: ThermalSource,
    conclusion: Conclusion[RunGap, Experiment],
    shared: Sequence[SharedEffect],
    t_ref_c: float,
    shape: ShapeFound | None,
) -> Discrepancy:
    """Bring together all that a verdict stands on."""
    result, judgement = conclusion.result, conclusion.judgement
    floor, choices = result.floor, conclusion.choices
    named, heldout = choices, gap_of_all(conclusion.held_out_parts, source, choices)
    if shape is not None:
        source, choices, heldout = shape.source_with(source), shape.choices, shape.heldout
    before, after = source.fitted((), floor.noise), source.fitted(choices, floor.noise)
    plain = source.fitted((), EQUAL), source.fitted(choices, EQUAL)
    where = _where(conclusion.places, judgement, shape)
    serial = source.channel.serial
    return Discrepancy(
        **conclusion.inherited,
        channel=source.channel,
        t_ref_c=t_ref_c,
        source=source,
        before=before,
        after=after,
        plain_before=plain[0],
        plain_after=plain[1],
        effects=effects_found(source, after, result, floor) if named else (),
        where=where,
        where_text=where_text(source, where, judgement, shape),
        rms_before_ug=rms(reading_residual_ug(source.channel, plain[0])),
        rms_after_ug=rms(reading_residual_ug(source.channel, plain[1])),
        floor_ug=floor_ug(source, after, floor, result.problem(()).saturated),
        heldout=heldout,
        shared=tuple(s for s in shared if serial in s.serials),
        fit_first=_fit_first(source, result, after) if named else (),
        shape=shape,
    )


def _fit_first(source: ThermalSource, result: SearchState, after: Fitted) -> tuple[str, ...]:
    """Return the terms of the equation that are jointly missing from the present model.

    Terms without effect in these runs, such as of force along the output axis, are left out.
    """
    slots = [s for s in result.slots if s.choice.name in result.started]
    names = [name for s in slots for name in source.form_of(s.choice).terms]
    return tuple(n for n in names if n not in after.idle)


def _where(
    places: Sequence[FactorFinding], verdict: Judgement, shape: ShapeFound | None
) -> FactorFinding | None:
    """Return the factor that explains the excess; for an unexplained verdict, one of its kind.

    Where there is a shape, it is its quantity, with what the shape explains.
    """
    if shape is not None:
        name, gain = shape.pattern.quantity, shape.pattern.shape.gain
        chance = next((f.p_value for f in places if f.name == name), float("nan"))
        return FactorFinding(name=name, repeatable=True, excess=gain, score=gain, p_value=chance)
    kind = {"unexplained_repeatable": True, "unexplained_noise": False}.get(verdict.verdict)
    fitting = [f for f in places if kind is None or f.repeatable == kind]
    return fitting[0] if fitting else None
