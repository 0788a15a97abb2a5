"""A measurement as the engine takes it: residual, the baseline's columns, candidate effects.

The engine knows no physics. A chamber run gives it the residual of its present model and lets it
find the colour of the noise. A filter gives it its innovations, which are white already and have
the baseline projected out, with `noise=NoiseModel()` given and `base` empty; a
candidate's signature is then what the filter's own gains make of the effect (Willsky and Jones
1976). Everything after that is the same regression.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import TimeBase

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Signature:
    """Pattern that an effect would leave in the residual, at given nonlinear parameters.

    The residual with the effect is ``base · b + columns · c + offset`` with b, c free.

    Attributes
    ----------
    columns : ndarray, shape (n, k)
        Columns that the effect adds; k = 0 for an effect that only changes an input.
    base : ndarray, shape (n, p), optional
        The baseline's columns when the effect changes them too.
    offset : ndarray, shape (n,), optional
        Change by the effect that has no free coefficient.
    """

    columns: FloatArray
    base: FloatArray | None = None
    offset: FloatArray | None = None


def columns_of(signature: Signature) -> FloatArray:
    """Return a signature's columns; for an effect without a coefficient, what it does."""
    return signature.columns if signature.offset is None else signature.offset[:, None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """An effect that may be missing.

    `grid` are the nonlinear parameters tried first, close enough together that the best of them
    lies in the right valley; `bounds` those of the refinement, or `finer` gives the points about
    one of the grid where the output does not change smoothly (neither: the grid is all there is).
    An event's size inflates the noise it is judged by, so the noise is estimated anew once it is
    in the model. `flexible` is the effect's flexible form, of more parameters, tried before any
    second effect is named. `joint` marks what belongs to the present model's own equation: all such
    are offered together before causes are looked for beside them.
    """

    name: str
    signature: Callable[[Theta], Signature]
    grid: tuple[Theta, ...] = ((),)
    bounds: tuple[tuple[float, float], ...] = ()
    finer: Callable[[Theta], tuple[Theta, ...]] | None = None
    event: bool = False
    flexible: "Candidate | None" = None
    joint: bool = False

    @cached_property
    def grid_signatures(self) -> tuple[Signature, ...]:
        """The signatures at the points of the grid."""
        return tuple(self.signature(theta) for theta in self.grid)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Factor:
    """Something the residual may follow: its columns resolve it.

    Of several groups of columns (one a period, say) the one that explains most counts.
    `repeatable` tells whether a new run would show the same.
    """

    name: str
    groups: tuple[FloatArray, ...]
    repeatable: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Problem:
    """A measurement, its present model and what may be missing.

    Attributes
    ----------
    times : TimeBase
    residual : ndarray, shape (n,)
        Measured less the present model.
    base : ndarray, shape (n, p)
        Derivative of the present model by its parameters.
    candidates : tuple of Candidate
    saturated : ndarray, shape (n, m)
        Everything that would repeat in a new run, for the noise to be judged beside.
    factors : tuple of Factor
    noise : NoiseModel, optional
        The noise where it is known; white, of unit sigma.
    events : frozenset of str
        Names of effects that a new run would not repeat.
    bounded : ndarray of bool, shape (n,), optional
        Samples whose noise is no larger than `sigma`, and may be far less.
    scaled : tuple of ndarray of bool, each (n,)
        Groups of samples whose sigma was found in these data, beside `saturated`: so it is in
        every draw.
    """

    times: TimeBase
    residual: FloatArray
    base: FloatArray
    candidates: tuple[Candidate, ...]
    saturated: FloatArray
    factors: tuple[Factor, ...] = ()
    noise: NoiseModel | None = None
    events: frozenset[str] = frozenset()
    bounded: NDArray[np.bool_] | None = None
    scaled: tuple[NDArray[np.bool_], ...] = ()

    def __post_init__(self) -> None:
        n = len(self.times)
        for name in ("residual", "base", "saturated"):
            if getattr(self, name).shape[0] != n:
                raise ValueError(f"{name} has {getattr(self, name).shape[0]} rows, expected {n}")
