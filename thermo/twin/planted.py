"""Accelerometers of the emulated station that have one effect of the library, and no other.

The sizes are those of a quartz-flexure accelerometer that passes its data sheet all the same.
"""

import zlib
from dataclasses import replace

import numpy as np

from errormodel.errors import InputError
from errormodel.model import ErrorModel
from errormodel.terms import Term
from thermo.compensation.model_file import AccelerometerModel
from thermo.library import term, thermal_library
from thermo.library.effects import Example
from thermo.twin.accelerometer import T_REF_C, EmulatedAccelerometer, emulated_accelerometer
from thermo.twin.unknown import UNKNOWN, UnknownEffect, unknown_effect

# All that a model with bias and scale factor quadratic in temperature holds.
PLAIN_TERMS = ("k1", "k1_t1", "k1_t2", "k0", "k0_t1", "k0_t2")


def planted_effects() -> dict[str, Example]:
    """Return the examples of the library's effects by name: what an accelerometer can be given."""
    return {e.name: e.example for e in thermal_library().effects if e.example is not None}


def size_in_words(example: Example) -> str:
    """Return an example's size in the units of the report."""
    if isinstance(example, UnknownEffect):
        return example.words
    if not example.term:
        return f"offsets with a sigma of {example.turn_on_ug:g} µg from power-on to power-on"
    one = term(example.term)
    return ", ".join(
        f"{u.name} {example.values[u.name] * u.per_unit:g} {u.unit}"
        for u in (*one.coefficients, *one.parameters)
    )


def plantable(name: str | None, seed: int = 1) -> Example:
    """Return an effect's example by the effect's name; "unknown" is one that no library has.

    Parameters
    ----------
    name : str or None
    seed : int
        Draws the unknown one.

    Raises
    ------
    InputError
        If an accelerometer cannot have it; the message lists those it can.
    """
    known = planted_effects()
    if name == UNKNOWN:
        return unknown_effect(seed)
    if not name or name not in known:
        given = f"{name!r} is not one of them" if name else "none given"
        expected = f"expected one of {', '.join(known)}, or {UNKNOWN}"
        raise InputError("hidden effect", "", f"{given}; {expected}")
    return known[name]


def plain_accelerometer(
    serial: str, planted: Example | None = None, *, seed: int = 1
) -> EmulatedAccelerometer:
    """Make an accelerometer whose bias and scale factor are quadratic in temperature.

    Parameters
    ----------
    serial : str
    planted : Example, optional
        What it has besides.
    seed : int
        With the serial number it decides the coefficients.
    """
    whole = emulated_accelerometer(serial, seed=seed)
    more = planted or Example()
    own = [more.made] if isinstance(more, UnknownEffect) else []
    names = (*PLAIN_TERMS, *([more.term] if more.term and not own else []))
    return replace(
        whole,
        model=ErrorModel((*(term(n) for n in names), *own)),
        values={**{n: whole.values[n] for n in PLAIN_TERMS}, **more.values},
        turn_on_ug=more.turn_on_ug,
    )


def simulated_by(model: AccelerometerModel) -> EmulatedAccelerometer:
    """Make an accelerometer that is exactly what a model file says, without noise.

    What belonged to the fitted runs or moments alone is left out: no new run has it.

    Raises
    ------
    InputError
        If the model counts temperature from another reference than the emulator.
    """
    if model.t_ref_c != T_REF_C:
        problem = f"is {model.t_ref_c:g}, the emulator takes {T_REF_C:g}"
        raise InputError("the model file", "t_ref_c", problem)
    made, values = model.error_model(), model.values()
    passing = [t for t in made.terms if isinstance(t, Term) and not t.predictive]
    once = {c.name: 0.0 for t in passing for c in t.coefficients}
    return EmulatedAccelerometer(
        model=made,
        values={**values, **once},
        nominal_scale=model.nominal_scale,
        white_ug=0.0,
        drift_ug=0.0,
    )


def who_has_it(effect: str, serials: tuple[str, ...], seed: int) -> str:
    """Draw the accelerometer that gets the effect."""
    rng = np.random.default_rng([seed, zlib.crc32(effect.encode())])
    return serials[int(rng.integers(len(serials)))]
