"""Squared, cubed and crossed forces, and the angles of the input axis."""

from collections.abc import Callable, Sequence

from errormodel.terms import Effect, Term
from thermo.library.effects import (
    MICRO,
    POSITION_SHARE,
    WIDE,
    WIDE_C,
    Context,
    Example,
    Form,
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
_OVER_TEMPERATURE: tuple[Term, ...] = (
    one_column(
        "k2_t1",
        symbol="K2t",
        unit="µg/g²/°C",
        sentence="The part proportional to the input squared changes with temperature.",
        column=lambda r: r["a_i_g"] ** 2 * r["x_c"],
        needs=("a_i_g", "x_c"),
        family="k2",
        order=1,
        prior_sigma=ORDINARY / WIDE_C,
        min_share=POSITION_SHARE,
    ),
    one_column(
        "delta_o_t1",
        symbol="δot",
        unit="µrad/°C",
        sentence="The angle of the input axis about the output axis changes with temperature.",
        column=lambda r: r["a_p_g"] * r["x_c"],
        needs=("a_p_g", "x_c"),
        family="delta_o",
        order=1,
        prior_sigma=ORDINARY / WIDE_C,
        min_share=POSITION_SHARE,
    ),
)


def _with_slope(first: str, *others: str) -> Callable[[Context], Sequence[Form]]:
    """Return the forms of static terms: those that the model lacks, and the first's slope too."""

    def forms(at: Context) -> Sequence[Form]:
        missing = tuple(t for t in (first, *others) if t not in at.term_names)
        if not missing:
            return []
        slope = f"{first}_t1"
        more = (slope,) if first in missing and slope not in at.term_names else ()
        return [Form(terms=missing), *([Form(terms=(*missing, *more))] if more else [])]

    return forms


def _slope(name: str) -> Callable[[Context], Sequence[Form]]:
    """Return the form of a static term's slope over temperature, where the model has the term."""

    def forms(at: Context) -> Sequence[Form]:
        slope = f"{name}_t1"
        there = name in at.term_names and slope not in at.term_names
        return [Form(terms=(slope,))] if there else []

    return forms


STATIC_NAMES = tuple(t.name for t in _STATIC)
TERMS: dict[str, Callable[[], Effect]] = {
    t.name: (lambda t=t: t) for t in (*_STATIC, *_OVER_TEMPERATURE)
}
EFFECTS = (
    ThermalEffect(
        name="second_order",
        sentence="The output has a part proportional to the input squared, {size}.",
        forms=_with_slope("k2"),
        experiment="positions every 45°: with 0° and ±90° alone a squared term and a readout "
        "whose gain depends on the sign look the same",
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
        sentence="Force across the input axis gives an output, {size}; a head whose zero is off "
        "by the same angle does the same.",
        forms=_with_slope("delta_o", "delta_p", "k_ip", "k_io"),
        experiment="positions every 45°, and the same with the accelerometer turned by 180° about "
        "its input axis, which reverses the effect but not the head's error",
        # repeats to 100 µrad over a year
        example=Example(term="delta_o", values={"delta_o": 100 / MICRO}),
    ),
    ThermalEffect(
        name="second_order_slope",
        sentence="The part proportional to the input squared changes with temperature, {size}.",
        forms=_slope("k2"),
        changes="k2",
        experiment="positions every 45° at the ends of the range of temperature",
        example=Example(term="k2_t1", values={"k2_t1": 0.5 / MICRO}),
    ),
    ThermalEffect(
        name="misalignment_slope",
        sentence="The angle of the input axis changes with temperature, {size}.",
        forms=_slope("delta_o"),
        changes="delta_o",
        experiment="positions at 0° and 180° at the ends of the range of temperature",
        example=Example(term="delta_o_t1", values={"delta_o_t1": 1.0 / MICRO}),
    ),
)
