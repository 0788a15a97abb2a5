"""Input of the search: residual, columns of the baseline, candidate effects.

The search does not depend on the physics. For a chamber run, the input is the residual of the
present model, and the search estimates the noise spectrum. For a filter, the input is the
innovations, which are white and have the baseline projected out, with `noise=NoiseModel()` and an
empty `base`. The signature of a candidate is then the response of the filter to the effect (Willsky
and Jones 1976). The regression is the same in both cases.
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
    """Return the columns of a signature; for an effect without a coefficient, its offset."""
    return signature.columns if signature.offset is None else signature.offset[:, None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """An effect that may be missing.

    `grid` are the nonlinear parameters tried first, fine enough that the best of them is near the
    global minimum. `bounds` are the bounds of the refinement. If the output does not change
    smoothly, `finer` gives further points near a grid point instead (with neither, the grid is
    final). The size of an event increases the estimated noise, so the noise is estimated again once
    the event is in the model. `flexible` is the flexible form with more parameters, which is tried
    before a second effect is named. `joint` marks terms of the present model's own equation; these
    are offered together before other causes are searched.
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
    """A quantity that the residual may follow, represented by columns.

    With several groups of columns (for example one per period), the group that explains most is
    used.
    `repeatable` tells whether a new run would show the same.
    """

    name: str
    groups: tuple[FloatArray, ...]
    repeatable: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Problem:
    """A measurement, its present model and the candidate effects.

    Attributes
    ----------
    times : TimeBase
    residual : ndarray, shape (n,)
        Measured minus modelled output.
    base : ndarray, shape (n, p)
        Jacobian of the present model.
    candidates : tuple of Candidate
    saturated : ndarray, shape (n, m)
        Everything that would repeat in a new run; the noise is estimated with these columns in the
        mean.
    factors : tuple of Factor
    noise : NoiseModel, optional
        The noise if it is known; white with unit sigma.
    events : frozenset of str
        Names of effects that a new run would not repeat.
    bounded : ndarray of bool, shape (n,), optional
        Samples with a noise of at most `sigma`, possibly far less.
    scaled : tuple of ndarray of bool, each (n,)
        Groups of samples whose sigma was estimated from these data with `saturated` in the mean;
        the same is done in every draw.
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
