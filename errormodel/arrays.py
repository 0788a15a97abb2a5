"""Array types, and results that stay as they were made."""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


def readonly(values: ArrayLike) -> FloatArray:
    """Return `values` as floats that cannot be written to: a copy, unless they are so already."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        given = cast(FloatArray, values)
        if _is_frozen(given):
            return given
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def _is_frozen(array: FloatArray) -> bool:
    """Tell whether neither an array nor what it is a view of can be written to."""
    if array.flags.writeable:
        return False
    flags = getattr(array.base, "flags", None)  # a buffer that is no array has none
    return array.base is None or (flags is not None and not flags.writeable)


def readonly_int(values: ArrayLike) -> IntArray:
    """Return an integer copy of `values` that cannot be written to."""
    array = np.array(values, dtype=np.intp)
    array.flags.writeable = False
    return array


def freeze(obj: object, **arrays: Any) -> None:
    """Set attributes of a frozen dataclass from its own `__post_init__`."""
    for name, value in arrays.items():
        object.__setattr__(obj, name, value)
