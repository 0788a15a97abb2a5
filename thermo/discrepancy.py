"""Where simulation and measurement disagree, and which physical effect is missing.

`find_discrepancy` is the whole work for recorded chamber runs: the present model is simulated on
the recorded inputs and compared with the outputs; what is left is located, a library of named
effects is tried, the effect found is added and judged on runs that were held out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.choices import Rules, SearchResult
from errormodel.discrepancy.coloured import NoiseShape
from errormodel.discrepancy.floor import NoiseFloor, estimate_floor
from errormodel.discrepancy.foresight import Foresight, foresee
from errormodel.discrepancy.gate import Conclusion, FactorFinding, Judgement, judge, locate
from errormodel.discrepancy.nulls import Calibration, calibrate
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search import Search
from errormodel.model import ErrorModel
from thermo.discrepancy_floor import floor_ug
from thermo.discrepancy_heldout import EQUAL, HeldOut, held_out, reading_residual_ug, rms
from thermo.discrepancy_input import check_channel
from thermo.discrepancy_source import Fitted, ThermalSource
from thermo.discrepancy_words import EffectFound, effects_found, where_text
from thermo.effects import EFFECTS, ThermalEffect
from thermo.experiments import Experiment, propose
from thermo.fitting import TermsFile
from thermo.inputs import Channel, channel_of
from thermo.recording import RecordedRuns
from thermo.selection import equation, mounted, separable_names

RULES = Rules(pairs=True)
ORDERS = frozenset({"bias_temperature_order", "scale_temperature_order"})
DRAWS = 300
# A slow part larger than this many times the white noise of a reading is no instrument's drift.
MOST_DRIFT = 3.0
Tell = Callable[[str], None]


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

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.channel.serial


def default_baseline(channel: Channel) -> ErrorModel:
    """Return k0 and, with a known input, k1, each quadratic in temperature if it can be had."""
    names, _ = separable_names(channel)
    top = {f: next(k for k in (2, 1, 0) if k == 0 or f"{f}_t{k}" in names) for f in ("k0", "k1")}
    static = [n for n in ("k1", "k0") if n in names]
    return equation(static, top["k0"], top["k1"] if channel.has_input else 0)


def find_discrepancy(
    runs: RecordedRuns,
    *,
    model: TermsFile | None = None,
    effects: Sequence[ThermalEffect] = EFFECTS,
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
    model : TermsFile, optional
        The present model's terms; by default k0 and k1, each quadratic in temperature.
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
    say: Tell = tell or _silent
    given = model or TermsFile()
    made: list[Discrepancy] = []
    channels = [channel_of(runs, serial, t_ref_c=given.t_ref_c) for serial in runs.serials]
    for channel in channels:
        check_channel(channel, runs.source)
    for channel in channels:
        baseline = mounted(given.model() or default_baseline(channel), channel)
        source = ThermalSource(channel, baseline, effects)
        work = _Work(source, given.t_ref_c, rules or RULES, draws, seed, workers, say)
        made.append(work.run())
    return tuple(made)


def _silent(line: str) -> None:
    """Tell nobody."""


class _Work:
    """The steps for one accelerometer."""

    def __init__(
        self,
        source: ThermalSource,
        t_ref_c: float,
        rules: Rules,
        draws: int,
        seed: int,
        workers: int,
        say: Tell,
    ) -> None:
        self.source, self.t_ref_c = source, t_ref_c
        # one run does not carry a second name
        self.rules = rules if source.seen.runs > 1 else replace(rules, most=1)
        self.draws, self.seed, self.workers, self.say = draws, seed, workers, say

    def run(self) -> Discrepancy:
        """Go through all of it."""
        source, serial = self.source, self.source.channel.serial
        self.say(f"{serial}: noise floor of {len(source.blocks.times)} block means")
        plain = source.problem((), NoiseShape())
        floor = estimate_floor(plain.times, plain.residual, plain.saturated)
        problem = source.problem((), floor.shape)
        view = View(problem, floor.shape, floor.sigma)
        foresight = foresee(view, problem.candidates)
        self.say(f"{serial}: {self.draws} simulated nulls")
        laws = self._calibrated(problem, floor)
        self.say(f"{serial}: trying {len(problem.candidates)} effects")
        search = Search(source, floor, laws, self.rules, self._calibrated)
        result = search.run()
        if source.seen.runs == 1 and {s.choice.name for s in result.slots} & ORDERS:
            # a missing order is alike in heating and cooling: history may be beside it
            search = Search(source, floor, laws, replace(self.rules, most=2), self._calibrated)
            result = search.run()
        return self._conclude(search, foresight, result)

    def _calibrated(self, problem: Problem, floor: NoiseFloor) -> Calibration:
        rng = np.random.default_rng(self.seed)
        return calibrate(problem, floor, draws=self.draws, rng=rng, workers=self.workers)

    def _conclude(self, search: Search, foresight: Foresight, result: SearchResult) -> Discrepancy:
        source, laws, floor = self.source, search.laws, result.floor
        choices = tuple(s.choice for s in result.slots)
        white_ug = self._white_ug(result)
        drift = floor.sigma * np.sqrt(floor.shape.slow_share(source.blocks.times.span_s))
        verdict = judge(
            search.view(choices),
            result,
            laws,
            self.rules,
            too_much_drift=bool(drift > MOST_DRIFT * white_ug),
        )
        if verdict.verdict not in ("named", "alias"):
            choices = ()
        before = source.fitted((), floor.shape)
        after = source.fitted(choices, floor.shape)
        plain = source.fitted((), EQUAL), source.fitted(choices, EQUAL)
        places = locate(search.view([]), laws)
        where = _where(places, verdict)
        self.say(f"{source.channel.serial}: runs held out")
        heldout = held_out(source, search, choices)
        invisible = _invisible(source, foresight)
        found = effects_found(source, after, result, floor) if choices else ()
        return Discrepancy(
            channel=source.channel,
            t_ref_c=self.t_ref_c,
            source=source,
            judgement=verdict,
            result=result,
            laws=laws,
            foresight=foresight,
            invisible=invisible,
            floor=floor,
            before=before,
            after=after,
            plain_before=plain[0],
            plain_after=plain[1],
            effects=found,
            where=where,
            where_text=where_text(where, verdict),
            rms_before_ug=rms(reading_residual_ug(source.channel, plain[0])),
            rms_after_ug=rms(reading_residual_ug(source.channel, plain[1])),
            floor_ug=floor_ug(source, after, floor, search.view([]).problem.saturated),
            heldout=heldout,
            experiment=propose(source, result, verdict, invisible, floor),
        )

    def _white_ug(self, result: SearchResult) -> float:
        """Return the white sigma of a reading: from within blocks where there is enough."""
        source = self.source
        fitted = source.fitted([s.choice for s in result.slots], result.floor.shape)
        sigma, dof = source.blocks.spread(reading_residual_ug(source.channel, fitted))
        if dof > 100:
            return sigma
        return result.floor.sigma * float(np.sqrt(source.blocks.usual))


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
    held = {e.name for e in source.effects if source.holds(e)}
    return tuple(e.name for e in source.effects if e.name not in shown | held)
