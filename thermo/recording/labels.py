"""Columns of few distinct texts, as codes and the texts they stand for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
CodeArray: TypeAlias = NDArray[np.int32]
ALL = slice(None)


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """A column of few distinct texts: `names[codes[i]]` stands in row i."""

    codes: CodeArray
    names: tuple[str, ...]

    @classmethod
    def all_alike(cls, name: str, n: int) -> "Labels":
        """Return the same text n times, without room for n of them."""
        return cls(np.broadcast_to(np.zeros(1, dtype=np.int32), (n,)), (name,))

    @classmethod
    def of(cls, values: ArrayLike) -> "Labels":
        """Encode values as texts, a missing one as "", names in order of first appearance."""
        found, uniques = pd.factorize(np.asarray(values, dtype=object))
        names = [str(value) for value in uniques]
        if (found < 0).any():
            found = np.where(found < 0, len(names), found)
            names.append("")
        return cls(found.astype(np.int32), tuple(names)).renamed(names)

    def renamed(self, new_names: Sequence[str]) -> "Labels":
        """Put another text for each name; names that become equal become one."""
        names = tuple(dict.fromkeys(new_names))
        if len(names) == len(self.names):
            return Labels(self.codes, names)
        index = {name: i for i, name in enumerate(names)}
        table = np.array([index[name] for name in new_names], dtype=np.int32)
        return Labels(table[self.codes], names)

    @classmethod
    def join(cls, parts: Sequence["Labels"]) -> "Labels":
        """Put columns below one another."""
        names = tuple(dict.fromkeys(name for part in parts for name in part.names))
        index = {name: i for i, name in enumerate(names)}
        tables = [np.array([index[n] for n in part.names], dtype=np.int32) for part in parts]
        return cls(np.concatenate([t[p.codes] for t, p in zip(tables, parts, strict=True)]), names)

    def at(self, row: int) -> str:
        """Return the text of one row."""
        return self.names[int(self.codes[row])]

    def text(self, rows: slice = ALL) -> NDArray[np.object_]:
        """Return the texts of all rows or some, shape (n,)."""
        return np.array(self.names, dtype=object)[self.codes[rows]]

    def texts_of(self, rows: slice | IntArray) -> list[str]:
        """Return the texts of some rows as a list."""
        codes: list[int] = self.codes[rows].tolist()
        return [self.names[k] for k in codes]

    def take(self, rows: BoolArray | IntArray) -> "Labels":
        """Return the column of some rows, without the names that no longer occur."""
        codes = self.codes[rows]
        first = np.full(len(self.names), len(codes))
        np.minimum.at(first, codes, np.arange(len(codes)))
        used = np.argsort(first, kind="stable")[: int(np.sum(first < len(codes)))]
        table = np.full(len(self.names), -1, dtype=np.int32)
        table[used] = np.arange(len(used))
        return Labels(table[codes], tuple(self.names[int(i)] for i in used))


def present_only(
    mount_deg: Mapping[tuple[str, str], float], run: Labels, serial: Labels
) -> dict[tuple[str, str], float]:
    """Return the turned mountings of the (run, serial) that occur."""
    there = set(pairs(run, serial))
    return {key: angle for key, angle in mount_deg.items() if angle and key in there}


def pairs(run: Labels, serial: Labels) -> list[tuple[str, str]]:
    """Return the (run, serial) that occur."""
    keys = np.unique(pair_keys(run, serial))
    return [
        (run.names[int(k) // len(serial.names)], serial.names[int(k) % len(serial.names)])
        for k in keys
    ]


def pair_keys(run: Labels, serial: Labels) -> IntArray:
    """Return a number for the (run, serial) of each row, shape (n,)."""
    keys = run.codes.astype(np.int64)
    keys *= len(serial.names)
    keys += serial.codes
    return keys
