"""From measurements to verdicts: the sequence that a chamber's runs and a rig's run go through.

The noise floor, null distributions, foresight, the search, the verdict and where the disagreement
is, parts of the measurement held out, and the next experiment. What differs between instruments is
a `Measurement`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from errormodel.discrepancy.choices import Choice, Rules
from errormodel.discrepancy.foresight import Foresight, foresee
from errormodel.discrepancy.gate import FactorFinding, Judgement, Verdict, judge, locate
from errormodel.discrepancy.nulls import NullDistributions, simulate_nulls
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search import choose_effects
from errormodel.discrepancy.several import search_all
from errormodel.discrepancy.state import SearchState, SearchTask
from errormodel.errors import NotSeparableError
from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import NoiseFit, NoiseModel

Gap = TypeVar("Gap")
Proposal = TypeVar("Proposal")
Tell = Callable[[str], None]


class Refuted(Protocol):
    """Evidence of other measurements against an effect found in one."""

    @property
    def effect(self) -> str:
        """Name of the effect."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """A verdict and the result it is of, with a rival outside the library where there is one."""

    judgement: Judgement
    result: SearchState
    rival: object = None


class Measurement(ABC, Generic[Gap, Proposal]):
    """A measurement, its present model and the library of what may be missing.

    Attributes
    ----------
    name : str
        For lines of progress; may be empty.
    parts_name : str
        Name of what is held out: runs, cycles.
    known_noise : NoiseFit or None
        None where it is to be estimated.
    """

    name: str = ""
    parts_name: str = "parts"
    known_noise: NoiseFit | None = None

    @abstractmethod
    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the engine's problem of the model with some effects, refitted under a noise."""

    @abstractmethod
    def invisible(self, foresight: Foresight) -> tuple[str, ...]:
        """Return the effects that the measurement cannot show, whatever their size."""

    @abstractmethod
    def next_experiment(
        self, result: SearchState, judgement: Judgement, invisible: tuple[str, ...]
    ) -> Proposal | None:
        """Return the experiment that would settle what is open; None when nothing is."""

    @abstractmethod
    def parts(self, choices: Sequence[Choice]) -> Sequence[int]:
        """Return the parts to be held out, one after another; none where there are too few."""

    @abstractmethod
    def without_part(self, part: int) -> "Measurement[Gap, Proposal]":
        """Return the measurement without one part."""

    @abstractmethod
    def gap(self, part: int, others: "Measurement[Gap, Proposal]", chosen: Sequence[Choice]) -> Gap:
        """Return the gap in a part, before and after, by effects that the others chose."""

    def rules(self, rules: Rules) -> Rules:
        """Return the thresholds for this measurement."""
        return rules

    def wider_rules(self, result: SearchState) -> Rules | None:
        """Return thresholds to search by again, after what a first search found."""
        del result
        return None

    def refuted(
        self, of: "Searched[Gap, Proposal]", every: Sequence["Searched[Gap, Proposal]"]
    ) -> tuple[Refuted, ...]:
        """Return the effects found that measurements made at the same time refute."""
        del of, every
        return ()

    def without_effects(self, names: frozenset[str]) -> "Measurement[Gap, Proposal]":
        """Return the measurement with a smaller library."""
        raise NotImplementedError(f"nothing refutes {names}")

    def drifts_too_much(self, result: SearchState) -> bool:
        """Tell whether the noise found is more than an instrument's drift can be."""
        del result
        return False

    def revised(
        self, judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
    ) -> Revision:
        """Return the verdict after what only this kind of measurement is held against."""
        del places
        return Revision(judgement, result)


