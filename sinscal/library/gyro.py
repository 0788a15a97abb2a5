"""Errors of the gyros: constant, scale, axes, force, direction of turning, temperature."""

import numpy as np

from errormodel.terms import Term, Told
from sinscal.frames.earth import ARCMIN, DEG_PER_H, STANDARD_G
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
    scale,
    signal,
    term_of,
)
from sinscal.recording.run import AXES


def _g_sensitivity(c: ChannelId) -> Term:
    parts = [
        (f"gyro_g_sensitivity_{c.letter}{a}", f"G{c.letter}{a}", "rad/s/(m/s²)", signal(f"f_{a}"))
        for a in AXES
    ]
    sentence = "The drift changes with the specific force (dynamic drift)."
    return term_of(f"gyro_g_sensitivity_{c.letter}", sentence, parts)


def _asymmetry(c: ChannelId) -> Term:
    name = f"gyro_scale_asymmetry_{c.letter}"
    sentence = "The scale factor differs between the two directions of rotation."
    return term_of(name, sentence, [(name, f"Θ±{c.letter}", "1", lambda r: np.abs(r[c.input]))])


# Priors: those of the article for its parameters; otherwise assumed values for navigation-grade
# sensors, several times the limits of their data sheets.
BIAS = Group(
    name="gyro_bias",
    kinds=("gyro",),
    make=constant_error,
    prior_sigma=0.5 * DEG_PER_H,
    told=Told(unit="°/h", size=DEG_PER_H),
    formula="ν⁰",
    basic=True,
)
SCALE = Group(
    name="gyro_scale",
    kinds=("gyro",),
    make=scale,
    prior_sigma=1e-3,
    told=Told(unit="ppm", size=1e-6),
    formula="(I + Θ)·ω",
    signs="gyro_scale_a is Θaa",
    basic=True,
)
MISALIGNMENT = Group(
    name="gyro_misalignment",
    kinds=("gyro",),
    make=misalignment,
    prior_sigma=3.0 * ARCMIN,
    told=Told(unit="arcmin", size=ARCMIN),
    signs="gyro_misalignment_ab is Θab: the effect of a rate about b on gyro a",
    basic=True,
)
G_SENSITIVITY = Group(
    name="gyro_g_sensitivity",
    kinds=("gyro",),
    make=_g_sensitivity,
    prior_sigma=0.5 * DEG_PER_H / STANDARD_G,
    told=Told(unit="°/h/g", size=DEG_PER_H / STANDARD_G),
    formula="G·f",
)
SCALE_ASYMMETRY = Group(
    name="gyro_scale_asymmetry",
    kinds=("gyro",),
    make=_asymmetry,
    prior_sigma=1e-4,
    told=Told(unit="ppm", size=1e-6),
    formula="Θ±·|ω|",
)
TEMPERATURE_DRIFT = Group(
    name="gyro_temperature_drift",
    kinds=("gyro",),
    make=bias_by_temperature("gyro_temperature_drift", "νT", "rad/s/°C"),
    prior_sigma=0.05 * DEG_PER_H,
    told=Told(unit="°/h/°C", size=DEG_PER_H),
    formula="νT·x",
)
GROUPS = (BIAS, SCALE, MISALIGNMENT, G_SENSITIVITY, SCALE_ASYMMETRY, TEMPERATURE_DRIFT)
EFFECTS = (
    effect_of(
        G_SENSITIVITY,
        "The gyros' drift changes with the specific force.",
        "turn slowly both ways about each axis in turn, so that gravity rotates in the body",
        PHASE,
    ),
    effect_of(
        SCALE_ASYMMETRY,
        "The gyros' scale factors differ between the two directions of rotation.",
        "turn about each axis at two rates or more, each both ways, with the rig's angle recorded",
        RATE,
    ),
    effect_of(
        TEMPERATURE_DRIFT,
        "The gyros' drifts change with temperature.",
        WARM,
        TEMPERATURE,
        needs="temperature",
    ),
)
