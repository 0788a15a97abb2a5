"""Errors of the accelerometers: constant, scale, axes, squared force, delay, temperature."""

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Term, Told
from sinscal.frames.earth import ARCMIN, STANDARD_G
from sinscal.library.groups import (
    PHASE,
    RATE,
    TEMPERATURE,
    WARM,
    ChannelId,
    Group,
    bias_by_temperature,
    constant_error,
    effect_of,
    misalignment,
    needing,
    scale,
    term_of,
)
from sinscal.recording.run import AXES

MICRO_G = 1e-6 * STANDARD_G


def _second_order(c: ChannelId) -> Term:
    name = f"accel_second_order_{c.letter}"
    sentence = "The output has a part proportional to the input squared."
    return term_of(name, sentence, [(name, f"K2{c.letter}", "1/(m/s²)", lambda r: r[c.input] ** 2)])


def _delay(c: ChannelId) -> Term:
    name = f"accel_delay_{c.letter}"

    def late(record: Record) -> FloatArray:
        # gravity is constant in local axes: in the body it changes by f × ω
        j, k = AXES[(c.axis + 1) % 3], AXES[(c.axis + 2) % 3]
        return record[f"f_{k}"] * record[f"w_{j}"] - record[f"f_{j}"] * record[f"w_{k}"]

    sentence = "The accelerometer readings are delayed relative to the gyros."
    return term_of(name, sentence, [(name, f"τ{c.letter}", "s", late)])


def _temperature_scale(c: ChannelId) -> Term:
    name = f"accel_temperature_scale_{c.letter}"

    def warmed(record: Record) -> FloatArray:
        return record["x_c"] * record[c.input]

    sentence = "The scale factor changes with temperature."
    return needing(term_of(name, sentence, [(name, f"ΓT{c.letter}", "1/°C", warmed)]), "x_c")


# Priors: those of the article for its parameters; otherwise assumed values for navigation-grade
# sensors, several times the limits of their data sheets.
BIAS = Group(
    name="accel_bias",
    kinds=("accel",),
    make=constant_error,
    prior_sigma=0.02,
    told=Told(unit="µg", size=MICRO_G),
    formula="Δf⁰",
    basic=True,
)
SCALE = Group(
    name="accel_scale",
    kinds=("accel",),
    make=scale,
    prior_sigma=1e-3,
    told=Told(unit="ppm", size=1e-6),
    formula="(I + Γ)·f",
    signs="accel_scale_a is Γaa",
    basic=True,
)
MISALIGNMENT = Group(
    name="accel_misalignment",
    kinds=("accel",),
    make=misalignment,
    prior_sigma=3.0 * ARCMIN,
    told=Told(unit="arcmin", size=ARCMIN),
    signs="accel_misalignment_ab is Γab: the effect of a force along b on accelerometer a",
    basic=True,
)
SECOND_ORDER = Group(
    name="accel_second_order",
    kinds=("accel",),
    make=_second_order,
    prior_sigma=1e-4 / STANDARD_G,
    told=Told(unit="µg/g²", size=1e-6 / STANDARD_G),
    formula="K2·f²",
)
DELAY = Group(
    name="accel_delay",
    kinds=("accel",),
    make=_delay,
    prior_sigma=0.005,
    told=Told(unit="ms", size=1e-3),
    formula="τ·(ω × f)",
)
TEMPERATURE_BIAS = Group(
    name="accel_temperature_bias",
    kinds=("accel",),
    make=bias_by_temperature("accel_temperature_bias", "ΔfT", "m/s²/°C"),
    prior_sigma=100e-6 * STANDARD_G,
    told=Told(unit="µg/°C", size=MICRO_G),
    formula="ΔfT·x",
)
TEMPERATURE_SCALE = Group(
    name="accel_temperature_scale",
    kinds=("accel",),
    make=_temperature_scale,
    prior_sigma=200e-6,
    told=Told(unit="ppm/°C", size=1e-6),
    formula="ΓT·f·x",
)
GROUPS = (BIAS, SCALE, MISALIGNMENT, SECOND_ORDER, DELAY, TEMPERATURE_BIAS, TEMPERATURE_SCALE)
EFFECTS = (
    effect_of(
        DELAY,
        "The accelerometer readings are delayed relative to the gyros.",
        "turn fast both ways: gravity is then seen turned by the rate times the delay",
        RATE,
    ),
    effect_of(
        SECOND_ORDER,
        "The accelerometers' outputs have a part proportional to the input squared.",
        "turn about horizontal axes in whole turns, so that each accelerometer sees from -g to +g",
        PHASE,
    ),
    effect_of(
        TEMPERATURE_BIAS,
        "The accelerometers' constant errors change with temperature.",
        WARM,
        TEMPERATURE,
        needs="temperature",
    ),
    effect_of(
        TEMPERATURE_SCALE,
        "The accelerometers' scale factors change with temperature.",
        WARM,
        TEMPERATURE,
        needs="temperature",
    ),
)
