"""Array types, and results that stay as they were made."""

from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
AnyArray = TypeVar("AnyArray", bound=NDArray[Any])


def readonly(values: ArrayLike) -> FloatArray:
    """Return `values` as floats that cannot be written to: a copy, unless they are so already."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        given = cast(FloatArray, values)
        if _is_frozen(given):
            return given
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def _is_frozen(array: NDArray[Any]) -> bool:
    """Tell whether neither an array nor what it is a view of can be written to."""
    if array.flags.writeable:
        return False
    flags = getattr(array.base, "flags", None)  # a buffer that is no array has none
    return array.base is None or (flags is not None and not flags.writeable)


def sealed(values: AnyArray) -> AnyArray:
    """Return an array that its maker gives away: made read-only in place, not copied."""
    values.flags.writeable = False
    return values


def constant(value: float, n: int) -> NDArray[np.float64]:
    """Return n times the same value, read-only, without room for n of them."""
    return np.broadcast_to(sealed(np.array([value])), (n,))


def readonly_int(values: ArrayLike) -> IntArray:
    """Return `values` as integers that cannot be written to: a copy, unless they are so already."""
    if isinstance(values, np.ndarray) and values.dtype == np.intp:
        given = cast(IntArray, values)
        if _is_frozen(given):
            return given
    array = np.array(values, dtype=np.intp)
    array.flags.writeable = False
    return array


def freeze(obj: object, **arrays: Any) -> None:
    """Set attributes of a frozen dataclass from its own `__post_init__`."""
    for name, value in arrays.items():
        object.__setattr__(obj, name, value)


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
