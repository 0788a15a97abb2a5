"""Recorded-run tables from CSV and Parquet files.

A sound CSV goes through pyarrow at some 10⁷ cells a second. Only when that stumbles is the file
read again, cell by cell, to find the line at fault (or to accept what pyarrow is too strict for).
"""

import csv
import io
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet

from errormodel.errors import InputError
from thermo.recording_check import Table
from thermo.recording_model import COLUMNS, NUMBERS, REQUIRED, FloatArray, Labels

log = logging.getLogger(__name__)
arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
arrow_parquet: Any = pyarrow.parquet
arrow_compute: Any = pyarrow.compute
ArrowError: type[Exception] = arrow.ArrowException

PIECE = 20_000  # lines
TEXTS = ("run", "serial", "flag")
KNOWN = (*COLUMNS, "flag")
NUMERIC = ("integer", "floating", "decimal", "null")  # Parquet types that a number may have
NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


def read_csv_table(path: Path) -> Table:
    """Read a recorded-run CSV.

    Raises
    ------
    InputError
        Naming the line at fault.
    """
    text = _decoded(path)
    header_line, names = _header(path, text)
    present = _checked_columns(path, f"line {header_line}", names)

    def place(row: int) -> str:
        return f"line {_line_of_row(text, header_line, row)}"

    try:
        table = _parse_fast(text, header_line, names, present)
    except ArrowError:
        table = _parse_in_pieces(path, text, header_line, names, present)
    if table.num_rows == 0:
        raise InputError(path, "", "has a header and no readings")
    return _from_arrow(table, str(path), place)


def read_parquet_table(path: Path) -> Table:
    """Read a recorded run from Parquet.

    Raises
    ------
    InputError
        If the file is damaged or a column has another type.
    """

    def place(row: int) -> str:
        return f"row {row + 1}"

    try:
        file = arrow_parquet.ParquetFile(path, page_checksum_verification=True)
        present = _checked_columns(path, "schema", file.schema_arrow.names)
        table = file.read(columns=present)
        columns = {name: _typed(table.column(name), name) for name in present}
    except (ArrowError, OSError, ValueError, KeyError) as err:
        reason = (str(err).splitlines() or ["unknown"])[0]
        raise InputError(path, "", f"not readable as Parquet: {reason:.200}") from None
    return _from_arrow(arrow.table(columns), str(path), place)


def _typed(column: Any, name: str) -> Any:
    kind: Any = column.type
    if arrow.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if name in TEXTS:
        if arrow.types.is_floating(kind):  # what pandas makes of integers with gaps
            column = column.cast(arrow.int64())
        column = arrow_compute.fill_null(column.cast(arrow.string()), "")
    elif any(getattr(arrow.types, f"is_{k}")(kind) for k in NUMERIC):
        column = column.cast(arrow.float64())
    else:
        raise ValueError(f"column {name} holds {kind}, expected numbers")
    return column


def _decoded(path: Path) -> str:
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as err:
        reason = getattr(err, "strerror", None) or str(err)
        raise InputError(path, "", f"cannot be read: {reason}") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as err:
        line = data.count(b"\n", 0, err.start) + 1
        raise InputError(path, f"line {line}", "is not UTF-8 text") from None


def _header(path: Path, text: str) -> tuple[int, list[str]]:
    for number, line in _lines(text):
        if line.strip():
            try:
                return number, [name.strip() for name in next(csv.reader([line]))]
            except csv.Error as err:
                raise InputError(path, f"line {number}", f"not CSV: {err}") from None
    raise InputError(path, "", f"is empty, expected a header line {','.join(REQUIRED)}")


def _checked_columns(path: Path, place: str, names: Sequence[str]) -> list[str]:
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        shown = " ".join(", ".join(names).split())[:120]
        other = next((d for d in (";", "\t", "|") if len(names) == 1 and d in names[0]), None)
        hint = f"; cells are separated by {other!r}, expected ','" if other else ""
        raise InputError(path, place, f"no column {', '.join(missing)} among: {shown}{hint}")
    twice = [name for name in KNOWN if list(names).count(name) > 1]
    if twice:
        raise InputError(path, place, f"column {twice[0]} stands twice")
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        log.warning("%s: columns not used: %.200s", path, ", ".join(unknown))
    return [name for name in KNOWN if name in names]


def _parse_fast(text: str, header_line: int, names: list[str], present: list[str]) -> Any:
    unique = [name if name in present else f"\0{i}" for i, name in enumerate(names)]
    return arrow_csv.read_csv(
        arrow.BufferReader(text.encode()),
        read_options=arrow_csv.ReadOptions(
            column_names=unique, skip_rows=header_line, block_size=1 << 22
        ),
        convert_options=arrow_csv.ConvertOptions(
            include_columns=present,
            column_types={name: _kind(name) for name in present},
            null_values=[""],
            strings_can_be_null=False,
        ),
    )


def _from_arrow(table: Any, source: str, place: Callable[[int], str]) -> Table:
    text: dict[str, Labels] = {}
    number: dict[str, FloatArray] = {}
    for name in table.column_names:
        column: Any = table.column(name).combine_chunks()
        if name in NUMBERS:
            number[name] = np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
        else:
            encoded = column.dictionary_encode()
            codes = encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)
            text[name] = Labels(codes, tuple(encoded.dictionary.to_pylist()))
    return Table(text, number, source, place)


def _lines(text: str, after: int = 0) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that are not empty; a cell never reaches over two."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        if number > after and line != "\n":
            yield number, line


def _line_of_row(text: str, header_line: int, row: int) -> int:
    numbers = (number for number, _ in _lines(text, header_line))
    return next(islice(numbers, row, None), 0)


def _parse_in_pieces(
    path: Path, text: str, header_line: int, names: list[str], present: list[str]
) -> Any:
    """Parse by pieces; only those that stumble are read cell by cell, up to the first fault."""
    lines, parts = _lines(text, header_line), list[Any]()
    while piece := list(islice(lines, PIECE)):
        try:
            parts.append(_parse_fast("".join(line for _, line in piece), 0, names, present))
        except ArrowError:
            parts.append(_parse_slowly(path, piece, names, present))
    if not parts:
        raise InputError(path, "", "has a header and no readings")
    return arrow.concat_tables(parts)


def _parse_slowly(
    path: Path, piece: list[tuple[int, str]], names: list[str], present: list[str]
) -> Any:
    where = {name: names.index(name) for name in present}
    columns: dict[str, list[Any]] = {name: [] for name in present}
    for line, row in piece:
        cells = _cells(path, line, row, len(names))
        for name, values in columns.items():
            cell = cells[where[name]]
            values.append(_number(path, line, name, cell) if name in NUMBERS else cell)
    return arrow.table({name: arrow.array(v, type=_kind(name)) for name, v in columns.items()})


def _kind(name: str) -> Any:
    return arrow.float64() if name in NUMBERS else arrow.string()


def _cells(path: Path, line: int, row: str, expected: int) -> list[str]:
    try:
        cells = next(csv.reader([row]))
    except csv.Error as err:
        raise InputError(path, f"line {line}", f"not CSV: {err}") from None
    if len(cells) != expected:
        raise InputError(
            path, f"line {line}", f"{len(cells)} cells, expected {expected} as in the header"
        )
    return cells


def _number(path: Path, line: int, name: str, cell: str) -> float:
    cell = cell.strip()
    if not cell:
        return float("nan")
    if not NUMBER.fullmatch(cell):
        raise InputError(path, f"line {line}", f"{name} {cell!r:.60}, expected a number")
    return float(cell)
