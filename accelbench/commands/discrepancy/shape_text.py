"""A shape of a discrepancy, as JSON and in words."""

from collections.abc import Iterator
from typing import Any

from accelbench.shell.console import micro_g, number
from errormodel.discrepancy.shares import Shares, shares_of
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.shape.curve import shape_curve
from thermo.discrepancy.shape.found import ShapeFound
from thermo.discrepancy.shape.words import formula_words, lost_share
from thermo.library.shape import quantity_of


def shares_in(d: Discrepancy) -> Shares:
    """Return the shares of an accelerometer's excess; a shape's is the rest."""
    shape = d.shape
    return shares_of(d, (shape.pattern.quantity, shape.pattern.shape.gain) if shape else None)


def shape_document(d: Discrepancy, library: str | None) -> dict[str, Any] | None:
    """Return a shape as JSON; null where there is none.

    Parameters
    ----------
    d : Discrepancy
    library : str or None
        The library file that holds it, if one is written.
    """
    shape = d.shape
    if shape is None:
        return None
    curve, formula = shape_curve(d), shape.formula
    quantity = quantity_of(shape.pattern.quantity)
    return {
        "name": shape.name,
        "sentence": shape.sentence,
        "quantity": quantity.name,
        "quantity_unit": quantity.unit,
        "times": shape.pattern.times,
        "curves": len(shape.pattern.shape.size),
        "knots": curve.x.tolist(),
        "values": curve.values.tolist(),
        "sigmas": curve.sigmas.tolist(),
        "unit": curve.unit,
        "formula": {
            "family": formula.family,
            "at": formula.at,
            "unit": "" if formula.family == "power" else quantity.unit,
            "parameters": formula.parameters,
            "loses_share": lost_share(shape),
        }
        if formula
        else None,
        "heldout": {
            "before_ug": shape.heldout.before_ug,
            "after_ug": shape.heldout.after_ug,
        },
        "library": library,
    }


def shape_lines(d: Discrepancy) -> Iterator[str]:
    """Say what effect was built for what has no name, and what it is worth."""
    shape = d.shape
    if shape is None:
        return
    yield f"{shape.name}: {shape.sentence}"
    yield (
        f"On runs held out it leaves {micro_g(shape.heldout.after_ug)} of "
        f"{micro_g(shape.heldout.before_ug)}; noise alone {micro_g(d.floor_ug)}."
    )
    words = formula_words(shape)
    if words is not None:
        yield f"In words: {words} of what it explains."


def shape_summary(shape: ShapeFound) -> str:
    """Return what a shape is made of, for a page."""
    quantity = quantity_of(shape.pattern.quantity)
    count = len(shape.pattern.shape.size)
    return (
        f"{count} curve{'' if count == 1 else 's'} over {quantity.axis}, "
        f"{number(len(shape.pattern.shape.knots))} knots"
    )
