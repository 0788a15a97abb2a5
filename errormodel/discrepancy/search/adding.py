"""The steps by which effects enter a model, one round after another."""

from collections.abc import Sequence
from dataclasses import replace

from errormodel.discrepancy.scan import Prepared, View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.pairs import best_pair
from errormodel.discrepancy.search.ranking import (
    Ranked,
    beside_own_noise,
    chi_square,
    lasting,
    parameter_count,
    ranked_by_gain,
    ranked_events,
)
from errormodel.discrepancy.search.state import SearchState
from errormodel.noise.floor import estimate_floor

# Share of a pattern imitated by earlier effects, above which it may be due to their uncertain
# shape.
IMITATED = 0.3


def enter_likeliest(state: SearchState) -> SearchState:
    """Add the likeliest effect where it is significant; otherwise the search is complete."""
    view = state.view(state.chosen)
    ranked = _ranked_for_entry(state, view)
    if not ranked or not _is_significant(state, ranked[0]):
        return replace(state, complete=True)
    if state.chosen and not _is_further_effect(state, ranked[0], view):
        return replace(state, complete=True)
    best = ranked[0].found
    name = best.candidate.name
    return replace(
        state,
        chosen=(*state.chosen, Choice(name, best.theta)),
        p_at_entry={**state.p_at_entry, name: ranked[0].p_value},
    )


def take_flexible_form(state: SearchState) -> SearchState:
    """Give the last effect its flexible form where that explains clearly more."""
    return replace(state, chosen=_with_flexible_form(state, state.chosen))


def renew_noise_beside_event(state: SearchState) -> SearchState:
    """Estimate the noise and its null distributions anew where the last effect is an event."""
    return renewed_noise(state) if _last_is_event(state) else state


def take_pair_instead(state: SearchState) -> SearchState:
    """Replace the first effect by two if they explain clearly more.

    If they explain more, but not enough for a second name, the first is not named alone.
    """
    rules = state.rules
    if len(state.chosen) != 1 or not rules.pairs or rules.most < 2 or _last_is_event(state):
        return state
    first = state.chosen[0]
    view = state.view(())
    pair = best_pair(view, [c for c in view.problem.candidates if not c.event])
    if pair is None:
        return state
    one, other = pair
    (other,) = _with_flexible_form(state, (one, other))[1:]
    other, one = _with_flexible_form(state, (other, one))
    more = chi_square(state.view(state.chosen)) - chi_square(state.view((one, other)))
    beside = state.view((one,))
    second = next(c for c in beside.problem.candidates if c.name == other.name)
    found = Prepared(beside, [second]).scan()[0]
    own = Ranked(found, found.gain - state.nulls.expected_gain(second.name), 0.0)
    if more > rules.further and not _is_shape(state, own, beside):
        return replace(state, chosen=(one, other))
    names = (one.name, other.name)
    if more > rules.least and first.name not in names:
        return replace(state, pairs_instead={**state.pairs_instead, first.name: names})
    return state


def renewed_noise(state: SearchState) -> SearchState:
    """Return the state with the noise estimated beside the effects chosen, and its nulls."""
    problem = state.problem(state.chosen)
    if problem.noise is not None:
        return state
    floor = estimate_floor(problem.times, problem.residual, problem.saturated)
    state = replace(state, floor=floor)
    if state.task.recalibrate is None:
        return state
    nulls = state.task.recalibrate(state.problem(state.chosen), floor)
    return replace(
        state,
        nulls=replace(nulls, gains={**state.nulls.gains, **nulls.gains}),
        shapes=tuple(dict.fromkeys((*state.shapes, *nulls.shapes))),
    )


def _last_is_event(state: SearchState) -> bool:
    """Tell whether the last effect chosen was judged as an event."""
    candidates = state.problem(state.chosen[:-1]).candidates
    return any(c.event for c in candidates if c.name == state.chosen[-1].name)


def _with_flexible_form(state: SearchState, chosen: Sequence[Choice]) -> tuple[Choice, ...]:
    """Return choices, the last in its flexible form where that explains clearly more."""
    *before, last = chosen
    view = state.view(before)
    head = next(c for c in view.problem.candidates if c.name == last.name)
    if head.flexible is None:
        return tuple(chosen)
    plain, flexible = Prepared(view, [head, head.flexible]).scan()
    more = parameter_count(head.flexible) - parameter_count(head)
    if flexible.gain - plain.gain > state.rules.flexible + 2.0 * more:
        return (*before, Choice(last.name, flexible.theta, flexible=True))
    return tuple(chosen)


def _ranked_for_entry(state: SearchState, view: View) -> list[Ranked]:
    """Return candidates in the order in which they may enter.

    The statistic of an event is its likelihood ratio with its own noise. With a single run, events
    are left out if another effect enters: a second run can test a repeatable effect but not a step,
    and a step at a free time imitates a loop with only one reversal.
    """
    ranked = ranked_by_gain(state, view)
    if not state.shapes:
        return ranked
    steady = [r for r in ranked if not r.found.candidate.event]
    ranked = sorted([*steady, *ranked_events(state, view)], key=lambda r: -r.score)
    staying = lasting(view, ranked)
    if any(_is_significant(state, r) for r in staying):
        ranked = staying
    return _likelier_kind_first(state, view, ranked)


def _likelier_kind_first(state: SearchState, view: View, ranked: list[Ranked]) -> list[Ranked]:
    """Put the likelier kind first, repeatable effects or events.

    While it is missing, a repeatable effect may appear as an event and an event as a repeatable
    effect, so both are compared by the same likelihood ratio.
    """
    entering = [r for r in ranked if _is_significant(state, r)]
    steady = next((r for r in entering if not r.found.candidate.event), None)
    event = next((r for r in entering if r.found.candidate.event), None)
    first = steady or event
    if steady and event and beside_own_noise(state, view, [steady])[0].score < event.score:
        first = event
    return ranked if first is None else [first, *(r for r in ranked if r is not first)]


def _is_significant(state: SearchState, one: Ranked) -> bool:
    event = one.found.candidate.event
    return one.p_value < (state.rules.alpha_event if event else state.rules.alpha)


def _is_further_effect(state: SearchState, one: Ranked, view: View) -> bool:
    """Return True if a further effect is more than the uncertain shape of the earlier ones.

    The remainder of a random walk after one event resembles another event. A second event must
    therefore be as clear as a second repeatable effect. Beside repeatable effects, an event is
    tested like the first effect, unless the rules require more.
    """
    candidate, events = one.found.candidate, view.problem.events
    if candidate.name in events and any(c.name in events for c in state.chosen):
        return one.score >= state.rules.further
    if candidate.event:
        return one.score >= state.rules.further_event
    return not _is_shape(state, one, view)


def _is_shape(state: SearchState, one: Ranked, view: View) -> bool:
    """Return True if an effect is only the uncertain shape of earlier named effects."""
    if one.score < state.rules.further:
        return True
    plain = state.view(state.task.start)  # the shape of the equation's own terms is known
    signature = one.found.candidate.signature(one.found.theta)
    alone, beside = plain.strength(signature), view.strength(signature)
    imitated = 1.0 - (beside / alone) ** 2 if alone > 0 else 1.0
    total = chi_square(plain) - chi_square(view)
    return imitated > IMITATED and one.found.gain < state.rules.relative**2 * total
