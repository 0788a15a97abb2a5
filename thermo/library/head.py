"""The indexing head: harmonics of its angle error, and remounted accelerometers."""

from collections.abc import Callable, Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Effect, Term, memoryless
from thermo.library.effects import (
    EVENT_SHARE,
    Context,
    Form,
    ThermalEffect,
    millionths,
    one_column,
)

MAX_MOUNTINGS = 5  # whose angles have names
HARMONICS = (2, 3, 4)


def harmonic_name(order: int) -> str:
    """Return the name of the error with `order` periods a turn."""
    return "indexer_harmonic" if order == 2 else f"indexer_harmonic_{order}"


def indexer_harmonic(order: int) -> Term:
    """Return an error of the head's angle with `order` periods a turn."""
    name = harmonic_name(order)

    def columns(record: Record) -> FloatArray:
        own = np.arctan2(record["a_i_g"], record["a_p_g"])
        # the error belongs to the head, independent of the mounting of the accelerometer
        head_deg = record.signals.get("head_deg")
        angle = order * (own if head_deg is None else np.deg2rad(head_deg))
        error = np.column_stack([np.sin(angle), np.cos(angle)])
        return np.round(record["a_p_g"][:, None] * error, 12)  # remove rounding errors of zero

    return Term(
        name=name,
        sentence=f"The error of the head's angle has {order} periods a turn.",
        place="input",
        coefficients=(
            millionths(f"{name}_sin", "es", "µrad", family="indexer_harmonic"),
            millionths(f"{name}_cos", "ec", "µrad", family="indexer_harmonic"),
        ),
        columns=memoryless(columns),
        needs=frozenset(["a_i_g", "a_p_g"]),
    )


def remount_name(number: int) -> str:
    """Return the name of the angle of mounting `number` (1 for the second)."""
    return f"remount_{number}"


def remount(number: int) -> Term:
    """Return the angle of mounting `number` relative to the first, about the output axis."""
    return one_column(
        remount_name(number),
        symbol=f"m{number}",
        unit="µrad",
        sentence="After remounting on the head, the accelerometer is rotated by a small angle.",
        column=lambda r: r["a_p_g"] * (r["mounting"] == number),
        needs=("a_p_g", "mounting"),
        family="remount",
        min_share=EVENT_SHARE,
        predictive=False,
    )


def _harmonic(at: Context) -> Sequence[Form]:
    names = tuple(harmonic_name(k) for k in HARMONICS)
    if any(n in at.term_names for n in names):
        return []
    return [Form(terms=names[:1]), Form(terms=names)]


TERMS: dict[str, Callable[[], Effect]] = {
    **{harmonic_name(k): (lambda k=k: indexer_harmonic(k)) for k in HARMONICS},
    **{remount_name(k): (lambda k=k: remount(k)) for k in range(1, MAX_MOUNTINGS)},
}
EFFECTS = (
    ThermalEffect(
        name="indexer_harmonic",
        sentence="The head's angle has a periodic error over a turn, {size}.",
        forms=_harmonic,
        experiment="positions every 15°, and the same with the accelerometer mounted turned by "
        "90° on the head",
        cause="head",
        # no example: it belongs to the head, and every accelerometer would show it
    ),
)
