"""The steps that compare every effect with its rivals, after all have been added."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.discrepancy.events import events_of
from errormodel.discrepancy.scan import Found, Prepared, View
from errormodel.discrepancy.search.adding import renewed_noise
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.ranking import (
    Ranked,
    beside_own_noise,
    chi_square,
    gain_of,
    lasting,
    parameter_count,
    ranked_by_gain,
    ranked_events,
    simplest_first,
)
from errormodel.discrepancy.search.state import SearchState, Slot
from errormodel.discrepancy.wander import over_wander

ROUNDS = 2  # passes through all slots, while a rival replaces an effect
# A rival's flexible form is tried where its plain form explains this share of the best.
NEAR = 0.5


def settle_slots(state: SearchState) -> SearchState:
    """Try the whole library in place of every effect; remove effects that no longer qualify."""
    slots: list[Slot] = []
    for _ in range(ROUNDS):
        slots, moved = [], False
        for k in range(len(state.chosen)):
            others = (*state.chosen[:k], *state.chosen[k + 1 :])
            present = state.chosen[k]
            slot = _slot(state, others, present)
            if slot is None:
                return settle_slots(replace(state, chosen=others))
            slots.append(slot)
            state = replace(state, chosen=(*state.chosen[:k], slot.choice, *state.chosen[k + 1 :]))
            if slot.choice.name != present.name:
                moved = True
                entered = {**state.p_at_entry, slot.choice.name: slot.p_value}
                state = renewed_noise(replace(state, p_at_entry=entered))
        if not moved:
            break
    return replace(state, slots=tuple(slots))


def forget_noise_without_effects(state: SearchState) -> SearchState:
    """Return to the noise of the present model where no effect is left."""
    if state.slots:
        return state
    return replace(state, floor=state.task.floor, nulls=state.task.nulls)


def measure_gain(state: SearchState) -> SearchState:
    """Measure the chi-square that the effects found explain together."""
    if not state.slots:
        return state
    explained = chi_square(state.view(())) - chi_square(state.view(state.found))
    return replace(state, explained=explained)


def compare_with_wander(state: SearchState) -> SearchState:
    """Compute the likelihood ratio of the named events to a smooth wander."""
    passing = state.problem(()).events
    events = [c for c in state.found if c.name in passing]
    if not events or not state.shapes:
        return state
    problem = state.problem([c for c in state.found if c.name not in passing])
    by_name = {c.name: c for c in problem.candidates}
    columns = np.hstack([by_name[c.name].signature(c.theta).columns for c in events])
    parameters = columns.shape[1] + sum(len(c.theta) for c in events)
    return replace(state, over_wander=over_wander(problem, state.shapes, columns, parameters))


def _slot(state: SearchState, others: Sequence[Choice], present: Choice) -> Slot | None:
    """Return the best effect in a slot with its rivals; None if none qualifies."""
    view = state.view(others)
    if state.shapes and present.name in {c.name for c in events_of(view.problem)}:
        ranked = _rivals_of_event(state, view, present)
    else:
        ranked = _rivals_in_flexible_form(view, ranked_by_gain(state, view), present)
    ranked = simplest_first(ranked)
    first, best = ranked[0], ranked[0].found
    name, event = best.candidate.name, best.candidate.event
    # an event was tested when it entered; the noise has since been estimated with it
    entered = state.p_at_entry.get(name, state.p_at_entry.get(present.name, 1.0))
    p_value = entered if event else first.p_value
    stands_as_it_entered = event and not others
    if first.score < state.rules.least and not stands_as_it_entered:
        return None
    if not event and p_value >= state.rules.alpha:
        return None
    top = max(r.score for r in ranked)
    below = [(r.found.candidate.name, top - r.score) for r in ranked]
    alias = tuple(n for n, b in below if b < state.rules.alias)
    if not others:
        alias = tuple(dict.fromkeys((*alias, *state.pairs_instead.get(name, ()))))
    return Slot(
        choice=Choice(name, best.theta, flexible=first.flexible),
        gain=gain_of(view, best) if event else best.gain,
        p_value=p_value,
        rivals=tuple(below[1:]),
        alias=alias,
    )


def _rivals_of_event(state: SearchState, view: View, present: Choice) -> list[Ranked]:
    """Return the library in the place of an event, the best first.

    A noise estimated with one event favours that event, so each gets its own noise.
    """
    steady = [r for r in ranked_by_gain(state, view) if not r.found.candidate.event]
    ranked = [*ranked_events(state, view), *beside_own_noise(state, view, steady)]
    ranked = sorted(ranked, key=lambda r: -r.score)
    if present.name not in view.problem.events:
        ranked = lasting(view, ranked)
    able = (r for r in ranked if r.found.candidate.event or r.p_value < state.rules.alpha)
    first = next(able)
    return [first, *(r for r in ranked if r is not first)]


def _rivals_in_flexible_form(view: View, ranked: list[Ranked], present: Choice) -> list[Ranked]:
    """Use the flexible form for an effect if it was selected, and for every rival.

    A rival counts as separated only if its flexible form is. An effect whose plain form explains
    less than half as much is not a rival.
    """
    near = NEAR * max(r.score for r in ranked)

    def in_best_form(one: Ranked) -> Ranked:
        if one.found.candidate.name == present.name:
            return _in_flexible_form(view, one) if present.flexible else one
        flexible = _in_flexible_form(view, one) if one.score > near else one
        return flexible if flexible.score > one.score else one

    return sorted(map(in_best_form, ranked), key=lambda r: -r.score)


def _in_flexible_form(view: View, plain: Ranked) -> Ranked:
    """Return an effect in its flexible form, with a penalty for its further parameters."""
    candidate = plain.found.candidate
    if candidate.flexible is None:
        return plain
    flexible = Prepared(view, [candidate.flexible]).scan()[0]
    more = parameter_count(candidate.flexible) - parameter_count(candidate)
    found = Found(
        candidate=candidate,
        theta=flexible.theta,
        gain=flexible.gain,
        grid_gain=max(plain.found.grid_gain, flexible.grid_gain),
    )
    score = plain.score + flexible.gain - plain.found.gain - 2.0 * more
    return Ranked(found, score, plain.p_value, flexible=True)
