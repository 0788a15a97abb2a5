"""An effect without a name: a smooth function of a quantity, found in measurements.

Its term is what `accelbench discrepancy` writes into a library file; the file holds the curves.
"""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Memory, Term, Values
from thermo.library.effects import MICRO, Example, ThermalEffect, millionths, plain_form
from thermo.library.quantities import QUANTITIES, Quantity, of_signal

ORDINARY = 1e-3  # 1 mg or 1000 ppm: wider than any accelerometer
# What a curve may be multiplied by: a name, and a signal or a quantity.
TIMES = ("", "input", "direction", "temperature", "last_move")
# Of a temperature a curve is multiplied by its share of this range.
HALF_RANGE_C = 50.0


def quantity_of(name: str) -> Quantity:
    """Return a quantity by its name; any other name is that of a recorded signal."""
    known = QUANTITIES.get(name)
    return known or of_signal(name, "", f"follows {name}", name, name)


def factor_values(times: str, values: FloatArray) -> FloatArray:
    """Return what a curve is multiplied by, of the values of the quantity that it is."""
    if times == "temperature":
        return values / HALF_RANGE_C
    return np.sign(values) if times == "last_move" else values


def shape_term(
    name: str,
    quantity: str,
    knots: Sequence[float],
    curves: Sequence[Sequence[float]],
    *,
    times: str = "",
    sentence: str = "",
) -> Term:
    """Return a smooth function of a quantity: curves with one coefficient each.

    Parameters
    ----------
    name : str
    quantity : str
        Of `thermo.library.quantities`, or a recorded signal.
    knots : sequence of float, length m
        Values of the quantity.
    curves : sequence of k sequences of float, length m
        Values of each curve at the knots; between them a straight line, beyond them the value at
        the end.
    times : {"", "input", "direction", "temperature", "last_move"}
        What the curves are multiplied by: nothing, the input (a change of the scale factor), 1
        heating and −1 cooling, the temperature over 50 °C, the sign of the head's last turn.
    sentence : str
    """
    follows = quantity_of(quantity)
    by = QUANTITIES.get(times) if times != "input" else None
    at, tables = np.array(knots, dtype=float), np.array(curves, dtype=float)

    def columns(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        own, other = memory or (None, None)
        x, own = follows.columns(record, values, own)
        made = np.zeros((x.shape[0], tables.shape[0]))
        for k, curve in enumerate(tables):
            made[:, k] = np.interp(x[:, 0], at, curve)
        if by is not None:
            level, other = by.columns(record, values, other)
            made = made * factor_values(times, level)
        return made, (own, other)

    place = "scale" if times == "input" else "input"
    return Term(
        name=name,
        sentence=sentence or f"An effect without a name that {follows.words}.",
        place=place,
        coefficients=tuple(
            millionths(
                f"{name}_{k + 1}",
                f"e{k + 1}",
                "ppm" if place == "scale" else "µg",
                family=name,
                label=f"curve {k + 1}",
                prior_sigma=ORDINARY,
            )
            for k in range(len(tables))
        ),
        columns=columns,
        needs=follows.needs | (by.needs if by else frozenset[str]()),
    )


def shape_effect(name: str, sentence: str, values: Sequence[float]) -> ThermalEffect:
    """Return the effect of a shape's term.

    Parameters
    ----------
    name : str
    sentence : str
    values : sequence of float
        Its coefficients as found, µg or ppm.
    """
    sizes = {f"{name}_{k + 1}": v / MICRO for k, v in enumerate(values)}
    return ThermalEffect(
        name=name,
        sentence=sentence,
        forms=plain_form(name),
        experiment="the same quantity over a wider range, all else held",
        example=Example(term=name, values=sizes),
    )
