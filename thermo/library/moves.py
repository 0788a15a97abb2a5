"""Errors that follow the head's last turn: they die away after it, or keep its direction."""

from collections.abc import Callable, Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Effect, Memory, Parameter, Place, Term, Values, by_run
from thermo.library.effects import (
    MICRO,
    Context,
    Example,
    Form,
    ThermalEffect,
    log_grid,
    millionths,
    plain_form,
)

ORDINARY = 1e-3  # 1 mg: wider than any accelerometer
TURNED_DEG = 0.005  # least turn of a head; a step of its drive is a thousandth of a degree
CHANGED_G = 1e-4  # the same as a change of force


def last_changes(
    time_s: FloatArray, level: FloatArray, least: float, memory: Memory
) -> tuple[FloatArray, FloatArray, Memory]:
    """Return the time since a level last changed, how much it changed, and what goes on.

    Parameters
    ----------
    time_s, level : ndarray, shape (n,)
        Of one run.
    least : float
        A change of less is none.
    memory : tuple or None
        Level, time and size of the last change before these readings.

    Returns
    -------
    since_s, size : ndarray, shape (n,)
        Infinite and 0 before the first change.
    memory : tuple
    """
    before, changed_s, size = memory or (float(level[0]), -np.inf, 0.0)
    steps = np.diff(level, prepend=before)
    at = np.flatnonzero(np.abs(steps) > least)
    which = np.searchsorted(at, np.arange(level.size), side="right")
    times = np.concatenate([[changed_s], time_s[at]])[which]
    sizes = np.concatenate([[size], steps[at]])[which]
    return time_s - times, sizes, (float(level[-1]), float(times[-1]), float(sizes[-1]))


def _after_turn(
    name: str,
    symbol: str,
    sentence: str,
    column: Callable[[FloatArray, FloatArray, Values], FloatArray],
    *,
    signal: str = "head_deg",
    least: float = TURNED_DEG,
    parameters: Sequence[Parameter] = (),
    family: str = "",
    label: str = "",
    place: Place = "input",
) -> Term:
    """Return a term whose column is made of the time since the last turn and of its size."""

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        level = record[signal][readings]
        since_s, size, after = last_changes(record.time_s[readings], level, least, memory)
        return column(since_s, size, values), after

    return Term(
        name=name,
        sentence=sentence,
        place=place,
        coefficients=(
            millionths(name, symbol, "µg", prior_sigma=ORDINARY, family=family, label=label),
        ),
        columns=by_run(one_run),
        needs=frozenset([signal]),
        parameters=tuple(parameters),
    )


def _decay(since_s: FloatArray, values: Values) -> FloatArray:
    return np.exp(-since_s / values["settling_tau_s"])


def settling_after_move() -> Term:
    """Return a bias that dies away after each turn of the head."""
    return _after_turn(
        "settling_after_move",
        "M",
        "The bias dies away after each turn of the head.",
        lambda since_s, size, values: _decay(since_s, values),
        parameters=[
            Parameter(
                name="settling_tau_s",
                symbol="τm",
                unit="s",
                lo=3.0,
                hi=1200.0,
                start=30.0,
                family="settling_after_move",
                label="tau",
            )
        ],
    )


def settling_by_direction() -> Term:
    """Return the part of that bias which has the sign of the turn."""
    return _after_turn(
        "settling_by_direction",
        "Md",
        "The bias dies away after each turn of the head, with the sign of the turn.",
        lambda since_s, size, values: _decay(since_s, values) * np.sign(size),
        family="settling_after_move",
        label="by direction",
    )


def move_friction() -> Term:
    """Return a bias that keeps the sign of the head's last turn until the next."""
    return _after_turn(
        "move_friction",
        "Fm",
        "The bias keeps the sign of the head's last turn, as friction in it does.",
        lambda since_s, size, values: np.sign(size),
    )


def stiction() -> Term:
    """Return a bias that keeps the sign of the last change of force along the input axis."""
    return _after_turn(
        "stiction",
        "Fi",
        "The bias keeps the sign of the last change of force along the input axis: the "
        "pendulum rests on the side that it came from.",
        lambda since_s, size, values: np.sign(size),
        signal="a_i_g",
        least=CHANGED_G,
    )


def _settling(at: Context) -> Sequence[Form]:
    plain = "settling_after_move"
    if at.term_names & {plain, "settling_by_direction"}:
        return []
    grid = log_grid(8.0, 400.0, 6)
    parameters = ("settling_tau_s",)
    return [
        Form(terms=(plain,), parameters=parameters, grid=grid),
        Form(terms=(plain, "settling_by_direction"), parameters=parameters, grid=grid),
    ]


TERMS: dict[str, Callable[[], Effect]] = {
    "settling_after_move": settling_after_move,
    "settling_by_direction": settling_by_direction,
    "move_friction": move_friction,
    "stiction": stiction,
}
EFFECTS = (
    ThermalEffect(
        name="settling_after_move",
        sentence="The bias dies away after each turn of the head, {size} at first.",
        forms=_settling,
        experiment="one turn of the head, then readings as fast as they come for some minutes",
        example=Example(
            term="settling_after_move",
            values={"settling_after_move": 40 / MICRO, "settling_tau_s": 60.0},
        ),
    ),
    ThermalEffect(
        name="move_friction",
        sentence="The bias keeps the sign of the head's last turn, {size}.",
        forms=plain_form("move_friction"),
        experiment="each position reached from both sides in turn, at one temperature",
        cause="head",
    ),
    ThermalEffect(
        name="stiction",
        sentence="The bias keeps the sign of the last change of force along the input axis, "
        "{size}.",
        forms=plain_form("stiction"),
        experiment="0° and 90° reached from more force and from less in turn, at one temperature",
        example=Example(term="stiction", values={"stiction": 20 / MICRO}),
    ),
)
