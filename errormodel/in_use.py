"""A value that all of the program uses, and that a command may replace until it ends."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Generic, TypeVar

T = TypeVar("T")


class InUse(Generic[T]):
    """The value in use: the standard one, or the last that `using` has opened.

    Parameters
    ----------
    standard : object
    """

    def __init__(self, standard: T) -> None:
        self._opened = [standard]

    def __call__(self) -> T:
        """Return the value in use."""
        return self._opened[-1]

    @contextmanager
    def using(self, value: T) -> Generator[T]:
        """Use another value until the end of the block."""
        self._opened.append(value)
        try:
            yield value
        finally:
            self._opened.remove(value)
