"""Accelerometer terms over temperature (IEEE 1293 form), each with what it physically is.

Signals: `a_i_g`, `a_p_g`, `a_o_g` (specific force along IA, PA, OA in local g, OA = IA × PA),
`x_c` (temperature less the reference temperature, °C), `x_slow_c` (the same without the
thermistor's noise), `rate_c_per_min`, `elapsed_h` (since the first run began). The model's unit is
g at the input.
"""

from collections.abc import Callable

import numba
import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import (
    Coefficient,
    Effect,
    InputChange,
    Memory,
    Parameter,
    Place,
    Term,
    Values,
    by_run,
    memoryless,
)
from thermo.library.passing import EVENTS, second_lag

MICRO = 1e6
# Angles are known to some 1e-4 rad at best from an unknown head: what differs by less than ten
# times that between positions does not tell a position-dependent coefficient from another.
POSITION_SHARE = 1e-3
MAX_ORDER = 4


def _multiplied(values: FloatArray, order: int) -> FloatArray:
    """Return a whole power; multiplied out it takes a tenth of numpy's time."""
    power = values
    for _ in range(order - 1):
        power = power * values
    return power


def _one(
    name: str,
    symbol: str,
    unit: str,
    sentence: str,
    place: Place,
    column: Callable[[Record], FloatArray],
    needs: tuple[str, ...] = (),
    min_share: float = 1e-6,
) -> Term:
    """Return a term of one coefficient, reported in millionths, without memory."""
    coefficient = Coefficient(
        name=name, symbol=symbol, unit=unit, per_unit=MICRO, min_share=min_share
    )
    return Term(
        name=name,
        sentence=sentence,
        place=place,
        coefficients=(coefficient,),
        columns=memoryless(column),
        needs=frozenset(needs),
    )


def scale_factor() -> Term:
    """Return K1 at the reference temperature, as a ratio to the nominal scale factor."""
    return Term(
        name="k1",
        sentence="The scale factor at the reference temperature.",
        place="gain",
        coefficients=(
            Coefficient(name="k1", symbol="K1", unit="nominal", min_share=POSITION_SHARE),
        ),
        columns=memoryless(lambda r: np.ones(len(r))),
    )


def bias() -> Term:
    """Return K0 at the reference temperature."""
    return _one(
        "k0",
        "K0",
        "µg",
        "The output with no input, at the reference temperature.",
        "input",
        lambda r: np.ones(len(r)),
    )


def _power(order: int) -> Callable[[Record], FloatArray]:
    return lambda r: _multiplied(r["x_c"], order)


def bias_order(order: int) -> Term:
    """Return the bias's coefficient of x to the power `order`."""
    return _one(
        f"k0_t{order}",
        f"b{order}",
        f"µg/°C{_superscript(order)}",
        f"The bias changes with temperature to the power {order}.",
        "input",
        _power(order),
        ("x_c",),
    )


def scale_order(order: int) -> Term:
    """Return the scale factor's relative coefficient of x to the power `order`."""
    return _one(
        f"k1_t{order}",
        f"s{order}",
        f"ppm/°C{_superscript(order)}",
        f"The scale factor changes with temperature to the power {order}.",
        "scale",
        _power(order),
        ("x_c",),
    )


def _superscript(order: int) -> str:
    return "" if order == 1 else "²³⁴"[order - 2]


_STATIC: tuple[Term, ...] = (
    _one(
        "k2",
        "K2",
        "µg/g²",
        "The output has a part proportional to the input squared.",
        "input",
        lambda r: r["a_i_g"] ** 2,
        ("a_i_g",),
        POSITION_SHARE,
    ),
    _one(
        "k3",
        "K3",
        "µg/g³",
        "The output has a part proportional to the input cubed.",
        "input",
        lambda r: _multiplied(r["a_i_g"], 3),
        ("a_i_g",),
        POSITION_SHARE,
    ),
    _one(
        "delta_o",
        "δo",
        "µrad",
        "The input axis is turned about the output axis, towards the pendulous axis.",
        "input",
        lambda r: r["a_p_g"],
        ("a_p_g",),
        POSITION_SHARE,
    ),
    _one(
        "delta_p",
        "δp",
        "µrad",
        "The input axis is turned about the pendulous axis, away from the output axis.",
        "input",
        lambda r: -r["a_o_g"],
        ("a_o_g",),
        POSITION_SHARE,
    ),
    _one(
        "k_ip",
        "Kip",
        "µg/g²",
        "Force along the input and pendulous axes together gives an output.",
        "input",
        lambda r: r["a_i_g"] * r["a_p_g"],
        ("a_i_g", "a_p_g"),
        POSITION_SHARE,
    ),
    _one(
        "k_io",
        "Kio",
        "µg/g²",
        "Force along the input and output axes together gives an output.",
        "input",
        lambda r: r["a_i_g"] * r["a_o_g"],
        ("a_i_g", "a_o_g"),
        POSITION_SHARE,
    ),
)
STATIC_NAMES = tuple(t.name for t in _STATIC)


