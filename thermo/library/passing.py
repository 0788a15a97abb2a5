"""Terms of a campaign, a power-on or one time: a bias that relaxes, steps or drifts."""

from collections.abc import Callable, Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.terms import Effect, Parameter, Term
from thermo.library.effects import (
    EVENT_SHARE,
    MICRO,
    Context,
    Example,
    Form,
    ThermalEffect,
    log_grid,
    millionths,
    one_column,
    plain_form,
)

MAX_RUNS = 64  # whose turn-on offsets have names


def run_in() -> Term:
    """Return a bias that relaxes over the campaign."""
    return Term(
        name="run_in",
        sentence="Stress from assembly relaxes: the change of bias decays over the campaign.",
        place="input",
        coefficients=(millionths("run_in", "A", "µg"),),
        columns=lambda r, v, m: (np.exp(-r["elapsed_h"] / v["run_in_tau_h"])[:, None], m),
        needs=frozenset(["elapsed_h"]),
        parameters=(
            Parameter(
                name="run_in_tau_h",
                symbol="τ",
                unit="h",
                lo=0.2,
                hi=200.0,
                start=5.0,
                family="run_in",
                label="tau",
            ),
        ),
        predictive=False,
    )


def warm_up() -> Term:
    """Return a bias change that decays after each start of a run (power-on)."""
    return Term(
        name="warm_up",
        sentence="A change of bias decays after each power-on while the accelerometer warms up.",
        place="input",
        coefficients=(millionths("warm_up", "W", "µg"),),
        columns=lambda r, v, m: (np.exp(-r.time_s / v["warm_up_tau_s"])[:, None], m),
        parameters=(
            Parameter(
                name="warm_up_tau_s",
                symbol="τw",
                unit="s",
                lo=30.0,
                hi=14400.0,
                start=1200,
                family="warm_up",
                label="tau",
            ),
        ),
    )


def turn_on_name(number: int) -> str:
    """Return the name of the offset of run `number` (1 for the second run)."""
    return f"turn_on_offset_{number}"


def turn_on_offset(number: int) -> Term:
    """Return the offset of run `number` (1 for the second run) from the first."""
    return one_column(
        turn_on_name(number),
        symbol=f"u{number}",
        unit="µg",
        sentence="The bias takes a new value at each power-on.",
        column=lambda r: (r.run == number).astype(float),
        family="turn_on_offset",
        min_share=EVENT_SHARE,
        predictive=False,
    )


def bias_step() -> Term:
    """Return a step of the bias at one time."""
    return Term(
        name="bias_step",
        sentence="The bias stepped once and kept the new value.",
        place="input",
        coefficients=(millionths("bias_step", "J", "µg"),),
        columns=lambda r, v, m: (
            (r["elapsed_h"] >= v["bias_step_at_h"]).astype(float)[:, None],
            m,
        ),
        needs=frozenset(["elapsed_h"]),
        parameters=(
            Parameter(
                name="bias_step_at_h",
                symbol="t",
                unit="h",
                lo=0.0,
                hi=1e4,
                start=1.0,
                family="bias_step",
                label="at",
            ),
        ),
        predictive=False,
    )


def bias_drift() -> Term:
    """Return a bias that changes linearly over the campaign."""
    return one_column(
        "bias_drift",
        symbol="D",
        unit="µg/h",
        sentence="The bias changes linearly with time over the campaign.",
        column=lambda r: r["elapsed_h"],
        needs=("elapsed_h",),
        prior_sigma=1e-3,  # 1 mg/h: wider than any accelerometer
        min_share=EVENT_SHARE,
        predictive=False,
    )


DAY_H = 24.0
_DAILY: tuple[tuple[str, Callable[[FloatArray], FloatArray]], ...] = (
    ("sin", np.sin),
    ("cos", np.cos),
)


def daily(wave: str) -> Term:
    """Return the sine or the cosine of a bias with the period of a day."""
    function = dict(_DAILY)[wave]
    return one_column(
        f"daily_{wave}",
        symbol=f"d{wave}",
        unit="µg",
        sentence="The bias has the period of a day, as the room's temperature or mains have.",
        column=lambda r: function(2.0 * np.pi * r["elapsed_h"] / DAY_H),
        needs=("elapsed_h",),
        family="daily_period",
        label=wave,
        min_share=EVENT_SHARE,
        predictive=False,
    )