AnyMeasurement = TypeVar("AnyMeasurement", bound=Measurement[Any, Any])


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of an investigation.

    Attributes
    ----------
    rules : Rules
    draws : int
        Simulated nulls that calibrate every statistic.
    seed : int
        Seed of the draws.
    workers : int
        Threads that simulate them; the verdict does not depend on it.
    tell : callable
        Takes a line of progress.
    """

    rules: Rules
    draws: int
    seed: int
    workers: int = 1
    tell: Tell = lambda line: None

    def nulls(self, problem: Problem, floor: NoiseFit) -> NullDistributions:
        """Simulate the null distributions of a problem."""
        rng = np.random.default_rng(self.seed)
        return simulate_nulls(problem, floor, draws=self.draws, rng=rng, workers=self.workers)

    def say(self, name: str, line: str) -> None:
        """Tell a line of progress of a measurement."""
        self.tell(f"{name}: {line}" if name else line)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Searched(Generic[Gap, Proposal]):
    """A measurement that has been searched, before its verdict.

    Attributes
    ----------
    measurement : Measurement
    foresight : Foresight
    result : SearchState
    refuted : tuple of Refuted
        Effects that measurements made at the same time refute.
    replaced : bool
        Other effects have come in their place, and explain clearly less than they did: their names
        do not stand.
    """

    measurement: Measurement[Gap, Proposal]
    foresight: Foresight
    result: SearchState
    refuted: tuple[Refuted, ...] = ()
    replaced: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Conclusion(Generic[Gap, Proposal]):
    """A verdict and everything it stands on, whatever was measured.

    Attributes
    ----------
    judgement : Judgement
    result : SearchState
    foresight : Foresight
    invisible : tuple of str
        Effects that the measurement cannot show.
    places : tuple of FactorFinding
        Every factor with how much of the excess it carries, the best first; none where nothing is.
    held_out : tuple
        The gap in every part held out.
    experiment : Proposal or None
    refuted : tuple of Refuted
    rival : object
        A rival outside the library that the names were held against, such as a slow drift.
    """

    judgement: Judgement
    result: SearchState
    foresight: Foresight
    invisible: tuple[str, ...]
    places: tuple[FactorFinding, ...]
    held_out: tuple[Gap, ...]
    experiment: Proposal | None
    refuted: tuple[Refuted, ...]
    rival: object

    @property
    def verdict(self) -> Verdict:
        """One of named, alias, unexplained_repeatable, unexplained_noise, nothing."""
        return self.judgement.verdict

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The effects whose names stand."""
        return self.result.found if self.judgement.names_stand else ()

    @property
    def alias_sets(self) -> tuple[tuple[str, ...], ...]:
        """Effects that these data cannot tell apart."""
        if self.verdict != "alias":
            return ()
        return tuple(s.alias for s in self.result.slots if len(s.alias) > 1)

    @property
    def inherited(self) -> dict[str, Any]:
        """The fields by name, for a conclusion that says more."""
        return {f.name: getattr(self, f.name) for f in fields(Conclusion)}


def investigate(
    measurements: Sequence[AnyMeasurement], settings: Settings
) -> tuple[tuple[AnyMeasurement, Conclusion[Any, Any]], ...]:
    """Find and name what is missing from the models of measurements made together.

    Parameters
    ----------
    measurements : sequence of Measurement
    settings : Settings

    Returns
    -------
    tuple of (Measurement, Conclusion)
        In the same order; a measurement's library lacks what the others refuted.
    """
    searched = _without_refuted([_searched(m, settings) for m in measurements], settings)
    made: list[tuple[AnyMeasurement, Conclusion[Any, Any]]] = []
    for one in searched:
        revision, places = _judged(one)
        judgement, result = revision.judgement, revision.result
        measurement: Any = one.measurement
        choices = result.found if judgement.names_stand else ()
        settings.say(measurement.name, f"{measurement.parts_name} held out")
        invisible = measurement.invisible(one.foresight)
        conclusion: Conclusion[Any, Any] = Conclusion(
            judgement=judgement,
            result=result,
            foresight=one.foresight,
            invisible=invisible,
            places=places,
            held_out=hold_out(measurement, result, choices),
            experiment=measurement.next_experiment(result, judgement, invisible),
            refuted=one.refuted,
            rival=revision.rival,
        )
        made.append((measurement, conclusion))
    return tuple(made)


