"""A shape in words: the short formula in its place."""

from thermo.discrepancy.shape.found import ShapeFound
from thermo.library.shape import quantity_of


def formula_words(found: ShapeFound) -> str | None:
    """Return the short formula in words, with what it loses; None without one."""
    formula = found.formula
    if formula is None:
        return None
    quantity = quantity_of(found.pattern.quantity)
    at = f"{formula.at:.3g} {quantity.unit}".rstrip()
    words = {
        "power": f"a power of {formula.at:.0f}",
        "exponential": f"an exponential with a constant of {at}",
        "sine": f"a sine with a period of {at}",
        "kink": f"a kink at {at}",
        "step": f"a step at {at}",
    }[formula.family]
    return (
        f"{words} explains as much with {formula.parameters} parameters, but for "
        f"{100.0 * lost_share(found):.1f} %"
    )


def lost_share(found: ShapeFound) -> float:
    """Return the share of what a shape explains that its short formula does not; 0 without one."""
    if found.formula is None:
        return 0.0
    return max(0.0, 1.0 - found.formula.gain / found.pattern.shape.gain)
