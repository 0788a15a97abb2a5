"""The form of a table, and its columns while they are put together from pieces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow
import pyarrow.compute
from numpy.typing import NDArray

arrow: Any = pyarrow  # it has no types
arrow_compute: Any = pyarrow.compute


@dataclass(frozen=True, slots=True, kw_only=True)
class TableForm:
    """Columns that a table may have: of numbers, of texts, and those it must have."""

    numbers: tuple[str, ...]
    texts: tuple[str, ...] = ()
    required: tuple[str, ...] = ()

    @property
    def known(self) -> tuple[str, ...]:
        """All columns that are read; others are named in a warning."""
        return (*self.numbers, *self.texts)

    def row_bytes(self, present: list[str]) -> int:
        """Return how much a row takes: a float for a number, a code for a text."""
        return sum(8 if name in self.numbers else 4 for name in present)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawTable:
    """A table as parsed, nothing of it checked but that numbers are numbers.

    Attributes
    ----------
    number : mapping
        Column → values, shape (n,), NaN where the cell is empty.
    text : mapping
        Column → code of each row, shape (n,), and the texts they stand for.
    source : str
        The file.
    place : callable
        Turns a row's index into words ("line 12").
    """

    number: Mapping[str, NDArray[np.float64]]
    text: Mapping[str, tuple[NDArray[np.int32], tuple[str, ...]]]
    source: str
    place: Callable[[int], str]


class GrowingTable:
    """Columns that pieces are added to, each in its place: none is copied as a whole.

    Parameters
    ----------
    present : list of str
        The columns.
    form : TableForm
    expected_rows : int
        Room is taken for so many, and for more when they come.
    text_of : callable, optional
        Turns a cell of text into the text it stands for.
    """

    def __init__(
        self,
        present: list[str],
        form: TableForm,
        expected_rows: int,
        text_of: Callable[[str], str] = str,
    ) -> None:
        self._form, self._text_of = form, text_of
        self._columns: dict[str, NDArray[Any]] = {
            name: np.empty(expected_rows, np.int32 if name in form.texts else np.float64)
            for name in present
        }
        self._codes: dict[str, dict[str, int]] = {n: {} for n in present if n in form.texts}
        self.rows = 0

    def add(self, piece: Any) -> None:
        """Add an arrow record batch or table that has the columns, of floats and of texts."""
        begin, self.rows = self.rows, self.rows + piece.num_rows
        for name, values in self._columns.items():
            if self.rows > values.size:
                values.resize(self.rows + self.rows // 4, refcheck=False)
            column = piece.column(name)
            column = column.combine_chunks() if isinstance(column, arrow.ChunkedArray) else column
            if name in self._form.texts:
                values[begin : self.rows] = self._encoded(name, column)
            else:
                values[begin : self.rows] = column.to_numpy(zero_copy_only=False)

    def _encoded(self, name: str, column: Any) -> NDArray[np.int32]:
        is_encoded = arrow.types.is_dictionary(column.type)
        encoded = column if is_encoded else column.dictionary_encode()
        known = self._codes[name]
        texts = [self._text_of(text or "") for text in encoded.dictionary.to_pylist()]
        indices = encoded.indices
        if indices.null_count:
            indices = arrow_compute.fill_null(indices, len(texts))
            texts.append("")
        # only the texts that occur are counted, in the order in which they come
        found: NDArray[np.int32] = indices.to_numpy(zero_copy_only=False)
        first = np.full(len(texts), found.size)
        np.minimum.at(first, found, np.arange(found.size))
        table = np.zeros(len(texts), dtype=np.int32)
        used: list[int] = np.argsort(first, kind="stable")[
            : int(np.sum(first < found.size))
        ].tolist()
        for k in used:
            table[k] = known.setdefault(texts[k], len(known))
        return table[found]

    def finish(self, source: str, place: Callable[[int], str]) -> RawTable:
        """Return the table; nothing can be added then."""
        arrow.default_memory_pool().release_unused()
        number: dict[str, NDArray[np.float64]] = {}
        text: dict[str, tuple[NDArray[np.int32], tuple[str, ...]]] = {}
        for name, values in self._columns.items():
            values.resize(self.rows, refcheck=False)
            values.flags.writeable = False
            if name in self._form.texts:
                text[name] = (values, tuple(self._codes[name]))
            else:
                number[name] = values
        return RawTable(number=number, text=text, source=source, place=place)
