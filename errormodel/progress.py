"""Progress of a long computation, for whoever wants to show it.

Loops that take long go through `track`. Where nobody listens that is the loop alone. Loops
within a loop count as parts of its present step, so that one share tells how far all of it is.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(slots=True)
class _Listener:
    """Whom to tell, and which part of the whole is being done."""

    tell: Callable[[float], None]
    low: float = 0.0
    width: float = 1.0


_listener: ContextVar[_Listener | None] = ContextVar("progress", default=None)


@contextmanager
def listening(tell: Callable[[float], None]) -> Generator[None]:
    """Be told within the block how much is done.

    Parameters
    ----------
    tell : callable
        Takes a share, 0 to 1; it may be called very often.
    """
    token = _listener.set(_Listener(tell))
    try:
        yield
    finally:
        _listener.reset(token)


def track(items: Sequence[T]) -> Iterator[T]:
    """Yield the items, and tell before each how much is done; they are taken to last alike."""
    mine = _listener.get()
    if mine is None or not items:
        yield from items
        return
    low, width = mine.low, mine.width
    step = width / len(items)
    try:
        for k, item in enumerate(items):
            mine.low, mine.width = low + k * step, step
            mine.tell(mine.low)
            yield item
        mine.tell(low + width)
    finally:
        mine.low, mine.width = low, width


@contextmanager
def stage(begin: float, end: float) -> Generator[None]:
    """Do within the block what lies between two shares of the present step."""
    mine = _listener.get()
    if mine is None:
        yield
        return
    low, width = mine.low, mine.width
    mine.low, mine.width = low + begin * width, (end - begin) * width
    mine.tell(mine.low)
    try:
        yield
        mine.tell(low + end * width)
    finally:
        mine.low, mine.width = low, width
