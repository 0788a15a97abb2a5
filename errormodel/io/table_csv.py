"""CSV files read in pieces: fast where they are sound, cell by cell where they are not.

A sound CSV goes through pyarrow at some 10⁷ cells a second. Only when that stumbles is the file
read again, line by line, to find the line at fault (or to accept what pyarrow is too strict for).
"""

import codecs
import csv
import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.csv

from errormodel.errors import InputError
from errormodel.io import memory
from errormodel.io.table_columns import GrowingTable, RawTable, TableForm
from errormodel.io.text_cells import text_of_cell

log = logging.getLogger(__name__)
arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
ArrowError: type[Exception] = arrow.ArrowException

PIECE = 20_000  # lines
BLOCK_BYTES = 1 << 20  # parsed at a time
LONGEST_HEADER = 1 << 20  # characters
LONGEST_LINE = 1 << 24
SAMPLE_BYTES = 1 << 16  # enough lines to tell how long a row is
NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Header:
    """Header of a file: its line, its columns, and those of them that are read."""

    line: int
    names: list[str]
    present: list[str]


def read_csv(path: Path, form: TableForm) -> RawTable:
    """Read a table from CSV.

    Raises
    ------
    InputError
        Naming the line at fault, or how much memory the table would need.
    """
    line, names = _header(path, form)
    header = _Header(
        line=line, names=names, present=checked_columns(path, f"line {line}", names, form)
    )
    rows = _fitting_rows(path, header, form)
    _check_encoding(path)
    try:
        table = _put_together(_fast_pieces(path, header, form), header, form, rows)
    except ArrowError:
        table = _put_together(_careful_pieces(path, header, form), header, form, rows)
    if table.rows == 0:
        raise InputError(path, "", "has a header and no readings")
    return table.finish(str(path), lambda row: f"line {_line_of_row(path, line, row)}")


def csv_names(path: Path) -> list[str]:
    """Return the names in a CSV file's header line; InputError when there is none."""
    return _header(path, TableForm(numbers=()))[1]


def _put_together(
    pieces: Iterator[Any], header: _Header, form: TableForm, rows: int
) -> GrowingTable:
    table = GrowingTable(header.present, form, rows, text_of_cell)
    for piece in pieces:
        table.add(piece)
    return table


def _unreadable(path: Path, err: Exception) -> InputError:
    reason = getattr(err, "strerror", None) or str(err)
    return InputError(path, "", f"cannot be read: {reason}")


def _check_encoding(path: Path) -> None:
    decoder, line = codecs.getincrementaldecoder("utf-8")(), 1
    try:
        with path.open("rb") as file:
            while data := file.read(BLOCK_BYTES):
                pending = len(decoder.getstate()[0])
                try:
                    decoder.decode(data)
                except UnicodeDecodeError as err:
                    line += data.count(b"\n", 0, max(err.start - pending, 0))
                    raise InputError(path, f"line {line}", "is not UTF-8 text") from None
                line += data.count(b"\n")
            decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        raise InputError(path, f"line {line}", "is not UTF-8 text") from None
    except (OSError, ValueError) as err:
        raise _unreadable(path, err) from None


def _header(path: Path, form: TableForm) -> tuple[int, list[str]]:
    number = 0
    for number, line in _all_lines(path, LONGEST_HEADER):
        if line.strip():
            try:
                return number, [name.strip() for name in next(csv.reader([line]))]
            except csv.Error as err:
                raise InputError(path, f"line {number}", f"not CSV: {err}") from None
    raise InputError(path, "", f"is empty, expected a header line {','.join(form.required)}")


def checked_columns(path: Path, place: str, names: Sequence[str], form: TableForm) -> list[str]:
    """Return the columns to read; refuse a table that lacks some or has one twice."""
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


def _fitting_rows(path: Path, header: _Header, form: TableForm) -> int:
    """Return about how many rows a file has; refuse more than the memory holds.

    By the file's size and the length of its first rows.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            sample = file.read(SAMPLE_BYTES)
    except (OSError, ValueError) as err:
        raise _unreadable(path, err) from None
    lines = sample.count(b"\n") or sample.count(b"\r")
    rows = round(size / len(sample) * max(lines, 1)) if len(sample) < size else lines
    memory.refuse_what_does_not_fit(
        path,
        memory.FACTOR * rows * form.row_bytes(header.present),
        f"about {rows} rows of {len(header.present)} columns",
    )
    return rows


def _fast_pieces(path: Path, header: _Header, form: TableForm) -> Iterator[Any]:
    """Yield a file's rows as arrow has them; it raises an ArrowError when it stumbles."""
    reader = arrow_csv.open_csv(path, **_fast_options(header, form, skipped=header.line))
    while True:
        try:
            yield reader.read_next_batch()
        except StopIteration:
            return


def _fast_options(header: _Header, form: TableForm, *, skipped: int) -> dict[str, Any]:
    unique = [n if n in header.present else f"\0{i}" for i, n in enumerate(header.names)]
    return {
        "read_options": arrow_csv.ReadOptions(
            column_names=unique, skip_rows=skipped, block_size=BLOCK_BYTES
        ),
        "convert_options": arrow_csv.ConvertOptions(
            include_columns=header.present,
            column_types={name: _kind(name, form) for name in header.present},
            null_values=[""],
            strings_can_be_null=False,
        ),
    }


def _all_lines(path: Path, longest: int) -> Iterator[tuple[int, str]]:
    """Yield number and text of every line, whatever its ending; a cell never reaches over two."""
    try:
        with path.open(encoding="utf-8-sig", newline=None) as file:
            number = 0
            while line := file.readline(longest + 1):
                number += 1
                if len(line) > longest:
                    problem = f"is longer than {longest} characters"
                    raise InputError(path, f"line {number}", problem)
                yield number, line
    except UnicodeDecodeError as err:
        _check_encoding(path)  # it names the line
        raise _unreadable(path, err) from None
    except (OSError, ValueError) as err:
        raise _unreadable(path, err) from None


def _lines(path: Path, after: int) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that are not empty."""
    for number, line in _all_lines(path, LONGEST_LINE):
        if number > after and line != "\n":
            yield number, line


def _line_of_row(path: Path, header_line: int, row: int) -> int:
    numbers = (number for number, _ in _lines(path, header_line))
    return next(islice(numbers, row, None), 0)


def _careful_pieces(path: Path, header: _Header, form: TableForm) -> Iterator[Any]:
    """Parse by pieces; only those that stumble are read cell by cell, up to the first fault."""
    lines = _lines(path, header.line)
    options = _fast_options(header, form, skipped=0)
    while piece := list(islice(lines, PIECE)):
        text = "".join(line for _, line in piece)
        try:
            yield arrow_csv.read_csv(arrow.BufferReader(text.encode()), **options)
        except ArrowError:
            yield _parse_slowly(path, piece, header.names, header.present, form)


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
