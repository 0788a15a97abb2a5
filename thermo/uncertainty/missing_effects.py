"""Effects that a model of an accelerometer may lack, each as its column in the output."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel
from thermo.library import MAX_ORDER, STATIC_NAMES, term
from thermo.recording.channel import Channel
from thermo.recording.runs import FORCES
from thermo.uncertainty.linearised import LinearisedFit

HIGHEST = 8
LOOP_WIDTH_C = 10.0
ANOTHER_G = 1e-3  # 0.06°: forces nearer than that are one position
NOTHING = 1e-6  # of a unit effect: cos 90° and the like


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Missing:
    """An effect that is not in a model.

    Attributes
    ----------
    name : str
    follows : str
        What a residual with it follows; may hold `{amount}`.
    column : ndarray, shape (n,)
        In the output, of a unit of it.
    words : str
        What it is; empty where other sentences tell of it when the readings cannot show it: of
        orders, terms of the equation, drift and a lag.
    """

    name: str
    follows: str
    column: FloatArray
    words: str = ""


def missing_effects(line: LinearisedFit, channel: Channel) -> Iterator[Missing]:
    """Yield what a model may lack, one at a time: a recording may be long."""
    if _moves(line):
        yield from _orders(line, channel)
        yield from _rates(line, channel)
    hours = line.record.time_s / 3600.0
    yield Missing(
        name="bias_drift", follows="the time within a run ({amount:.1e} g/h)", column=hours
    )
    if channel.has_input:
        for name in STATIC_NAMES:
            if name not in line.fit.names:
                follows = f"the input as {name} does"
                yield from _there(Missing(name=name, follows=follows, column=_static(line, name)))
    yield from effects_that_hide(line, channel)


def effects_that_hide(line: LinearisedFit, channel: Channel) -> Iterator[Missing]:
    """Yield those that many tests cannot show, with `words`."""
    moves = _moves(line)
    loop = _loop(line) if moves else np.zeros(0)
    if moves:
        yield Missing(
            name="bias_hysteresis",
            follows="the direction of the temperature",
            column=loop,
            words=f"a loop of the bias, {LOOP_WIDTH_C:.0f} °C wide",
        )
    if not channel.has_input:
        return
    a_i = line.record["a_i_g"]
    yield from _there(
        Missing(
            name="gain_asymmetry",
            follows="the size of the input, + or −",
            column=np.abs(a_i),
            words="gains that differ between + and −",
        )
    )
    yield from _there(
        Missing(
            name="settling",
            follows="the first reading after each move",
            column=_first_after_moves(line),
            words="settling after each move",
        )
    )
    if not moves:
        return
    yield from _there(
        Missing(
            name="scale_hysteresis",
            follows="the direction of the temperature times the input",
            column=channel.direction * a_i,
            words="a loop of the scale factor over temperature",
        )
    )
    yield from _there(
        Missing(
            name="wide_scale_hysteresis",
            follows="a wide loop over the temperature times the input",
            column=loop * a_i,
            words=f"a loop of the scale factor, {LOOP_WIDTH_C:.0f} °C wide",
        )
    )
    middle = float(np.mean(line.record["x_c"]))
    words = {"k2": "k2", "delta_o": "misalignment delta_o", "delta_p": "misalignment delta_p"}
    for name, what in words.items():
        yield from _there(
            Missing(
                name=f"{name}_t1",
                follows=f"the temperature times the input as {name} does",
                column=(line.record["x_c"] - middle) * _static(line, name),
                words=f"a change of {what} with temperature",
            )
        )


def _moves(line: LinearisedFit) -> bool:
    return float(np.ptp(line.record["x_c"])) > 0.0


def _rates(line: LinearisedFit, channel: Channel) -> Iterator[Missing]:
    record = line.record
    rate = record["rate_c_per_min"]
    yield Missing(
        name="thermal_lag",
        follows="the rate of temperature times the slope over temperature (a lag of {amount:.3g} "
        "s)",
        column=-line.by_temperature() * rate / 60.0,
    )
    yield Missing(name="temperature_rate_bias", follows="the rate of temperature", column=rate)
    if channel.has_input:
        times = "the rate of temperature times the input"
        yield Missing(name="temperature_rate_scale", follows=times, column=rate * record["a_i_g"])


def _orders(line: LinearisedFit, channel: Channel) -> Iterator[Missing]:
    x, held = line.record["x_c"], set(line.fit.names)
    ends = [float(x.min()), float(x.max())]
    for order in range(1, HIGHEST + 1):
        shape = np.asarray(Legendre.basis(order, domain=ends)(x))
        name = "_above_4" if order > MAX_ORDER else f"_t{order}"
        power = f"the temperature to the power {order}"
        if f"k0{name}" not in held:
            yield Missing(name=f"k0{name}", follows=power, column=shape)
        if channel.has_input and f"k1{name}" not in held:
            times = f"{power} times the input"
            yield Missing(name=f"k1{name}", follows=times, column=shape * line.record["a_i_g"])


def _static(line: LinearisedFit, name: str) -> FloatArray:
    alone = ErrorModel((term(name),))
    return alone.simulate(line.record, {name: 1.0}) - line.record["a_i_g"]


def _there(effect: Missing) -> Iterator[Missing]:
    if float(np.abs(effect.column).max()) > NOTHING:
        yield effect


def _loop(line: LinearisedFit) -> FloatArray:
    """Return a loop of unit size: over a range narrower than its width it is nearly a slope."""
    values = {"bias_hysteresis": 1.0, "bias_hysteresis_width": LOOP_WIDTH_C}
    at_rest = line.record.with_signals(a_i_g=np.zeros(len(line.record)))
    return ErrorModel((term("bias_hysteresis"),)).simulate(at_rest, values)


def _first_after_moves(line: LinearisedFit) -> FloatArray:
    """Return 1 for a reading whose position is another than that of the one before, else 0."""
    record = line.record
    moved = np.zeros(len(record))
    for name in FORCES:
        moved[1:] += np.abs(np.diff(record[name])) > ANOTHER_G
    moved[1:] *= np.diff(record.run) == 0
    return np.minimum(moved, 1.0)