def _daily(at: Context) -> Sequence[Form]:
    """Return the form of a daily period; half a day is a drift."""
    terms = tuple(f"daily_{wave}" for wave, _ in _DAILY)
    return [Form(terms=terms)] if at.hours > 0.75 * DAY_H and not set(terms) & at.term_names else []


def _relaxing(
    name: str, parameter: str, range_of: Callable[[Context], tuple[float, float]]
) -> Callable[[Context], Sequence[Form]]:
    """Return the form of a decaying bias, with a time constant in the range that the runs allow."""

    def forms(at: Context) -> Sequence[Form]:
        if name in at.term_names:
            return []
        return [Form(terms=(name,), parameters=(parameter,), grid=log_grid(*range_of(at), 8))]

    return forms


def _run_in_h(at: Context) -> tuple[float, float]:
    return max(0.3, at.hours / 40.0), max(1.0, at.hours * 2.0)


def _warm_up_s(at: Context) -> tuple[float, float]:
    return max(90.0, at.run_s / 150.0), max(180.0, min(at.run_s / 2.0, 14400.0))


def _turn_on(at: Context) -> Sequence[Form]:
    names = (turn_on_name(k) for k in range(1, at.runs))
    missing = tuple(name for name in names if name not in at.term_names)
    return [Form(terms=missing)] if missing else []


def _step(at: Context) -> Sequence[Form]:
    if "bias_step" in at.term_names or not at.step_times_h:
        return []
    grid = tuple((t,) for t in at.step_times_h)
    return [Form(terms=("bias_step",), parameters=("bias_step_at_h",), grid=grid, smooth=False)]


TERMS: dict[str, Callable[[], Effect]] = {
    "run_in": run_in,
    "warm_up": warm_up,
    **{turn_on_name(k): (lambda k=k: turn_on_offset(k)) for k in range(1, MAX_RUNS)},
    "bias_step": bias_step,
    "bias_drift": bias_drift,
    **{f"daily_{wave}": (lambda wave=wave: daily(wave)) for wave, _ in _DAILY},
}
EFFECTS = (
    ThermalEffect(
        name="run_in",
        sentence="Stress from assembly relaxes: the change of bias decays over the campaign, "
        "{size} at its start.",
        forms=_relaxing("run_in", "run_in_tau_h", _run_in_h),
        experiment="two more runs of the same kind after a rest of a day",
        event=True,
        example=Example(term="run_in", values={"run_in": 80 / MICRO, "run_in_tau_h": 5.0}),
    ),
    ThermalEffect(
        name="warm_up",
        sentence="A change of bias decays after each power-on, {size} at first.",
        forms=_relaxing("warm_up", "warm_up_tau_s", _warm_up_s),
        # no example: the station powers its accelerometers before the chamber goes to where a run
        # begins, and by then it is over
        experiment="a power-on into a long hold at one temperature",
    ),
    ThermalEffect(
        name="turn_on_offset",
        sentence="The bias takes a new value at each power-on: {size}.",
        forms=_turn_on,
        experiment="several short runs with the power switched between them",
        event=True,
        cause="run",
        # Navigation grade: a few to 20 µg. Twice that, within a year's repeatability all the same:
        # four power-ons are three differences, and at 20 µg one draw in six is too small to be
        # named.
        example=Example(turn_on_ug=40.0),
    ),
    ThermalEffect(
        name="bias_step",
        sentence="The bias stepped once and kept the new value: {size}.",
        forms=_step,
        experiment="the same run again: a permanent step is present in all of it",
        event=True,
        cause="run",
        # hours of the station's clock: within the third run of the demonstration, as a step in a
        # rest is a turn-on offset
        example=Example(term="bias_step", values={"bias_step": 60 / MICRO, "bias_step_at_h": 14.0}),
    ),
    ThermalEffect(
        name="bias_drift",
        sentence="The bias changes linearly with time, {size}.",
        forms=plain_form("bias_drift"),
        experiment="a long hold at one temperature",
        event=True,
        cause="run",
        # assumed, as after transport: no data sheet allows it for a week, and 2 µg/h over a night
        # are what a random walk may do as well
        example=Example(term="bias_drift", values={"bias_drift": 5 / MICRO}),
    ),
    ThermalEffect(
        name="daily_period",
        sentence="The bias has the period of a day, {size}.",
        forms=_daily,
        experiment="a hold at one temperature over two days, with the room's temperature recorded",
        event=True,
        cause="run",
    ),
)