def temperature_rate_bias() -> Term:
    """Return a bias proportional to the rate of temperature."""
    return _one(
        "temperature_rate_bias",
        "br",
        "µg/(°C/min)",
        "Heat flowing through the accelerometer gives a bias proportional to dT/dt.",
        "input",
        lambda r: r["rate_c_per_min"],
        ("rate_c_per_min",),
    )


def temperature_rate_bias_slope() -> Term:
    """Return the change with temperature of a bias proportional to the rate of temperature."""
    return _one(
        "temperature_rate_bias_slope",
        "br1",
        "µg/(°C/min)/°C",
        "Heat flowing through the accelerometer gives a bias that changes with temperature, as "
        "conduction and expansion do.",
        "input",
        lambda r: r["rate_c_per_min"] * r["x_c"],
        ("rate_c_per_min", "x_c"),
    )


def temperature_rate_scale() -> Term:
    """Return a scale-factor change proportional to the rate of temperature."""
    return _one(
        "temperature_rate_scale",
        "sr",
        "ppm/(°C/min)",
        "Heat flowing through the torquer's magnet changes the scale factor with dT/dt.",
        "scale",
        lambda r: r["rate_c_per_min"],
        ("rate_c_per_min",),
    )


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


def _hysteresis(name: str, what: str, symbol: str, unit: str, place: Place) -> Term:
    """Return a rate-independent loop: a state between −1 and 1 that follows the direction.

    dz/dx = (sgn(dx) − z)/w (Dahl's form of the Bouc-Wen family): exact on any monotone piece, so
    that the sampling interval does not matter.
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
        coefficients=(Coefficient(name=name, symbol=symbol, unit=unit, per_unit=MICRO),),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
        parameters=(Parameter(name=width, symbol="w", unit="°C", lo=1.0, hi=60.0, start=10.0),),
    )


def bias_hysteresis() -> Term:
    """Return a thermal loop of the bias; its coefficient is half the open loop's width."""
    return _hysteresis("bias_hysteresis", "bias", "h", "µg", "input")


def scale_hysteresis() -> Term:
    """Return a thermal loop of the scale factor."""
    return _hysteresis("scale_hysteresis", "scale factor", "hs", "ppm", "scale")


@numba.njit(cache=True)
def _follow(
    time_s: FloatArray, x: FloatArray, tau_s: float, last_t: float, last_x: float, state: float
) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        step = time_s[k] - last_t
        if step > 0:
            slope = (x[k] - last_x) / step
            keep = np.exp(-step / tau_s)
            # exact answer of a first-order lag to an input that is straight between readings
            state = x[k] - slope * tau_s + (state - last_x + slope * tau_s) * keep
        last_t, last_x = time_s[k], x[k]
        out[k] = state
    return out


def thermal_lag() -> InputChange:
    """Return the lag of the accelerometer's inside behind its thermistor."""

    def change(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
        tau_s = values["thermal_lag"]
        changed: dict[str, FloatArray] = {}
        after: dict[str, Memory] = {}
        for signal in ("x_c", "x_slow_c", "rate_c_per_min"):
            if signal not in record.signals:
                continue
            pieces: list[FloatArray] = []
            for index, readings in enumerate(record.run_slices):
                time_s, x = record.time_s[readings], record[signal][readings]
                before = memory[signal] if memory and index == 0 else None
                start = before or (float(time_s[0]), float(x[0]), float(x[0]))
                inner = _follow(time_s, x, tau_s, *start)
                after[signal] = (float(time_s[-1]), float(x[-1]), float(inner[-1]))
                pieces.append(inner)
            changed[signal] = np.concatenate(pieces) if pieces else record[signal]
        return record.with_signals(**changed), after

    return InputChange(
        name="thermal_lag",
        sentence="The inside of the accelerometer follows its thermistor with a time constant.",
        change=change,
        parameters=(
            Parameter(name="thermal_lag", symbol="τ", unit="s", lo=0.1, hi=3600.0, start=60.0),
        ),
        needs=frozenset(["x_c"]),
    )


LIBRARY: dict[str, Callable[[], Effect]] = {
    "k1": scale_factor,
    "k0": bias,
    **{f"k0_t{k}": (lambda k=k: bias_order(k)) for k in range(1, MAX_ORDER + 1)},
    **{f"k1_t{k}": (lambda k=k: scale_order(k)) for k in range(1, MAX_ORDER + 1)},
    **{t.name: (lambda t=t: t) for t in _STATIC},
    "temperature_rate_bias": temperature_rate_bias,
    "temperature_rate_bias_slope": temperature_rate_bias_slope,
    "temperature_rate_scale": temperature_rate_scale,
    "bias_hysteresis": bias_hysteresis,
    "scale_hysteresis": scale_hysteresis,
    "thermal_lag": thermal_lag,
    "thermal_lag_two_poles": lambda: second_lag(_follow),
    **EVENTS,
}


def term(name: str) -> Effect:
    """Return a term of the library by its name.

    Raises
    ------
    KeyError
        If there is none; the message lists the names.
    """
    if name not in LIBRARY:
        raise KeyError(f"no term {name!r}; known: {', '.join(LIBRARY)}")
    return LIBRARY[name]()
