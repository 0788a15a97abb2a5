"""The effect without a name: a shape of one quantity as the rival of the names found.

It is taken where it explains clearly more than they do, and predicts runs that it was not made
from.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.measurement import Revision
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.ranking import chi_square
from errormodel.discrepancy.search.state import SearchState
from errormodel.discrepancy.shape import (
    Formula,
    Shape,
    best_formula,
    fit_shape,
)
from errormodel.errors import NotSeparableError
from errormodel.noise.model import NoiseModel
from errormodel.terms import Effect, Term
from thermo.discrepancy.held_out import HeldOut, RunGap, gap_of_all, gap_of_run
from thermo.discrepancy.problem.source import ThermalSource
from thermo.discrepancy.shape.pattern import (
    PRICE,
    Pattern,
    factor_by_block,
    likeliest_pattern,
    sentence_of,
)
from thermo.library import term

# A shape is kept where it takes away this share of the mean square that runs held out show.
PREDICTS = 0.02
# What a name costs, beside its parameters: as where several are weighed against one.
PER_NAME, PER_PARAMETER = 10.0, 2.0
NAMED_SHARE = 0.5  # of what repeats, that names must explain to stand beside a shape


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeFound:
    """An effect without a name, and what it does on runs held out.

    Attributes
    ----------
    name : str
    pattern : Pattern
    formula : Formula or None
        A short formula that explains as much.
    sentence : str
    choices : tuple of Choice
        The effects beside it, and it.
    heldout : HeldOut
    """

    name: str
    pattern: Pattern
    formula: Formula | None
    sentence: str
    choices: tuple[Choice, ...]
    heldout: HeldOut

    def in_library(self) -> AbstractContextManager[None]:
        """Have its term in the library until the end of a block."""
        return self.pattern.in_library(self.name, self.sentence)

    def source_with(self, source: ThermalSource) -> ThermalSource:
        """Return a source whose library has the effect too."""
        return self.pattern.source_with(source, self.name)


def against_shape(
    source: ThermalSource, judgement: Judgement, result: SearchState, name: str
) -> Revision:
    """Hold the names found against a shape in the place of the last of them, and beside them.

    A name costs `PER_NAME` and `PER_PARAMETER` for each of its parameters; a shape costs what a
    further effect must explain, and its curves. The shape is taken only if it is clearly better
    and predicts held-out runs.

    Parameters
    ----------
    source : ThermalSource
    judgement : Judgement
    result : SearchState
    name : str
        Name that the shape will have.

    Returns
    -------
    Revision
        The names that are left, and the `ShapeFound` as their rival where there is one.
    """
    kept = Revision(judgement, result)
    if source.seen.runs < 2 or judgement.verdict in ("nothing", "unexplained_noise"):
        return kept
    noise, price = result.floor.noise, result.rules.further
    slots = sorted(result.slots, key=lambda s: -s.gain)
    alone = chi_square(result.view(()))
    best: tuple[float, int, float, Pattern] | None = None
    for count in range(len(slots) + 1):
        beside = tuple(s.choice for s in slots[:count])
        pattern = likeliest_pattern(source, beside, noise, rivals=judgement.names_stand)
        if pattern is None:
            continue
        explained = alone - chi_square(result.view(beside))
        score = explained - _cost(source, beside) + pattern.shape.score - price
        if best is None or score > best[0]:
            best = (score, count, explained, pattern)
    names_alone = result.explained - _cost(source, result.found)
    if best is None or best[0] < (names_alone if judgement.names_stand else 0.0) + PRICE:
        return kept
    _, count, explained, pattern = best
    beside = tuple(s.choice for s in slots[:count])
    found = find_shape(source, beside, noise, pattern, name)
    if found is None:
        return kept
    share = explained / (explained + pattern.shape.gain)
    stands = judgement.names_stand and share >= NAMED_SHARE
    verdict = judgement.verdict if stands else "unexplained_repeatable"
    left = replace(result, slots=tuple(slots[:count]), explained=explained)
    judgement = replace(judgement, verdict=verdict, explained_share=share, loud=True)
    return Revision(judgement, left, found)


def _cost(source: ThermalSource, chosen: Sequence[Choice]) -> float:
    """Return the chi-square that names must explain to be worth it."""
    terms = [term(n) for c in chosen for n in source.form_of(c).terms]
    parameters = sum(len(t.parameters) + _coefficients(t) for t in terms)
    return PER_PARAMETER * parameters + PER_NAME * len(chosen)


def _coefficients(one: Effect) -> int:
    return len(one.coefficients) if isinstance(one, Term) else 0


def find_shape(
    source: ThermalSource,
    beside: Sequence[Choice],
    noise: NoiseModel,
    pattern: Pattern,
    name: str,
) -> ShapeFound | None:
    """Return a pattern as an effect, if it predicts held-out runs.

    Parameters
    ----------
    source : ThermalSource
    beside : sequence of Choice
        Effects of the library that are in the model.
    noise : NoiseModel
    pattern : Pattern
    name : str
        The effect's.
    """
    choices = (*beside, Choice(name, ()))
    gaps: list[RunGap] = []
    for run in source.channel.run_ids:
        gap = _gap_without(source, run, beside, noise, pattern, name)
        if gap is None:
            return None
        gaps.append(gap)
    heldout = gap_of_all(gaps, source, beside)
    if heldout is None or heldout.after_ug**2 > (1.0 - PREDICTS) * heldout.before_ug**2:
        return None
    view = View(source.problem(tuple(beside), noise), noise)
    x, times = factor_by_block(source.seen, pattern.quantity, pattern.times)
    formula = best_formula(view, x, times)
    if formula is not None and not _as_good(formula, pattern.shape):
        formula = None
    return ShapeFound(
        name=name,
        pattern=pattern,
        formula=formula,
        sentence=sentence_of(pattern, formula),
        choices=choices,
        heldout=heldout,
    )


def _gap_without(
    source: ThermalSource,
    run: str,
    beside: Sequence[Choice],
    noise: NoiseModel,
    pattern: Pattern,
    name: str,
) -> RunGap | None:
    """Predict a run by the shape that the others give; None where they cannot give the model."""
    channel = source.channel
    kept = tuple(r for r in channel.run_ids if r != run)
    seen = channel.take(channel.runs_mask(kept))
    try:
        others = ThermalSource(seen, source.model, source.effects)
        view = View(others.problem(tuple(beside), noise), noise)
        x, by = factor_by_block(others.seen, pattern.quantity, pattern.times)
        shape = fit_shape(view, x, by, pattern.shape.knots)
        if shape is None:
            return gap_of_run(source, run, others, beside)
        of_others = replace(pattern, shape=shape)
        with of_others.in_library(name):
            larger = of_others.source_with(others, name)
            return gap_of_run(source, run, larger, (*beside, Choice(name, ())))
    except (NotSeparableError, np.linalg.LinAlgError):
        return None


def _as_good(formula: Formula, shape: Shape) -> bool:
    """Tell whether a formula explains as much as a shape, each after two for a parameter."""
    saved = 2.0 * (shape.size.size - formula.parameters)
    return shape.gain - formula.gain < max(PRICE, 0.05 * shape.gain) + saved
