"""The library of effects that may be missing from an accelerometer's model over temperature.

An effect is a named physical cause; its terms come from the library of terms. One effect may have
more than one form: the first is tried with the others, a richer one when the first has won.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from errormodel.model import ErrorModel
from thermo.library.terms import MAX_ORDER

Grid = tuple[tuple[float, ...], ...]
Cause = Literal["accelerometer", "head", "chamber", "digitiser", "run"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """One form of an effect: its terms, and where their nonlinear parameters are tried first.

    `parameters` are the names of the nonlinear parameters in the order of the grid's points.
    `smooth` is False when the output does not change smoothly with them (the instant of a step).
    """

    terms: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    grid: Grid = ((),)
    smooth: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalEffect:
    """A named effect.

    Attributes
    ----------
    name : str
        As in the verdict.
    sentence : str
        What it physically is; the size found is put where `{size}` stands.
    forms : callable
        Given the model and the runs' hours, the forms that may be added, the plain one first; an
        empty sequence when the model holds the effect already.
    experiment : str
        What isolates it, in words.
    event : bool
        It belongs to one run or one moment: a new run will not repeat it.
    cause : str
        Who owns it. What is the head's, the chamber's or the digitiser's is alike in all
        accelerometers that shared it; what belongs to a run may come to several at one moment.
    """

    name: str
    sentence: str
    forms: Callable[["Context"], Sequence[Form]]
    experiment: str
    event: bool = False
    cause: Cause = "accelerometer"


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """What the forms of an effect depend on."""

    model: ErrorModel
    runs: int
    run_s: float
    hours: float
    step_times_h: tuple[float, ...] = ()
    term_names: frozenset[str] = field(default=frozenset())


def context_of(
    model: ErrorModel, runs: int, run_s: float, hours: float, steps: Sequence[float]
) -> Context:
    """Return the context of a model on some runs."""
    return Context(
        model=model,
        runs=runs,
        run_s=run_s,
        hours=hours,
        step_times_h=tuple(steps),
        term_names=frozenset(t.name for t in model.terms),
    )


def _log_grid(lo: float, hi: float, count: int) -> Grid:
    return tuple((float(v),) for v in np.geomspace(lo, hi, count))


def _plain(*terms: str) -> Callable[[Context], Sequence[Form]]:
    """Return the form of terms without nonlinear parameters, those that the model lacks."""

    def forms(at: Context) -> Sequence[Form]:
        missing = tuple(t for t in terms if t not in at.term_names)
        return [Form(terms=missing)] if missing else []

    return forms


def _next_orders(family: str) -> Callable[[Context], Sequence[Form]]:
    def forms(at: Context) -> Sequence[Form]:
        present = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in at.term_names]
        first = max(present, default=0) + 1
        missing = tuple(f"{family}_t{k}" for k in range(first, MAX_ORDER + 1))
        return [Form(terms=missing)] if missing else []

    return forms


def _loop(name: str) -> Callable[[Context], Sequence[Form]]:
    def forms(at: Context) -> Sequence[Form]:
        if name in at.term_names:
            return []
        width = (f"{name}_width",)
        plain = (name, f"{name}_start")
        return [
            Form(terms=plain, parameters=width, grid=_log_grid(1.5, 60.0, 7)),
            Form(terms=(*plain, f"{name}_plays"), parameters=width, grid=_log_grid(2.0, 50.0, 4)),
        ]

    return forms


def _lag(at: Context) -> Sequence[Form]:
    if {"thermal_lag", "thermal_lag_two_poles"} & at.term_names:
        return []
    longest = float(np.clip(at.run_s / 4.0, 60.0, 3600.0))
    pairs = tuple(
        (float(t), float(t) * share)
        for t in np.geomspace(4.0, longest, 9)
        for share in (0.1, 0.4, 1.0)
    )
    return [
        Form(
            terms=("thermal_lag",),
            parameters=("thermal_lag",),
            grid=_log_grid(0.1, longest, 26),
        ),
        Form(
            terms=("thermal_lag_two_poles",),
            parameters=("thermal_lag", "thermal_lag_second"),
            grid=pairs,
        ),
    ]


def _rate_bias(at: Context) -> Sequence[Form]:
    plain = ("temperature_rate_bias",)
    if at.term_names & {"temperature_rate_bias"}:
        return []
    return [Form(terms=plain), Form(terms=(*plain, "temperature_rate_bias_slope"))]


def _relaxing(
    name: str, parameter: str, range_of: Callable[[Context], tuple[float, float]]
) -> Callable[[Context], Sequence[Form]]:
    """Return the form of a bias that dies away, its time constant in a range the runs allow."""

    def forms(at: Context) -> Sequence[Form]:
        if name in at.term_names:
            return []
        return [Form(terms=(name,), parameters=(parameter,), grid=_log_grid(*range_of(at), 8))]

    return forms


def _run_in_h(at: Context) -> tuple[float, float]:
    return max(0.3, at.hours / 40.0), max(1.0, at.hours * 2.0)


def _warm_up_s(at: Context) -> tuple[float, float]:
    return max(90.0, at.run_s / 150.0), max(180.0, min(at.run_s / 2.0, 14400.0))


def _turn_on(at: Context) -> Sequence[Form]:
    missing = tuple(
        f"turn_on_offset_{k}"
        for k in range(1, at.runs)
        if f"turn_on_offset_{k}" not in at.term_names
    )
    return [Form(terms=missing)] if missing else []


def _step(at: Context) -> Sequence[Form]:
    if "bias_step" in at.term_names or not at.step_times_h:
        return []
    grid = tuple((t,) for t in at.step_times_h)
    return [Form(terms=("bias_step",), parameters=("bias_step_at_h",), grid=grid, smooth=False)]


def _harmonic(at: Context) -> Sequence[Form]:
    names = ("indexer_harmonic", "indexer_harmonic_3", "indexer_harmonic_4")
    if any(n in at.term_names for n in names):
        return []
    return [Form(terms=("indexer_harmonic",)), Form(terms=names)]


EFFECTS: tuple[ThermalEffect, ...] = (
    ThermalEffect(
        name="thermal_lag",
        sentence="The inside of the accelerometer follows its thermistor with a time constant of "
        "{size}: its temperature is not the one recorded while that changes.",
        forms=_lag,
        experiment="a second ramp rate, and holds of three time constants after each ramp: a lag "
        "dies away in them, and grows with the slope of the scale factor and bias there",
    ),
    ThermalEffect(
        name="temperature_rate_bias",
        sentence="The bias follows the rate of temperature, {size}.",
        forms=_rate_bias,
        experiment="two ramp rates over the same temperatures: it is proportional to the rate and "
        "gone in a hold at once",
    ),
    ThermalEffect(
        name="temperature_rate_scale",
        sentence="The scale factor follows the rate of temperature, {size}.",
        forms=_plain("temperature_rate_scale"),
        experiment="two ramp rates, tumbled between +1 g and −1 g",
    ),
    ThermalEffect(
        name="bias_hysteresis",
        sentence="The bias differs between heating and cooling at the same temperature, however "
        "slow the change; half the open loop is {size}.",
        forms=_loop("bias_hysteresis"),
        experiment="an inner loop that turns back half way, and a slower ramp: a loop does not "
        "depend on the rate and survives a hold",
    ),
    ThermalEffect(
        name="scale_hysteresis",
        sentence="The scale factor differs between heating and cooling at the same temperature; "
        "half the open loop is {size}.",
        forms=_loop("scale_hysteresis"),
        experiment="an inner loop that turns back half way, tumbled between +1 g and −1 g",
    ),
    ThermalEffect(
        name="bias_temperature_order",
        sentence="The bias bends more with temperature than the model's order allows: {size}.",
        forms=_next_orders("k0"),
        experiment="a wider range of temperature, with holds along it",
    ),
    ThermalEffect(
        name="scale_temperature_order",
        sentence="The scale factor bends more with temperature than the model's order allows: "
        "{size}.",
        forms=_next_orders("k1"),
        experiment="a wider range of temperature, tumbled between +1 g and −1 g",
    ),
    ThermalEffect(
        name="second_order",
        sentence="The output has a part proportional to the input squared, {size}.",
        forms=_plain("k2"),
        experiment="positions every 45°: with 0° and ±90° alone a squared term and a readout "
        "whose gain depends on the sign look the same",
    ),
    ThermalEffect(
        name="third_order",
        sentence="The output has a part proportional to the input cubed, {size}.",
        forms=_plain("k3"),
        experiment="positions every 45°: at 0°, ±90° and 180° it is the same as scale factor",
    ),
    ThermalEffect(
        name="cross_axis",
        sentence="Force across the input axis gives an output, {size}; a head whose zero is off "
        "by the same angle does the same.",
        forms=_plain("delta_o", "delta_p", "k_ip", "k_io"),
        experiment="positions every 45°, and the same with the accelerometer turned by 180° about "
        "its input axis, which reverses it but not the head's error",
    ),
    ThermalEffect(
        name="run_in",
        sentence="Stress from assembly relaxes: the bias dies away over the campaign, {size} at "
        "its start.",
        forms=_relaxing("run_in", "run_in_tau_h", _run_in_h),
        experiment="two more runs of the same kind after a rest of a day",
        event=True,
    ),
    ThermalEffect(
        name="warm_up",
        sentence="The bias dies away after each power-on, {size} at first.",
        forms=_relaxing("warm_up", "warm_up_tau_s", _warm_up_s),
        experiment="a power-on into a long hold at one temperature",
    ),
    ThermalEffect(
        name="turn_on_offset",
        sentence="The bias takes a new value at each power-on: {size}.",
        forms=_turn_on,
        experiment="several short runs with the power switched between them",
        event=True,
        cause="run",
    ),
    ThermalEffect(
        name="bias_step",
        sentence="The bias stepped once and stayed: {size}.",
        forms=_step,
        experiment="the same run again: a step that has stayed is in all of it",
        event=True,
        cause="run",
    ),
    ThermalEffect(
        name="bias_drift",
        sentence="The bias changes uniformly with time, {size}.",
        forms=_plain("bias_drift"),
        experiment="a long hold at one temperature",
        event=True,
        cause="run",
    ),
    ThermalEffect(
        name="indexer_harmonic",
        sentence="The head's angle errs periodically over a turn, {size}.",
        forms=_harmonic,
        experiment="positions every 15°, and the same with the accelerometer mounted turned by "
        "90° on the head",
        cause="head",
    ),
    ThermalEffect(
        name="output_nonlinearity",
        sentence="The readout's gain depends on the sign or the size of its output: {size}.",
        forms=_plain("output_nonlinearity", "output_nonlinearity_odd"),
        experiment="positions every 15°, and the same on another channel of the readout",
        cause="digitiser",
    ),
)


def effects_by_name(effects: Sequence[ThermalEffect] = EFFECTS) -> Mapping[str, ThermalEffect]:
    """Return the effects by their names."""
    return {e.name: e for e in effects}
