"""Tables of numbers and texts in CSV and Parquet files, of a form that the caller states.

A sound CSV goes through pyarrow at some 10⁷ cells a second. Only when that stumbles is the file
read again, cell by cell, to find the line at fault (or to accept what pyarrow is too strict for).
"""

import csv
import io
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from errormodel.errors import InputError

log = logging.getLogger(__name__)
arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
arrow_parquet: Any = pyarrow.parquet
arrow_compute: Any = pyarrow.compute
ArrowError: type[Exception] = arrow.ArrowException

PIECE = 20_000  # lines
PARQUET_SUFFIXES = (".parquet", ".pq")
NUMERIC = ("integer", "floating", "decimal", "null")  # Parquet types that a number may have
NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableForm:
    """Which columns a table may have: of numbers, of texts, and those it must have."""

    numbers: tuple[str, ...]
    texts: tuple[str, ...] = ()
    required: tuple[str, ...] = ()

    @property
    def known(self) -> tuple[str, ...]:
        """All columns that are read; others are named in a warning."""
        return (*self.numbers, *self.texts)


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
    text: Mapping[str, tuple[NDArray[np.int64], tuple[str, ...]]]
    source: str
    place: Callable[[int], str]


def read_table(path: Path, form: TableForm) -> RawTable:
    """Read a table from CSV, or from Parquet when the name ends in .parquet or .pq.

    Raises
    ------
    InputError
        Naming the line at fault.
    """
    is_parquet = path.suffix.lower() in PARQUET_SUFFIXES
    return _read_parquet(path, form) if is_parquet else _read_csv(path, form)


def sidecar_path(path: Path | str) -> Path:
    """Return where the file is that says what a table's columns mean."""
    return Path(path).with_suffix(".toml")


def _read_csv(path: Path, form: TableForm) -> RawTable:
    text = _decoded(path)
    header_line, names = _header(path, text, form)
    present = _checked_columns(path, f"line {header_line}", names, form)

    def place(row: int) -> str:
        return f"line {_line_of_row(text, header_line, row)}"

    try:
        table = _parse_fast(text, header_line, names, present, form)
    except ArrowError:
        table = _parse_in_pieces(path, text, header_line, names, present, form)
    if table.num_rows == 0:
        raise InputError(path, "", "has a header and no readings")
    return _from_arrow(table, str(path), place, form)


def _read_parquet(path: Path, form: TableForm) -> RawTable:
    def place(row: int) -> str:
        return f"row {row + 1}"

    try:
        file = arrow_parquet.ParquetFile(path, page_checksum_verification=True)
        present = _checked_columns(path, "schema", file.schema_arrow.names, form)
        table = file.read(columns=present)
        columns = {name: _typed(table.column(name), name, form) for name in present}
    except (ArrowError, OSError, ValueError, KeyError) as err:
        reason = (str(err).splitlines() or ["unknown"])[0]
        raise InputError(path, "", f"not readable as Parquet: {reason:.200}") from None
    return _from_arrow(arrow.table(columns), str(path), place, form)


def _typed(column: Any, name: str, form: TableForm) -> Any:
    kind: Any = column.type
    if arrow.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if name in form.texts:
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


def _header(path: Path, text: str, form: TableForm) -> tuple[int, list[str]]:
    for number, line in _lines(text):
        if line.strip():
            try:
                return number, [name.strip() for name in next(csv.reader([line]))]
            except csv.Error as err:
                raise InputError(path, f"line {number}", f"not CSV: {err}") from None
    raise InputError(path, "", f"is empty, expected a header line {','.join(form.required)}")


def _checked_columns(path: Path, place: str, names: Sequence[str], form: TableForm) -> list[str]:
    missing = [name for name in form.required if name not in names]
    if missing:
        shown = " ".join(", ".join(names).split())[:120]
        other = next((d for d in (";", "\t", "|") if len(names) == 1 and d in names[0]), None)
        hint = f"; cells are separated by {other!r}, expected ','" if other else ""
        raise InputError(path, place, f"no column {', '.join(missing)} among: {shown}{hint}")
    twice = [name for name in form.known if list(names).count(name) > 1]
    if twice:
        raise InputError(path, place, f"column {twice[0]} stands twice")
    unknown = [name for name in names if name not in form.known]
    if unknown:
        log.warning("%s: columns not used: %.200s", path, ", ".join(unknown))
    return [name for name in form.known if name in names]


def _parse_fast(
    text: str, header_line: int, names: list[str], present: list[str], form: TableForm
) -> Any:
    unique = [name if name in present else f"\0{i}" for i, name in enumerate(names)]
    return arrow_csv.read_csv(
        arrow.BufferReader(text.encode()),
        read_options=arrow_csv.ReadOptions(
            column_names=unique, skip_rows=header_line, block_size=1 << 22
        ),
        convert_options=arrow_csv.ConvertOptions(
            include_columns=present,
            column_types={name: _kind(name, form) for name in present},
            null_values=[""],
            strings_can_be_null=False,
        ),
    )


def _from_arrow(table: Any, source: str, place: Callable[[int], str], form: TableForm) -> RawTable:
    text: dict[str, tuple[NDArray[np.int64], tuple[str, ...]]] = {}
    number: dict[str, NDArray[np.float64]] = {}
    for name in table.column_names:
        column: Any = table.column(name).combine_chunks()
        if name in form.numbers:
            number[name] = np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
        else:
            encoded = column.dictionary_encode()
            codes = encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)
            text[name] = (codes, tuple(encoded.dictionary.to_pylist()))
    return RawTable(number=number, text=text, source=source, place=place)


def _lines(text: str, after: int = 0) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that are not empty; a cell never reaches over two."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        if number > after and line != "\n":
            yield number, line


def _line_of_row(text: str, header_line: int, row: int) -> int:
    numbers = (number for number, _ in _lines(text, header_line))
    return next(islice(numbers, row, None), 0)


def _parse_in_pieces(
    path: Path,
    text: str,
    header_line: int,
    names: list[str],
    present: list[str],
    form: TableForm,
) -> Any:
    """Parse by pieces; only those that stumble are read cell by cell, up to the first fault."""
    lines, parts = _lines(text, header_line), list[Any]()
    while piece := list(islice(lines, PIECE)):
        try:
            parts.append(_parse_fast("".join(line for _, line in piece), 0, names, present, form))
        except ArrowError:
            parts.append(_parse_slowly(path, piece, names, present, form))
    if not parts:
        raise InputError(path, "", "has a header and no readings")
    return arrow.concat_tables(parts)


def _parse_slowly(
    path: Path,
    piece: list[tuple[int, str]],
    names: list[str],
    present: list[str],
    form: TableForm,
) -> Any:
    where = {name: names.index(name) for name in present}
    columns: dict[str, list[Any]] = {name: [] for name in present}
    for line, row in piece:
        cells = _cells(path, line, row, len(names))
        for name, values in columns.items():
            cell = cells[where[name]]
            values.append(_number(path, line, name, cell) if name in form.numbers else cell)
    return arrow.table(
        {name: arrow.array(v, type=_kind(name, form)) for name, v in columns.items()}
    )


def _kind(name: str, form: TableForm) -> Any:
    return arrow.float64() if name in form.numbers else arrow.string()


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
