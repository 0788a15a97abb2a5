"""From measurements to verdicts: the common procedure for chamber runs and rig runs.

The noise floor, null distributions, foresight, the search, the verdict and where the disagreement
is, parts of the measurement held out, and the next experiment. The differences between instruments
are in `Measurement`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Generic, TypeVar

import numpy as np

from errormodel.discrepancy.foresight import Foresight, foresee_candidates
from errormodel.discrepancy.gate import FactorFinding, Judgement, Verdict, judge, locate
from errormodel.discrepancy.measurement import (
    Gap,
    Measurement,
    Proposal,
    Refuted,
    Revision,
    Searched,
)
from errormodel.discrepancy.nulls import NullDistributions, simulate_nulls
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice, Rules
from errormodel.discrepancy.search.several import search_all
from errormodel.discrepancy.search.state import SearchState, SearchTask
from errormodel.discrepancy.search.steps import choose_effects
from errormodel.errors import NotSeparableError
from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import NoiseFit, NoiseModel

Tell = Callable[[str], None]
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
        Receives progress lines.
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
        """Report a progress line of a measurement."""
        self.tell(f"{name}: {line}" if name else line)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Conclusion(Generic[Gap, Proposal]):
    """A verdict and its basis, for any kind of measurement.

    Attributes
    ----------
    judgement : Judgement
    result : SearchState
    foresight : Foresight
    invisible : tuple of str
        Effects that the measurement cannot show.
    places : tuple of FactorFinding
        Every factor with its share of the excess, the best first; empty if there is no excess.
    held_out_parts : tuple
        The gap in every part held out.
    experiment : Proposal or None
    refuted : tuple of Refuted
    rival : object
        A rival outside the library with which the names were compared, such as a slow drift.
    """

    judgement: Judgement
    result: SearchState
    foresight: Foresight
    invisible: tuple[str, ...]
    places: tuple[FactorFinding, ...]
    held_out_parts: tuple[Gap, ...]
    experiment: Proposal | None
    refuted: tuple[Refuted, ...]
    rival: object

    @property
    def verdict(self) -> Verdict:
        """One of named, alias, unexplained_repeatable, unexplained_noise, nothing."""
        return self.judgement.verdict

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The named effects."""
        return self.result.found if self.judgement.names_stand else ()

    @property
    def alias_sets(self) -> tuple[tuple[str, ...], ...]:
        """Effects that these data cannot separate."""
        if self.verdict != "alias":
            return ()
        return tuple(s.alias for s in self.result.slots if len(s.alias) > 1)

    @property
    def weight(self) -> float | None:
        """Posterior weight of the names and alias sets said; None where none is."""
        if not self.judgement.names_stand:
            return None
        return float(np.prod([s.weight for s in self.result.slots]))

    @property
    def inherited(self) -> dict[str, Any]:
        """The fields by name, for extended conclusions."""
        return {f.name: getattr(self, f.name) for f in fields(Conclusion)}


def investigate(
    measurements: Sequence[AnyMeasurement], settings: Settings
) -> tuple[tuple[AnyMeasurement, Conclusion[Any, Any]], ...]:
    """Find and name the missing effects of measurements made together.

    Parameters
    ----------
    measurements : sequence of Measurement
    settings : Settings

    Returns
    -------
    tuple of (Measurement, Conclusion)
        In the same order; effects that other measurements refuted are not in the library.
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
            held_out_parts=predict_parts(measurement, result, choices),
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
    foresight = foresee_candidates(View(problem, floor.noise), problem.candidates)
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

    Noise and nulls are kept: with fewer effects, chance cannot explain more than with all.
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
    """Return the verdict with its result and the place of the disagreement.

    Names that replaced refuted ones must explain as much.
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


def predict_parts(
    measurement: Measurement[Gap, Proposal], result: SearchState, choices: Sequence[Choice]
) -> tuple[Gap, ...]:
    """Predict each part from the others; the effects are selected again without it.

    The choice is made under the noise and the null distributions of the whole.

    Returns
    -------
    tuple of Gap
        One per part; empty if for some part the others do not determine the present model.
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
