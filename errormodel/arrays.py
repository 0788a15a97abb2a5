"""Array types, and results that stay as they were made."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.intp]


def readonly(values: ArrayLike) -> FloatArray:
    """Return a float copy of `values` that cannot be written to."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def readonly_int(values: ArrayLike) -> IntArray:
    """Return an integer copy of `values` that cannot be written to."""
    array = np.array(values, dtype=np.intp)
    array.flags.writeable = False
    return array


def freeze(obj: object, **arrays: Any) -> None:
    """Set attributes of a frozen dataclass from its own `__post_init__`."""
    for name, value in arrays.items():
        object.__setattr__(obj, name, value)
