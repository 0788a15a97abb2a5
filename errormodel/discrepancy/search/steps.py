"""The search: named steps, each from one state to the next, with the thresholds it applies."""

from collections.abc import Callable
from dataclasses import dataclass

from errormodel.discrepancy.search.adding import (
    enter_likeliest,
    renew_noise_beside_event,
    take_flexible_form,
    take_pair_instead,
)
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.settling import (
    compare_with_wander,
    forget_noise_without_effects,
    measure_gain,
    settle_slots,
)
from errormodel.discrepancy.search.state import SearchState, SearchTask, first_state


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a search; `thresholds` are the fields of `Rules` that it applies."""

    name: str
    action: Callable[[SearchState], SearchState]
    thresholds: tuple[str, ...] = ()


# Steps that are repeated until no further effect enters, at most `Rules.most` times.
ROUND = (
    Step(
        "the likeliest effect is added",
        enter_likeliest,
        ("alpha", "alpha_event", "further", "further_event", "relative"),
    ),
    Step("its flexible form is tried", take_flexible_form, ("flexible",)),
    Step("the noise is estimated together with an event", renew_noise_beside_event),
    Step(
        "two effects are tried in place of the first",
        take_pair_instead,
        ("pairs", "further", "least", "relative"),
    ),
)
# Steps after all effects have entered.
CLOSE = (
    Step("every effect is compared with its rivals", settle_slots, ("least", "alpha", "alias")),
    Step("without effects, the noise of the present model is kept", forget_noise_without_effects),
    Step("their joint explanation is computed", measure_gain),
    Step("events are compared with a smooth wander", compare_with_wander),
)


def choose_effects(task: SearchTask) -> tuple[Choice, ...]:
    """Return the effects that enter, without comparing them with their rivals."""
    return _added(task).chosen


def search(task: SearchTask) -> SearchState:
    """Search for missing effects.

    Parameters
    ----------
    task : SearchTask

    Returns
    -------
    SearchState
        The last state: the named effects and the noise.
    """
    state = _added(task)
    for step in CLOSE:
        state = step.action(state)
    return state


def _added(task: SearchTask) -> SearchState:
    state = first_state(task)
    for _ in range(task.rules.most):
        for step in ROUND:
            state = step.action(state)
            if state.complete:
                return state
    return state
