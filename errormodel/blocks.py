"""Long records gone through in blocks of readings, so that a model's columns need not stand whole.

A block is a view of the record; what a term remembers is handed from block to block, and begins
afresh with each run, as in one evaluation of the whole.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Memory

Result = TypeVar("Result")

# A hundred columns of them take 7 MB. A multiple of `compressed.BLOCK_ROWS`, so that a
# triangle is rotated from the same rows together whether or not its columns came in blocks.
BLOCK = 1 << 13


def block_slices(n: int) -> Iterator[slice]:
    """Yield the blocks of n readings; a single one when they are few."""
    for begin in range(0, n, BLOCK):
        yield slice(begin, min(begin + BLOCK, n))


class Blocked(Protocol):
    """A matrix of one row for each reading, (n, p), that is gone through in blocks."""

    shape: tuple[int, int]

    def blocks(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block, as `block_slices` cuts them, with their rows."""
        ...


class Kept:
    """A matrix (n, p) that stands whole, as `Blocked`."""

    def __init__(self, whole: FloatArray) -> None:
        self.whole = whole
        self.shape = (whole.shape[0], whole.shape[1])

    def blocks(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with their rows."""
        for rows in block_slices(self.shape[0]):
            yield rows, self.whole[rows]


def parts_of_runs(runs: Sequence[slice], rows: slice) -> Iterator[tuple[int, slice]]:
    """Yield the runs that readings of a block belong to, with the readings of each."""
    for number, run in enumerate(runs):
        begin, end = max(run.start, rows.start), min(run.stop, rows.stop)
        if begin < end:
            yield number, slice(begin, end)


def in_blocks(
    record: Record, evaluate: Callable[[Record, Memory], tuple[Result, Memory]]
) -> Iterator[tuple[slice, Result]]:
    """Evaluate a record block by block.

    Parameters
    ----------
    record : Record
    evaluate : callable
        Takes a block and the memory that the one before it left, None at the start of a run;
        returns its result and the memory after it.

    Yields
    ------
    slice, result
        Which readings, and what `evaluate` made of them.
    """
    memory: Memory = None
    for rows in block_slices(len(record)):
        if rows.start and record.run[rows.start] != record.run[rows.start - 1]:
            memory = None
        result, memory = evaluate(record.view(rows), memory)
        yield rows, result
