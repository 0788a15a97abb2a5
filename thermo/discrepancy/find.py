"""Where simulation and measurement disagree, and which physical effect is missing.

`find_discrepancy` is the whole work for recorded chamber runs: the present model is simulated on
the recorded inputs and compared with the outputs; what is left is located, a library of named
effects is tried, the effect found is added and judged on runs that were held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.discrepancy.choices import Rules, SearchResult
from errormodel.discrepancy.floor import NoiseFloor
from errormodel.discrepancy.foresight import Foresight
from errormodel.discrepancy.gate import Conclusion, FactorFinding, Judgement, judge, locate
from errormodel.discrepancy.nulls import Calibration
from errormodel.model import ErrorModel
from thermo.discrepancy.baseline import bare_baseline, fitted_baseline
from thermo.discrepancy.experiment import Experiment, propose
from thermo.discrepancy.floor import floor_ug
from thermo.discrepancy.held_out import EQUAL, HeldOut, held_out, reading_residual_ug, rms
from thermo.discrepancy.input import check_channel, in_own_scale
from thermo.discrepancy.search import Found, Settings, Tell, search_together
from thermo.discrepancy.shared import SharedEffect, Unlike, shared_effects
from thermo.discrepancy.source import Fitted, ThermalSource
from thermo.discrepancy.words import EffectFound, effects_found, where_text
from thermo.fitting.fit import TermsFile
from thermo.library.effects import ThermalEffect
from thermo.recording.channel import Channel, channel_of, refuse_without_signals
from thermo.recording.files import RecordedRuns
from thermo.selection.orders import mounted

RULES = Rules(pairs=True, most=5)
DRAWS = 300
# A slow part larger than this many times the white noise of a reading is no instrument's drift.
MOST_DRIFT = 3.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy(Conclusion):
    """One accelerometer's verdict and everything it stands on.

    Attributes
    ----------
    channel : Channel
    t_ref_c : float
    source : ThermalSource
    laws : Calibration
    foresight : Foresight
    floor : NoiseFloor
    before, after : Fitted
        The present model and the enlarged one, fitted under the noise found: parameters, sigmas.
    plain_before, plain_after : Fitted
        The same with readings weighed alike: residuals.
    effects : tuple of EffectFound
    where : FactorFinding or None
        The factor that carries the excess.
    where_text : str
    rms_before_ug, rms_after_ug, floor_ug : float
        Over readings.
    heldout : HeldOut or None
    experiment : Experiment or None
    unlike : tuple of Unlike
        Effects of the head, the chamber or the digitiser that the other accelerometers refute.
    shared : tuple of SharedEffect
        Effects that other accelerometers show as well, with whose they are.
    fit_first : tuple of str
        Terms of the equation that the present model lacks at once.
    """

    channel: Channel
    t_ref_c: float
    source: ThermalSource
    laws: Calibration
    foresight: Foresight
    invisible: tuple[str, ...]
    floor: NoiseFloor
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
    experiment: Experiment | None
    unlike: tuple[Unlike, ...]
    shared: tuple[SharedEffect, ...]
    fit_first: tuple[str, ...]

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
    tell: Tell | None = None,
) -> tuple[Discrepancy, ...]:
    """Find and name what is missing from the model of each accelerometer in recorded runs.

    Parameters
    ----------
    runs : RecordedRuns
    model : TermsFile or "bare", optional
        The present model's terms; by default those that `fit` chooses for each accelerometer.
        "bare": k0 and k1, each quadratic in temperature.
    effects : sequence of ThermalEffect
        The library.
    rules : Rules, optional
        Thresholds.
    draws : int
        Simulated nulls that calibrate every statistic.
    seed : int
        Of the draws.
    workers : int
        Threads that simulate them; the verdict does not depend on it.
    tell : callable, optional
        Takes a line of progress.

    Returns
    -------
    tuple of Discrepancy
        One verdict an accelerometer.

    Raises
    ------
    InputError
        If an accelerometer's runs cannot be searched.
    """
    t_ref_c = model.t_ref_c if isinstance(model, TermsFile) else TermsFile().t_ref_c
    settings = Settings(
        rules=rules or RULES, draws=draws, seed=seed, workers=workers, say=tell or _silent
    )
    channels = [channel_of(runs, serial, t_ref_c=t_ref_c) for serial in runs.serials]
    for channel in channels:
        check_channel(channel, runs.source)
    channels = [in_own_scale(channel) for channel in channels]
    sources = [ThermalSource(c, mounted(_baseline(model, c), c), effects) for c in channels]
    found = search_together(sources, settings)
    judged = [(one, _judged(one)) for one in found]
    shared = shared_effects([one for one, verdict in judged if _stands(verdict)])
    made: list[Discrepancy] = []
    for one, verdict in judged:
        settings.say(f"{one.serial}: runs held out")
        made.append(_concluded(one, verdict, shared, t_ref_c))
    return tuple(made)


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


def _stands(verdict: Judgement) -> bool:
    """Tell whether names stand, bare or in alias sets."""
    return verdict.verdict in ("named", "alias")


def _concluded(
    one: Found, verdict: Judgement, shared: Sequence[SharedEffect], t_ref_c: float
) -> Discrepancy:
    """Bring together all that a verdict stands on."""
    source, search, result = one.source, one.search, one.result
    laws, floor = search.laws, result.floor
    choices = tuple(s.choice for s in result.slots) if _stands(verdict) else ()
    before, after = source.fitted((), floor.shape), source.fitted(choices, floor.shape)
    plain = source.fitted((), EQUAL), source.fitted(choices, EQUAL)
    where = _where(locate(search.view([]), laws), verdict)
    invisible = _invisible(source, one.foresight)
    return Discrepancy(
        channel=source.channel,
        t_ref_c=t_ref_c,
        source=source,
        judgement=verdict,
        result=result,
        laws=laws,
        foresight=one.foresight,
        invisible=invisible,
        floor=floor,
        before=before,
        after=after,
        plain_before=plain[0],
        plain_after=plain[1],
        effects=effects_found(source, after, result, floor) if choices else (),
        where=where,
        where_text=where_text(where, verdict),
        rms_before_ug=rms(reading_residual_ug(source.channel, plain[0])),
        rms_after_ug=rms(reading_residual_ug(source.channel, plain[1])),
        floor_ug=floor_ug(source, after, floor, search.view([]).problem.saturated),
        heldout=held_out(source, search, choices),
        experiment=propose(source, result, verdict, invisible, floor),
        unlike=one.unlike,
        shared=tuple(s for s in shared if one.serial in s.serials),
        fit_first=_fit_first(source, result, after) if choices else (),
    )


def _judged(one: Found) -> Judgement:
    """Return the verdict; names that came in the place of refuted ones must explain as much."""
    search, result = one.search, one.result
    floor = result.floor
    drift = floor.sigma * np.sqrt(floor.shape.slow_share(one.source.blocks.times.span_s))
    made = judge(
        search.view([s.choice for s in result.slots]),
        result,
        search.laws,
        one.rules,
        too_much_drift=bool(drift > MOST_DRIFT * _white_ug(one.source, result)),
    )
    if one.replaced and _stands(made):
        return replace(made, verdict="unexplained_repeatable")
    return made


def _white_ug(source: ThermalSource, result: SearchResult) -> float:
    """Return the white sigma of a reading: from within blocks where there is enough."""
    fitted = source.fitted([s.choice for s in result.slots], result.floor.shape)
    sigma, dof = source.blocks.spread(reading_residual_ug(source.channel, fitted))
    if dof > 100:
        return sigma
    return result.floor.sigma * float(np.sqrt(source.blocks.usual))


def _fit_first(source: ThermalSource, result: SearchResult, after: Fitted) -> tuple[str, ...]:
    """Return the terms of the equation that the present model lacks at once.

    What has no effect in these runs, force along the output axis say, they do not call for.
    """
    slots = [s for s in result.slots if s.choice.name in result.started]
    names = [name for s in slots for name in source.form_of(s.choice).terms]
    return tuple(n for n in names if n not in after.idle)


def _where(places: Sequence[FactorFinding], verdict: Judgement) -> FactorFinding | None:
    """Return the factor that carries the excess; for what is unexplained, one of its kind."""
    if verdict.verdict == "nothing":
        return None
    kind = {"unexplained_repeatable": True, "unexplained_noise": False}.get(verdict.verdict)
    fitting = [f for f in places if kind is None or f.repeatable == kind]
    return fitting[0] if fitting else None


def _invisible(source: ThermalSource, foresight: Foresight) -> tuple[str, ...]:
    """Return the effects that the runs cannot show at all, whatever their size."""
    shown = set(foresight.names) - set(foresight.invisible)
    held = {e.name for e in source.effects if source.holds_some(e)}
    return tuple(e.name for e in source.effects if e.name not in shown | held)
