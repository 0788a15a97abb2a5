"""Columns of a plain delimited log: numbers between commas, semicolons, tabs or blanks."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.io.tables import NUMBER
from errormodel.io.toml import read_text

DELIMITERS = (";", "\t", ",")


def read_plain_log(path: Path | str, columns: Sequence[str]) -> FloatArray:
    """Read some columns of a log.

    Empty lines and lines that begin with # are passed over; a first line that is not numbers is a
    header.

    Parameters
    ----------
    path : path
    columns : sequence of str
        Numbers from 1, or names of the header.

    Returns
    -------
    ndarray, shape (n, len(columns))

    Raises
    ------
    InputError
        Naming the line, when a column is not there or a cell is not a finite number.
    """
    lines = [
        (k, line)
        for k, line in enumerate(read_text(path).splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(path, "", "is empty, expected rows of numbers")
    delimiter = next((d for d in DELIMITERS if d in lines[0][1]), None)
    first = _cells(lines[0][1], delimiter)
    header = first if not all(NUMBER.fullmatch(cell) for cell in first) else []
    at = [_place(path, lines[0][0], name, header, len(first)) for name in columns]
    rows = lines[1:] if header else lines
    values = np.empty((len(rows), len(at)))
    for k, (number, line) in enumerate(rows):
        cells = _cells(line, delimiter)
        if len(cells) != len(first):
            raise InputError(
                path, f"line {number}", f"{len(cells)} cells, expected {len(first)} as before"
            )
        for j, place in enumerate(at):
            value = float(cells[place]) if NUMBER.fullmatch(cells[place]) else np.nan
            if not np.isfinite(value):
                raise InputError(
                    path,
                    f"line {number}",
                    f"column {columns[j]} is {cells[place]!r:.60}, expected a finite number",
                )
            values[k, j] = value
    return values


def step_of(time_s: FloatArray, source: str) -> float:
    """Return the usual step of a time column, s.

    Raises
    ------
    InputError
        If times do not increase.
    """
    steps = np.diff(time_s)
    if steps.size == 0 or not np.all(steps > 0):
        row = int(np.argmax(steps <= 0)) + 2 if steps.size else 1
        raise InputError(source, f"row {row}", "expected times that increase")
    return float(np.median(steps))


def _cells(line: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def _place(path: Path | str, line: int, name: str, header: list[str], width: int) -> int:
    if name in header:
        return header.index(name)
    if name.isascii() and name.isdigit() and 1 <= int(name) <= width:
        return int(name) - 1
    there = f"the header's {', '.join(header)}" if header else "no header"
    raise InputError(
        path, f"line {line}", f"no column {name!r:.60}, expected 1 to {width}, or {there:.200}"
    )
