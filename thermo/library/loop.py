"""Thermal loops: the output differs between heating and cooling, however slow the change."""

from collections.abc import Callable, Sequence

import numba
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
)

# Play radii of a loop of many hysterons, °C: from almost no loop to half the widest chamber range.
PLAY_RADII_C = (1.5, 4.0, 9.0, 18.0, 36.0)
ORDINARY = 1e-3  # 1 mg or 1000 ppm: wider than any accelerometer


@numba.njit(cache=True)
def _loop_state(x: FloatArray, width: float, last_x: float, state: float) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        step = x[k] - last_x
        side = 1.0 if step > 0 else (-1.0 if step < 0 else 0.0)
        if side != 0.0:
            state = side + (state - side) * np.exp(-abs(step) / width)
        last_x = x[k]
        out[k] = state
    return out


def loop(name: str, what: str, symbol: str, unit: str, place: Place) -> Term:
    """Return a rate-independent loop: a state between −1 and 1 that follows the direction.

    dz/dx = (sgn(dx) − z)/w (Dahl's form of the Bouc-Wen family): the solution is exact on any
    monotone piece, so it does not depend on the sampling interval.
    """
    width = f"{name}_width"

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        x = record["x_slow_c"][readings]
        last_x, state = memory or (float(x[0]), 0.0)
        z = _loop_state(x, values[width], last_x, state)
        return z, (float(x[-1]), float(z[-1]))

    return Term(
        name=name,
        sentence=f"The {what} differs between heating and cooling at the same temperature, "
        "however slow the change.",
        place=place,
        coefficients=(millionths(name, symbol, unit, prior_sigma=ORDINARY, min_share=1e-6),),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
        parameters=(
            Parameter(
                name=width,
                symbol="w",
                unit="°C",
                lo=1.0,
                hi=60.0,
                start=10.0,
                family=name,
                label="width",
            ),
        ),
    )


@numba.njit(cache=True)
def _play(x: FloatArray, radius: float, state: float) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        state = min(max(state, x[k] - radius), x[k] + radius)
        out[k] = state - x[k]
    return out


@numba.njit(cache=True)
def _travelled(x: FloatArray, last_x: float, path: float) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        path += abs(x[k] - last_x)
        last_x = x[k]
        out[k] = path
    return out


def loop_start(name: str, place: Place, unit: str) -> Term:
    """Return the effect of the loop state before the run; it decays with the width."""
    own, width = f"{name}_start", f"{name}_width"

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        x = record["x_slow_c"][readings]
        last_x, before = memory or (float(x[0]), 0.0)
        path = _travelled(x, last_x, before)
        return np.exp(-path / values[width]), (float(x[-1]), float(path[-1]))

    return Term(
        name=own,
        sentence="The run begins with the state of the loop from the earlier history.",
        place=place,
        coefficients=(
            millionths(own, "h0", unit, family=name, label="start", prior_sigma=ORDINARY),
        ),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
    )


def loop_plays(name: str, place: Place, unit: str) -> Term:
    """Return a loop of many hysterons: the Prandtl-Ishlinskii sum of plays of fixed radii."""
    own = f"{name}_plays"

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        del values
        x = record["x_slow_c"][readings]
        before = memory or tuple(float(x[0]) for _ in PLAY_RADII_C)
        plays = [_play(x, r, s) for r, s in zip(PLAY_RADII_C, before, strict=True)]
        after = tuple(float(p[-1] + x[-1]) for p in plays)
        return np.column_stack(plays), after

    return Term(
        name=own,
        sentence="A loop over temperature, the sum of many hysterons.",
        place=place,
        coefficients=tuple(
            millionths(
                f"{own}_{k}",
                f"p{k}",
                f"{unit}/°C",
                family=name,
                label=f"plays {k}",
                prior_sigma=ORDINARY / radius,
            )
            for k, radius in enumerate(PLAY_RADII_C, 1)
        ),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
    )


def _forms(name: str) -> Callable[[Context], Sequence[Form]]:
    def forms(at: Context) -> Sequence[Form]:
        if name in at.term_names:
            return []
        width = (f"{name}_width",)
        plain = (name, f"{name}_start")
        return [
            Form(terms=plain, parameters=width, grid=log_grid(1.5, 60.0, 7)),
            Form(terms=(*plain, f"{name}_plays"), parameters=width, grid=log_grid(2.0, 50.0, 4)),
        ]

    return forms


def _example(name: str) -> Example:
    # tens of µg over −40…+70 °C: assumed; papers describe the loop but not its size
    return Example(term=name, values={name: 20 / MICRO, f"{name}_width": 12.0})


# Loops of bias and scale factor; each coefficient is half the height of the open loop.
TERMS: dict[str, Callable[[], Effect]] = {
    "bias_hysteresis": lambda: loop("bias_hysteresis", "bias", "h", "µg", "input"),
    "scale_hysteresis": lambda: loop("scale_hysteresis", "scale factor", "hs", "ppm", "scale"),
    "bias_hysteresis_start": lambda: loop_start("bias_hysteresis", "input", "µg"),
    "scale_hysteresis_start": lambda: loop_start("scale_hysteresis", "scale", "ppm"),
    "bias_hysteresis_plays": lambda: loop_plays("bias_hysteresis", "input", "µg"),
    "scale_hysteresis_plays": lambda: loop_plays("scale_hysteresis", "scale", "ppm"),
}
EFFECTS = (
    ThermalEffect(
        name="bias_hysteresis",
        sentence="The bias differs between heating and cooling at the same temperature, however "
        "slow the change; half the open loop is {size}.",
        forms=_forms("bias_hysteresis"),
        experiment="an inner loop that reverses half way, and a slower ramp: a loop does not "
        "depend on the rate and persists in a hold",
        example=_example("bias_hysteresis"),
    ),
    ThermalEffect(
        name="scale_hysteresis",
        sentence="The scale factor differs between heating and cooling at the same temperature; "
        "half the open loop is {size}.",
        forms=_forms("scale_hysteresis"),
        experiment="an inner loop that reverses half way, tumbled between +1 g and −1 g",
        example=_example("scale_hysteresis"),
    ),
)