def _searched(measurement: Measurement[Any, Any], settings: Settings) -> Searched[Any, Any]:
    """Go through noise, null distributions and library for one measurement."""
    floor = measurement.known_noise
    if floor is None:
        plain = measurement.problem((), NoiseModel())
        settings.say(measurement.name, f"noise floor of {len(plain.times)} block means")
        floor = estimate_floor(plain.times, plain.residual, plain.saturated)
    settings.say(measurement.name, f"{settings.draws} simulated nulls")
    nulls = settings.nulls(measurement.problem((), floor.noise), floor)
    return _searched_under(measurement, floor, nulls, settings)


def _searched_under(
    measurement: Measurement[Any, Any],
    floor: NoiseFit,
    nulls: NullDistributions,
    settings: Settings,
) -> Searched[Any, Any]:
    """Search the library under a noise and its null distributions."""
    problem = measurement.problem((), floor.noise)
    foresight = foresee(View(problem, floor.noise), problem.candidates)
    settings.say(measurement.name, f"trying {len(problem.candidates)} effects")
    task = SearchTask(
        source=measurement,
        floor=floor,
        nulls=nulls,
        rules=measurement.rules(settings.rules),
        recalibrate=settings.nulls,
    )
    result = search_all(task)
    wider = measurement.wider_rules(result)
    if wider is not None:
        result = search_all(replace(task, rules=wider))
    return Searched(measurement=measurement, foresight=foresight, result=result)


def _without_refuted(
    searched: Sequence[Searched[Any, Any]], settings: Settings
) -> list[Searched[Any, Any]]:
    """Search again without the effects that measurements made at the same time refute."""
    every = list(searched)
    while True:
        refuted = [one.measurement.refuted(one, every) for one in every]
        if not any(refuted):
            return every
        every = [
            _searched_without(one, against, settings) if against else one
            for one, against in zip(every, refuted, strict=True)
        ]


def _searched_without(
    one: Searched[Any, Any], refuted: tuple[Refuted, ...], settings: Settings
) -> Searched[Any, Any]:
    """Search a measurement again with effects left out of the library.

    Noise and nulls stay: with fewer effects, chance could do no more than it can with all.
    """
    names = frozenset(r.effect for r in refuted)
    settings.say(one.measurement.name, f"once more without {', '.join(sorted(names))}")
    task, measurement = one.result.task, one.measurement.without_effects(names)
    again = _searched_under(measurement, task.floor, task.nulls, settings)
    others = {c.name for c in again.result.found} - one.result.names
    lost = one.result.explained - again.result.explained
    rules = measurement.rules(settings.rules)
    clearly = max(rules.further, rules.relative**2 * again.result.explained)
    return replace(
        again,
        refuted=(*one.refuted, *refuted),
        replaced=one.replaced or (bool(others) and lost > clearly),
    )


def _judged(one: Searched[Any, Any]) -> tuple[Revision, tuple[FactorFinding, ...]]:
    """Return the verdict with the result it is of, and where the disagreement is.

    Names that came in the place of refuted ones must explain as much.
    """
    result = one.result
    judgement = judge(
        result.view(result.found),
        result,
        result.nulls,
        result.rules,
        too_much_drift=one.measurement.drifts_too_much(result),
    )
    if one.replaced and judgement.names_stand:
        judgement = replace(judgement, verdict="unexplained_repeatable")
    places = () if judgement.verdict == "nothing" else locate(result.view(()), result.nulls)
    return one.measurement.revised(judgement, result, places), places


def hold_out(
    measurement: Measurement[Gap, Proposal], result: SearchState, choices: Sequence[Choice]
) -> tuple[Gap, ...]:
    """Predict each part from the others, the choice of effects repeated without it.

    The choice is made under the noise and the null distributions of the whole.

    Returns
    -------
    tuple of Gap
        One a part; none where the others of some part cannot give the present model.
    """
    gaps: list[Gap] = []
    for part in measurement.parts(choices):
        others = measurement.without_part(part)
        task = replace(
            result.task,
            source=others,
            floor=result.floor,
            nulls=replace(result.nulls, shapes=()),
            recalibrate=None,
        )
        try:
            chosen = choose_effects(task) if choices else ()
            gaps.append(measurement.gap(part, others, chosen))
        except (NotSeparableError, np.linalg.LinAlgError):
            return ()
    return tuple(gaps)
