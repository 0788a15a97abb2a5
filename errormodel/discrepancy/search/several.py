"""Several terms of the present model's own equation missing at once.

A cause with many parameters can imitate several missing terms better than any single one of them,
so a search that adds one effect after another would begin with the wrong one. The search is
therefore made twice: from the present model, and from the present model plus the terms of its
equation that are jointly significant. The likelier explanation is kept, with a penalty for each
effect.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.ranking import chi_square, parameter_count
from errormodel.discrepancy.search.state import SearchState, SearchTask, Slot
from errormodel.discrepancy.search.steps import search
from errormodel.linear import independent


def search_all(task: SearchTask) -> SearchState:
    """Search from the present model and from its equation's block, and return the likelier.

    If neither is clearly likelier, the effects of the other join the alias sets of the one with
    fewer effects, so none of its effects is named alone.
    """
    alone = search(task)
    view = View(task.source.problem((), task.floor.noise), task.floor.noise)
    block = joint_block(view, task.rules.further)
    if not alone.slots or len(block) < 2:
        return alone
    together = search(replace(task, start=block))
    names = {c.name for c in block}
    together = replace(together, started=tuple(c.name for c in together.found if c.name in names))
    if {c.name for c in alone.found} == {c.name for c in together.found}:
        return together
    better = _price(alone) - _price(together)
    if better > task.rules.alias:
        return together
    if better > -task.rules.alias:
        return _without_bare_names(alone, together)
    return alone


def joint_block(view: View, least: float) -> tuple[Choice, ...]:
    """Return the effects of the equation that are significant beside all its others.

    Parameters
    ----------
    view : View
        View of the present model.
    least : float
        Chi-square beyond its parameters that each must explain beside the others.
    """
    candidates = [c for c in view.problem.candidates if c.joint and not c.event]
    points = view.points([c.grid_signatures[0] for c in candidates])
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


def _price(result: SearchState) -> float:
    """Return the remaining chi-square with the penalties of parameters and names."""
    task = result.task
    noise, choices = task.floor.noise, result.found
    left = chi_square(View(task.source.problem(choices, noise), noise))
    known = {c.name: c for c in task.source.problem((), noise).candidates}
    parameters = 0
    for choice in choices:
        candidate = known[choice.name]
        form = candidate.flexible if choice.flexible else None
        parameters += parameter_count(form or candidate)
    return left + 2.0 * parameters + task.rules.least * len(choices)


def _without_bare_names(alone: SearchState, together: SearchState) -> SearchState:
    """Return a result in which equally likely names of another become alias sets."""
    own = {c.name for c in alone.found}
    kept = {c.name for c in together.found}
    others = tuple(c.name for c in together.found if c.name not in own)

    def with_others(slot: Slot) -> Slot:
        if slot.choice.name in kept:
            return slot
        return replace(slot, alias=tuple(dict.fromkeys((*slot.alias, *others))))

    return replace(alone, slots=tuple(with_others(s) for s in alone.slots))
