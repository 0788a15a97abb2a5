"""Squared, cubed and crossed forces, and the angles of the input axis."""

from collections.abc import Callable

from errormodel.terms import Effect, Term
from thermo.library.effects import (
    MICRO,
    POSITION_SHARE,
    WIDE,
    Example,
    ThermalEffect,
    one_column,
    plain_form,
)
from thermo.library.polynomial import power

ORDINARY = 1e-3  # 1 mg/g²: wider than any accelerometer

_STATIC: tuple[Term, ...] = (
    one_column(
        "k2",
        symbol="K2",
        unit="µg/g²",
        sentence="The output has a part proportional to the input squared.",
        column=lambda r: r["a_i_g"] ** 2,
        needs=("a_i_g",),
        prior_sigma=ORDINARY,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "k3",
        symbol="K3",
        unit="µg/g³",
        sentence="The output has a part proportional to the input cubed.",
        column=lambda r: power(r["a_i_g"], 3),
        needs=("a_i_g",),
        prior_sigma=ORDINARY,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "delta_o",
        symbol="δo",
        unit="µrad",
        sentence="The input axis is rotated about the output axis, towards the pendulous axis.",
        column=lambda r: r["a_p_g"],
        needs=("a_p_g",),
        prior_sigma=WIDE,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "delta_p",
        symbol="δp",
        unit="µrad",
        sentence="The input axis is rotated about the pendulous axis, away from the output axis.",
        column=lambda r: -r["a_o_g"],
        needs=("a_o_g",),
        prior_sigma=WIDE,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "k_ip",
        symbol="Kip",
        unit="µg/g²",
        sentence="Force along the input and pendulous axes together gives an output.",
        column=lambda r: r["a_i_g"] * r["a_p_g"],
        needs=("a_i_g", "a_p_g"),
        prior_sigma=ORDINARY,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "k_io",
        symbol="Kio",
        unit="µg/g²",
        sentence="Force along the input and output axes together gives an output.",
        column=lambda r: r["a_i_g"] * r["a_o_g"],
        needs=("a_i_g", "a_o_g"),
        prior_sigma=ORDINARY,
        min_share=POSITION_SHARE,
    ),
)
STATIC_NAMES = tuple(t.name for t in _STATIC)
TERMS: dict[str, Callable[[], Effect]] = {t.name: (lambda t=t: t) for t in _STATIC}
EFFECTS = (
    ThermalEffect(
        name="second_order",
        sentence="The output has a part proportional to the input squared, {size}.",
        forms=plain_form("k2"),
        experiment="positions every 45°: with 0° and ±90° alone, a squared term equals a readout "
        "gain that depends on the sign",
        example=Example(term="k2", values={"k2": 20 / MICRO}),  # data sheets: 10 to 30 µg/g²
    ),
    ThermalEffect(
        name="third_order",
        sentence="The output has a part proportional to the input cubed, {size}.",
        forms=plain_form("k3"),
        experiment="positions every 45°: at 0°, ±90° and 180° it equals a scale factor",
        example=Example(term="k3", values={"k3": 20 / MICRO}),  # assumed as large
    ),
    ThermalEffect(
        name="cross_axis",
        sentence="Force across the input axis gives an output, {size}; an equal error of the "
        "head's zero has the same effect.",
        forms=plain_form("delta_o", "delta_p", "k_ip", "k_io"),
        experiment="positions every 45°, and the same with the accelerometer turned by 180° about "
        "its input axis, which reverses the effect but not the head's error",
        # repeats to 100 µrad over a year
        example=Example(term="delta_o", values={"delta_o": 100 / MICRO}),
    ),
)
