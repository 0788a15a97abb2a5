"""Accelerometers of the emulated station that have one effect of the library, and no other.

The sizes are those of a quartz-flexure accelerometer that passes its data sheet all the same.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from errormodel.errors import InputError
from errormodel.model import ErrorModel
from errormodel.terms import Term
from thermo.compensation.model_file import AccelerometerModel
from thermo.library.terms import term
from thermo.twin.accelerometer import T_REF_C, EmulatedAccelerometer, emulated_accelerometer

MICRO = 1e-6
# All that a model with bias and scale factor quadratic in temperature holds.
PLAIN_TERMS = ("k1", "k1_t1", "k1_t2", "k0", "k0_t1", "k0_t2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Planted:
    """An effect put into an emulated accelerometer.

    Attributes
    ----------
    term : str
        Of the library; empty for offsets between power-ons, which are drawn.
    values : mapping of str to float
        Its coefficients and parameters, in the model's unit (g, °C, s).
    turn_on_ug : float
        Sigma of the offset that each power-on draws.
    """

    term: str = ""
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    turn_on_ug: float = 0.0

    def words(self) -> str:
        """Return the size in the units of the report."""
        if not self.term:
            return f"offsets with a sigma of {self.turn_on_ug:g} µg from power-on to power-on"
        one = term(self.term)
        return ", ".join(
            f"{u.name} {self.values[u.name] * u.per_unit:g} {u.unit}"
            for u in (*one.coefficients, *one.parameters)
        )


# The indexing head's harmonic is not among them: it belongs to the head, and every accelerometer
# would show it. Nor is the warm-up: the station powers its accelerometers before the chamber goes
# to where a run begins, and by then it is over.
PLANTED: Mapping[str, Planted] = {
    name: Planted(term=own, values=values)
    for name, own, values in (
        # the thermistor sits on the shell, the proof mass a minute behind it
        ("thermal_lag", "thermal_lag", {"thermal_lag": 60.0}),
        (
            "temperature_rate_bias",
            "temperature_rate_bias",
            {"temperature_rate_bias": 12 * MICRO},
        ),
        (
            "temperature_rate_scale",
            "temperature_rate_scale",
            {"temperature_rate_scale": 10 * MICRO},
        ),
        # tens of µg over −40…+70 °C: assumed, papers tell the loop and not its size
        (
            "bias_hysteresis",
            "bias_hysteresis",
            {"bias_hysteresis": 20 * MICRO, "bias_hysteresis_width": 12.0},
        ),
        (
            "scale_hysteresis",
            "scale_hysteresis",
            {"scale_hysteresis": 20 * MICRO, "scale_hysteresis_width": 12.0},
        ),
        # some 30 µg or ppm at the ends of the range
        ("bias_temperature_order", "k0_t3", {"k0_t3": 1e-4 * MICRO}),
        ("scale_temperature_order", "k1_t3", {"k1_t3": 1e-4 * MICRO}),
        ("second_order", "k2", {"k2": 20 * MICRO}),  # data sheets: 10 to 30 µg/g²
        ("third_order", "k3", {"k3": 20 * MICRO}),  # assumed as large
        ("cross_axis", "delta_o", {"delta_o": 100 * MICRO}),  # repeats to 100 µrad over a year
        ("run_in", "run_in", {"run_in": 80 * MICRO, "run_in_tau_h": 5.0}),
        # hours of the station's clock: within the third run of the demonstration, as a step in a
        # rest is a turn-on offset
        ("bias_step", "bias_step", {"bias_step": 60 * MICRO, "bias_step_at_h": 14.0}),
        # assumed, as after transport: no data sheet allows it for a week, and 2 µg/h over a night
        # are what a random walk may do as well
        ("bias_drift", "bias_drift", {"bias_drift": 5 * MICRO}),
        ("output_nonlinearity", "output_nonlinearity", {"output_nonlinearity": 20 * MICRO}),
    )
} | {
    # Navigation grade: a few to 20 µg. Twice that, within a year's repeatability all the same: four
    # power-ons are three differences, and at 20 µg one draw in six is too small to be named.
    "turn_on_offset": Planted(turn_on_ug=40.0)
}


def plantable(name: str | None) -> Planted:
    """Return an effect by its name in the library.

    Raises
    ------
    InputError
        If an accelerometer cannot have it; the message lists those it can.
    """
    if not name or name not in PLANTED:
        given = f"{name!r} is none of them" if name else "none given"
        raise InputError("hidden effect", "", f"{given}; expected one of {', '.join(PLANTED)}")
    return PLANTED[name]


def plain_accelerometer(
    serial: str, planted: Planted | None = None, *, seed: int = 1
) -> EmulatedAccelerometer:
    """Make an accelerometer whose bias and scale factor are quadratic in temperature.

    Parameters
    ----------
    serial : str
    planted : Planted, optional
        What it has besides.
    seed : int
        With the serial number it decides the coefficients.
    """
    whole = emulated_accelerometer(serial, seed=seed)
    more = planted or Planted()
    names = (*PLAIN_TERMS, *([more.term] if more.term else []))
    return replace(
        whole,
        model=ErrorModel(tuple(term(n) for n in names)),
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
