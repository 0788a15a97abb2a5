"""Effects that a test cannot show, by its design alone: the model's coefficients take them up.

Of an effect the residual shows the part that the model does not hold. That part is told once it
is `WORTH` of the white noise; where the model holds 1/WORTH times as much, it is by then wrong by
more than the noise of a reading, and no residual tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from thermo.library import MAX_ORDER, STATIC_NAMES
from thermo.recording.channel import Channel
from thermo.uncertainty.left_out import WORTH, LeftOut
from thermo.uncertainty.linearised import LinearisedFit, whole_effect
from thermo.uncertainty.missing_effects import effects_that_hide

HIDDEN = WORTH**2 / (1.0 + WORTH**2)  # of an effect's square: less is left of one that hides
TAKES_UP = 0.05  # of its size: a coefficient that does holds it
NAMED = 2  # coefficients that take up the most
ORDINARY = ("k0", "k1", *STATIC_NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class NotShown:
    """An effect that the readings cannot tell from coefficients, or hardly.

    Attributes
    ----------
    name, words : str
    stands_in : tuple of str
        The coefficients that would hold it, the first the most.
    """

    name: str
    words: str
    stands_in: tuple[str, ...]


def not_shown(
    line: LinearisedFit, channel: Channel, told: Sequence[LeftOut] = ()
) -> tuple[NotShown, ...]:
    """Return the effects that a test cannot show, or hardly.

    Parameters
    ----------
    line : LinearisedFit
    channel : Channel
        What was fitted.
    told : sequence of LeftOut
        What the residual shows all the same.
    """
    shown = {one.name for one in told}
    described = {c.name: c for c in line.fit.model.coefficients}
    found: list[NotShown] = []
    for effect in effects_that_hide(line, channel):
        size2 = float(effect.column @ effect.column)
        left = _left(line, effect.column)
        if effect.name in shown or float(left @ left) >= HIDDEN * size2:
            continue
        by = holders(line, effect.column)
        if by and described[by[0]].family in ORDINARY:  # else the model has a term for it
            found.append(NotShown(name=effect.name, words=effect.words, stands_in=by[:NAMED]))
    return tuple(found)


def _left(line: LinearisedFit, column: FloatArray) -> FloatArray:
    return np.concatenate([left[:, 0] for _, left in line.left(whole_effect(column))])


def holders(line: LinearisedFit, column: FloatArray) -> tuple[str, ...]:
    """Return the coefficients that take up an effect, the one that takes up the most first.

    Taken about the middle of the readings: far from it the powers of x are nearly alike, and each
    takes up what the others give back.
    """
    # such powers lose digits: once more, of what is left
    moved = line.moved(column[:, None]) + line.moved(_left(line, column)[:, None])
    moved = moved[:, 0]
    x, names = line.record["x_c"], line.fit.names
    middle = 0.5 * float(x.min() + x.max())
    sizes = dict(zip(names, moved.tolist(), strict=True))
    norms = np.linalg.norm(line.columns.triangle(), axis=0)  # the columns' own, by rotation
    lengths = dict(zip(names, np.abs(moved) * norms, strict=True))
    for family in ("k0", "k1"):
        powers = _powers(names, family)
        if len(powers) < 2:
            continue
        gain = line.fit.value("k1") if family == "k1" else 1.0
        here = [sizes[family], *(gain * sizes[name] for name in powers[1:])]
        about = np.polynomial.Polynomial(here)(np.polynomial.Polynomial([middle, 1.0])).coef
        base = line.record["a_i_g"] if family == "k1" else np.ones(x.size)
        for k, name in enumerate(powers):
            size = abs(float(about[k])) if k < about.size else 0.0
            lengths[name] = size * float(np.linalg.norm(base * (x - middle) ** k))
    least = TAKES_UP * float(np.linalg.norm(column))
    return tuple(sorted((n for n in names if lengths[n] > least), key=lambda n: -lengths[n]))


def _powers(names: tuple[str, ...], family: str) -> list[str]:
    """Return a polynomial's coefficients from the lowest; none where it has gaps."""
    wanted = [family, *(f"{family}_t{k}" for k in range(1, MAX_ORDER + 1))]
    found = [name for name in wanted if name in names]
    return found if found == wanted[: len(found)] else []


def not_shown_sentence(found: Sequence[NotShown]) -> str:
    """Return what a test cannot show as one line; empty when there is nothing."""
    if not found:
        return ""
    told = ", ".join(f"{one.words} (in {' and '.join(one.stands_in)})" for one in found)
    return (
        "this test hardly shows effects that coefficients would absorb, and no sigma includes "
        f"them: {told}"
    )
