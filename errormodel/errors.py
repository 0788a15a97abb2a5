"""Errors of data, files and models.

::

    WorkbenchError
    ├── InputError            a file or a value in it is not what it should be (exit 2)
    ├── NotSeparableError     the data cannot tell some coefficients apart (exit 2)
    └── StoreError            the store refuses: it would lose or overwrite something (exit 2)

Instruments have their own tree in `drivers.errors`: the core knows none of them.
"""

from collections.abc import Sequence
from pathlib import Path


class WorkbenchError(Exception):
    """Base of all; the message is one line: what, where, what was expected."""


class InputError(WorkbenchError):
    """A file, or a place in it, is not what it should be.

    Parameters
    ----------
    source : path or str
        The file, or whatever else the input came from.
    place : str
        The line, key or column; empty when it is the whole file.
    problem : str
        What was found and what was expected, without a line break.
    """

    def __init__(self, source: Path | str, place: str, problem: str) -> None:
        self.source = str(source)
        self.place = place
        self.problem = " ".join(problem.split())
        super().__init__(": ".join(part for part in (self.source, place, self.problem) if part))


class NotSeparableError(WorkbenchError):
    """The data cannot separate the coefficients named.

    Parameters
    ----------
    groups : sequence of sequences of str
        Each group's coefficients can only be had in combination.
    what : str
        The data set, for the message.
    """

    def __init__(self, groups: Sequence[Sequence[str]], what: str = "the data") -> None:
        self.groups = tuple(tuple(group) for group in groups)
        text = "; ".join(
            f"{g[0]} (it has no effect there)" if len(g) == 1 else " ~ ".join(g)
            for g in self.groups
        )
        super().__init__(
            f"{what} cannot separate: {text}; leave one of each group out of the model"
        )


class StoreError(WorkbenchError):
    """The store would have to lose or overwrite something."""
