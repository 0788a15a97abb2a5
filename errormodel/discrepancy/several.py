"""Several terms of the present model's own equation missing at once.

One cause of many unknowns imitates several terms that are missing together better than any of them
does alone, so a search that adds one effect after another begins with the wrong one. So the search
is made twice, from the present model and from the present model with the terms of its equation that
the data call for jointly, and the explanation that is likelier stands, each effect at its price.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.choices import Choice, Rules, SearchResult, Slot, Source
from errormodel.discrepancy.nulls import Calibration
from errormodel.discrepancy.ranking import chi_square, unknowns_of
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search import Recalibrate, Search
from errormodel.linear import independent
from errormodel.noise.model import NoiseFit


def search_all(
    source: Source,
    floor: NoiseFit,
    laws: Calibration,
    rules: Rules,
    again: Recalibrate | None = None,
) -> tuple[Search, SearchResult]:
    """Search from the present model and from its equation's block, and return the likelier.

    Where neither is clearly likelier, the effects of the other join the alias sets of the one with
    fewer effects: no name of it is bare.

    Returns
    -------
    Search, SearchResult
        The search that stands, with its noise and laws, and what it found.
    """
    plain = Search(source, floor, laws, rules, again)
    view = plain.view([])
    alone = plain.run()
    block = joint_block(view, rules.further)
    if not alone.slots or len(block) < 2:
        return plain, alone
    joint = Search(source, floor, laws, rules, again, block)
    together = joint.run()
    names = {c.name for c in block}
    together = replace(
        together, started=tuple(s.choice.name for s in together.slots if s.choice.name in names)
    )
    if {s.choice.name for s in alone.slots} == {s.choice.name for s in together.slots}:
        return joint, together
    better = _price(source, floor, rules, alone) - _price(source, floor, rules, together)
    if better > rules.alias:
        return joint, together
    if better > -rules.alias:
        return plain, _beside(alone, together)
    return plain, alone


def joint_block(view: View, least: float) -> tuple[Choice, ...]:
    """Return the effects of the equation that the data call for beside all others of it.

    Parameters
    ----------
    view : View
        Of the present model.
    least : float
        Chi-square beyond its unknowns that each must explain beside the others.
    """
    candidates = [c for c in view.problem.candidates if c.joint and not c.event]
    points = view.points([c.prepared()[0] for c in candidates])
    kept = [(c, p.basis) for c, p in zip(candidates, points, strict=True) if p.basis.shape[1] > 0]
    while kept:
        whole = _explained(view, [b for _, b in kept])
        own = [
            whole - _explained(view, [b for j, (_, b) in enumerate(kept) if j != k]) - b.shape[1]
            for k, (_, b) in enumerate(kept)
        ]
        least_needed = int(np.argmin(own))
        if own[least_needed] > least:
            break
        kept.pop(least_needed)
    return tuple(Choice(c.name, c.grid[0]) for c, _ in kept)


def _explained(view: View, bases: Sequence[FloatArray]) -> float:
    """Return the chi-square that columns beside the present model explain together."""
    if not bases:
        return 0.0
    return float(np.sum((independent(np.hstack(bases)).T @ view.data) ** 2))


def _price(source: Source, floor: NoiseFit, rules: Rules, result: SearchResult) -> float:
    """Return the chi-square left under the first noise, with what unknowns and names cost."""
    choices = [s.choice for s in result.slots]
    left = chi_square(View(source.problem(choices, floor.noise), floor.noise))
    known = {c.name: c for c in source.problem((), floor.noise).candidates}
    unknowns = 0
    for choice in choices:
        candidate = known[choice.name]
        unknowns += unknowns_of((candidate.richer if choice.rich else None) or candidate)
    return left + 2.0 * unknowns + rules.least * len(choices)


def _beside(alone: SearchResult, together: SearchResult) -> SearchResult:
    """Return a result whose names are told as no likelier than those of another."""
    own = {s.choice.name for s in alone.slots}
    others = tuple(s.choice.name for s in together.slots if s.choice.name not in own)
    kept = {s.choice.name for s in together.slots}

    def doubted(slot: Slot) -> Slot:
        if slot.choice.name in kept:
            return slot
        return replace(slot, alias=tuple(dict.fromkeys((*slot.alias, *others))))

    return replace(alone, slots=tuple(doubted(s) for s in alone.slots))
