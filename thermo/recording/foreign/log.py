"""A delimited log as cells, with the line each row came from."""

import csv
import io
import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from errormodel.errors import InputError
from errormodel.io import memory
from errormodel.io.tables import NUMBER
from thermo.recording.foreign.map import Column, FileFormat, RowSelection, Where
from thermo.recording.runs import BoolArray, FloatArray

log = logging.getLogger(__name__)

SAMPLE = 1 << 16  # bytes of the beginning, that tell of rows and cells
# What an import holds at its peak: the text, with a copy of it in four bytes a character; the
# cells; the lists, times and columns of a row. Measured: 670 and 1420 bytes a row of 3 and 12
# cells, of 25 and 115 bytes; these give 715 and 1435.
BYTES_A_BYTE, BYTES_A_CELL, BYTES_A_ROW = 5, 30, 500


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """The rows of a log; `names` is empty when it has no header."""

    path: Path
    names: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    decimal: str

    def index(self, column: Column) -> int:
        """Return where a column is, from 0."""
        if isinstance(column, int):
            if column > len(self.rows[0]):
                raise InputError(
                    self.path, f"column {column}", f"the log has {len(self.rows[0])} columns"
                )
            return column - 1
        if column not in self.names:
            shown = ", ".join(self.names) or "no header: columns are numbered from 1"
            raise InputError(
                self.path, "header", f"no column {column!r:.60}; there are: {shown:.300}"
            )
        if self.names.count(column) > 1:
            raise InputError(self.path, "header", f"column {column!r:.60} stands twice")
        return self.names.index(column)

    def cells(self, column: Column) -> list[str]:
        """Return a column's cells without surrounding blanks."""
        at = self.index(column)
        return [row[at].strip() for row in self.rows]

    def numbers(self, column: Column, bad: BoolArray | None) -> FloatArray:
        """Return a column's numbers, shape (n,).

        What is none is NaN and marked in `bad`; when `bad` is None it is an error instead.
        """
        values = np.full(len(self.rows), np.nan)
        for i, cell in enumerate(self.cells(column)):
            value = self.number(cell)
            if math.isfinite(value):
                values[i] = value
            elif bad is None:
                raise InputError(
                    self.path,
                    f"line {self.lines[i]}",
                    f"column {column} is {cell!r:.60}, expected a finite number",
                )
            else:
                bad[i] = True
        return values

    def number(self, cell: str) -> float:
        """Return a cell's number; NaN when it is none."""
        if self.decimal == ",":
            cell = cell.replace(",", ".") if "." not in cell else "?"
        if cell[:1] in ("+", "-"):  # instruments write "- 1.25"
            cell = cell[0] + cell[1:].lstrip()
        return float(cell) if NUMBER.fullmatch(cell) else math.nan

    def matches(self, column: Column, wanted: str | float) -> BoolArray:
        """Return the rows in which a column equals a text, or a number, shape (n,)."""
        cells = self.cells(column)
        if isinstance(wanted, str):
            return np.array([cell == wanted.strip() for cell in cells], dtype=np.bool_)
        return np.array([self.number(cell) == wanted for cell in cells], dtype=np.bool_)

    def take(self, rows: BoolArray) -> "Log":
        """Return some rows."""
        chosen = np.flatnonzero(rows).tolist()
        return Log(
            self.path,
            self.names,
            [self.rows[i] for i in chosen],
            [self.lines[i] for i in chosen],
            self.decimal,
        )


def read_log(path: Path, form: FileFormat) -> Log:
    """Read a log.

    Raises
    ------
    InputError
        If it cannot be read, would not fit into the memory, has no rows, or a line has more or
        fewer cells than the first. A delimiter at the end of the rows of readings alone is no
        cell, and a last line that was cut short is left out with a warning.
    """
    rows: list[list[str]] = []
    lines: list[int] = []
    torn: InputError | None = None
    for line, cells in _cells(path, form):
        if torn is not None:
            raise torn
        if rows and len(cells) == len(rows[0]) + 1 and not cells[-1].strip():
            cells = cells[:-1]
        if rows and len(cells) != len(rows[0]):
            torn = InputError(
                path, f"line {line}", f"{len(cells)} cells, expected {len(rows[0])} as before"
            )
            if len(cells) > len(rows[0]):
                raise torn
            continue
        rows.append(cells)
        lines.append(line)
    if torn is not None:
        log.warning("%s; the last line is left out", torn)
    names = tuple(cell.strip() for cell in rows[0]) if rows and form.header else ()
    first = 1 if form.header else 0
    if len(rows) <= first:
        raise InputError(path, "", "has no rows of readings")
    return Log(path, names, rows[first:], lines[first:], form.decimal)


def chosen_rows(log: Log, rows: RowSelection) -> Log:
    """Return the rows that the mapping asks for.

    Raises
    ------
    InputError
        If there are none.
    """
    number = np.arange(1, len(log.rows) + 1)
    keep = (number >= rows.first) & (number <= (rows.last or len(log.rows)))
    if rows.only is not None:
        keep &= matching(log, rows.only)
    if not keep.any():
        raise InputError(log.path, "", "the mapping's [rows] selects no row")
    return log.take(keep)


def matching(log: Log, where: Where) -> BoolArray:
    """Return the rows that fulfil a condition, shape (n,)."""
    return log.matches(where.column, where.equals)


def _refuse_what_does_not_fit(path: Path, form: FileFormat) -> None:
    """Refuse a log that would need more memory than there is, by its size and its beginning."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(SAMPLE)
    except (OSError, ValueError):
        return  # told when it is read
    text = head.decode(form.encoding, errors="replace")
    lines = max(text.count("\n"), 1)
    cells = lines + text.count(form.delimiter)
    share = size / max(len(head), 1)
    needed = BYTES_A_BYTE * size + share * (BYTES_A_ROW * lines + BYTES_A_CELL * cells)
    what = (
        f"{size / 1e9:.3g} GB of log, some {share * lines:.3g} rows of {cells / lines:.3g} cells,"
    )
    memory.refuse_what_does_not_fit(path, needed, what)


def _text(path: Path, encoding: str) -> str:
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as err:
        raise InputError(path, "", f"cannot be read: {getattr(err, 'strerror', err)}") from None
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as err:
        line = data.count(b"\n", 0, err.start) + 1
        raise InputError(path, f"line {line}", f"is not {encoding} text") from None
    except UnicodeError as err:
        raise InputError(path, "", f"is not {encoding} text: {err}") from None


def _cells(path: Path, form: FileFormat) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of what is neither skipped, empty nor a comment."""
    _refuse_what_does_not_fit(path, form)
    text = io.StringIO(_text(path, form.encoding), newline=None)
    for number, line in enumerate(text, 1):
        if number <= form.skip_lines or not line.strip(" \n"):
            continue
        if form.comment and line.startswith(form.comment):
            continue
        if form.delimiter == " ":
            line = line.strip()
        try:
            cells = next(csv.reader([line], delimiter=form.delimiter, skipinitialspace=True))
        except csv.Error as err:
            raise InputError(path, f"line {number}", f"not CSV: {err}") from None
        yield number, cells
