"""Bias and scale factor, and their polynomials of temperature (IEEE 1293 form)."""

from collections.abc import Callable, Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Coefficient, Effect, Term, memoryless
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
)

MAX_ORDER = 4


def scale_factor() -> Term:
    """Return K1 at the reference temperature, as a ratio to the nominal scale factor."""
    return Term(
        name="k1",
        sentence="The scale factor at the reference temperature.",
        place="gain",
        coefficients=(
            Coefficient(
                name="k1", symbol="K1", unit="nominal", min_share=POSITION_SHARE, prior_sigma=0.1
            ),
        ),
        columns=memoryless(lambda r: np.ones(len(r))),
    )


def bias() -> Term:
    """Return K0 at the reference temperature."""
    return one_column(
        "k0",
        symbol="K0",
        unit="µg",
        sentence="The output at zero input, at the reference temperature.",
        column=lambda r: np.ones(len(r)),
    )


def power(values: FloatArray, order: int) -> FloatArray:
    """Return an integer power by multiplication, ten times as fast as numpy."""
    product = values
    for _ in range(order - 1):
        product = product * values
    return product


def _power(order: int) -> Callable[[Record], FloatArray]:
    return lambda r: power(r["x_c"], order)


def bias_order(order: int) -> Term:
    """Return the bias's coefficient of x to the power `order`."""
    return one_column(
        order_name("k0", order),
        symbol=f"b{order}",
        unit=f"µg/°C{_superscript(order)}",
        sentence=f"The bias changes with temperature to the power {order}.",
        column=_power(order),
        needs=("x_c",),
        family="k0",
        order=order,
        prior_sigma=WIDE / WIDE_C**order,
    )


def scale_order(order: int) -> Term:
    """Return the scale factor's relative coefficient of x to the power `order`."""
    return one_column(
        order_name("k1", order),
        symbol=f"s{order}",
        unit=f"ppm/°C{_superscript(order)}",
        sentence=f"The scale factor changes with temperature to the power {order}.",
        place="scale",
        column=_power(order),
        needs=("x_c",),
        family="k1",
        order=order,
        prior_sigma=WIDE / WIDE_C**order,
    )


def order_name(family: str, order: int) -> str:
    """Return the name of a family's term of an order of temperature."""
    return f"{family}_t{order}" if order else family


def _superscript(order: int) -> str:
    return "" if order == 1 else "²³⁴"[order - 2]


def _next_orders(family: str) -> Callable[[Context], Sequence[Form]]:
    def forms(at: Context) -> Sequence[Form]:
        names = {k: order_name(family, k) for k in range(1, MAX_ORDER + 1)}
        first = max([k for k, name in names.items() if name in at.term_names], default=0) + 1
        missing = tuple(names[k] for k in range(first, MAX_ORDER + 1))
        return [Form(terms=missing)] if missing else []

    return forms


ORDERS = tuple(range(1, MAX_ORDER + 1))
ORDER_NAMES = frozenset(order_name(family, k) for family in ("k0", "k1") for k in ORDERS)
TERMS: dict[str, Callable[[], Effect]] = {
    "k1": scale_factor,
    "k0": bias,
    **{order_name("k0", k): (lambda k=k: bias_order(k)) for k in ORDERS},
    **{order_name("k1", k): (lambda k=k: scale_order(k)) for k in ORDERS},
}
EFFECTS = (
    ThermalEffect(
        name="bias_temperature_order",
        sentence="The bias has a higher order in temperature than the model: {size}.",
        forms=_next_orders("k0"),
        experiment="a wider range of temperature, with holds along it",
        # some 30 µg at the ends of the range
        example=Example(term="k0_t3", values={"k0_t3": 1e-4 / MICRO}),
    ),
    ThermalEffect(
        name="scale_temperature_order",
        sentence="The scale factor has a higher order in temperature than the model: {size}.",
        forms=_next_orders("k1"),
        experiment="a wider range of temperature, tumbled between +1 g and −1 g",
        example=Example(term="k1_t3", values={"k1_t3": 1e-4 / MICRO}),  # some 30 ppm there
    ),
)
