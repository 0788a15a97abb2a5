"""Long records gone through in blocks of readings, so that a model's columns need not stand whole.

A block is a view of the record; what a term remembers is handed from block to block, and begins
afresh with each run, as in one evaluation of the whole.
"""

from collections.abc import Callable, Iterator
from typing import TypeVar

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
