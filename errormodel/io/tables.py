"""Tables of numbers and texts in CSV and Parquet files, of a form that the caller states.

They are read in pieces, and refused before reading when they would not fit into the memory.
"""

from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.compute
import pyarrow.parquet

from errormodel.errors import InputError
from errormodel.io import memory
from errormodel.io.table_columns import GrowingTable, RawTable, TableForm
from errormodel.io.table_csv import NUMBER, checked_columns, csv_names, read_csv

__all__ = [
    "NUMBER",
    "PARQUET_SUFFIXES",
    "TABLE_SUFFIXES",
    "RawTable",
    "TableForm",
    "column_names",
    "read_table",
    "sidecar_path",
]

arrow: Any = pyarrow  # it has no types
arrow_parquet: Any = pyarrow.parquet
arrow_compute: Any = pyarrow.compute
ArrowError: type[Exception] = arrow.ArrowException

BATCH = 1 << 16  # rows of Parquet at a time
PARQUET_SUFFIXES = (".parquet", ".pq")
TABLE_SUFFIXES = (".csv", *PARQUET_SUFFIXES)  # of the tables that the program writes
NUMERIC = ("integer", "floating", "decimal", "null")  # Parquet types that a number may have


def read_table(path: Path, form: TableForm) -> RawTable:
    """Read a table from CSV, or from Parquet when the name ends in .parquet or .pq.

    Raises
    ------
    InputError
        Naming the line at fault, or how much memory the table would need.
    """
    return _read_parquet(path, form) if _is_parquet(path) else read_csv(path, form)


def column_names(path: Path) -> list[str]:
    """Return the names of a table's columns; nothing else of it is read.

    Raises
    ------
    InputError
        If the file has none.
    """
    if not _is_parquet(path):
        return csv_names(path)
    try:
        return list(arrow_parquet.read_schema(path).names)
    except (ArrowError, OSError, ValueError) as err:
        raise _unreadable(path, err) from None


def sidecar_path(path: Path | str) -> Path:
    """Return where the file is that says what a table's columns mean."""
    table = Path(path)
    return table.parent / f"{table.stem}.toml"  # "." too has one, that is not there


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() in PARQUET_SUFFIXES


def _unreadable(path: Path, err: Exception) -> InputError:
    reason = (str(err).splitlines() or ["unknown"])[0]
    return InputError(path, "", f"not readable as Parquet: {reason:.200}")


def _read_parquet(path: Path, form: TableForm) -> RawTable:
    try:
        return _parquet_in_batches(path, form)
    except (ArrowError, OSError, ValueError, KeyError) as err:
        raise _unreadable(path, err) from None


def _parquet_in_batches(path: Path, form: TableForm) -> RawTable:
    with arrow_parquet.ParquetFile(path) as file:
        schema = file.schema_arrow
        present = checked_columns(path, "schema", schema.names, form)
        rows = file.metadata.num_rows
        memory.refuse_what_does_not_fit(
            path,
            memory.FACTOR * rows * form.row_bytes(present),
            f"{rows} rows of {len(present)} columns",
        )
        # a text that is stored once for many rows stays so
        encoded = [n for n in present if n in form.texts and _is_text(schema.field(n).type)]
    table = GrowingTable(present, form, rows)
    with arrow_parquet.ParquetFile(
        path, page_checksum_verification=True, read_dictionary=encoded
    ) as file:
        for batch in file.iter_batches(batch_size=BATCH, columns=present):
            columns = {name: _typed(batch.column(name), name, form) for name in present}
            table.add(arrow.table(columns))
    return table.finish(str(path), lambda row: f"row {row + 1}")


def _is_text(kind: Any) -> bool:
    return arrow.types.is_string(kind) or arrow.types.is_binary(kind)


def _typed(column: Any, name: str, form: TableForm) -> Any:
    kind: Any = column.type
    if name in form.texts and arrow.types.is_dictionary(kind) and kind.value_type == arrow.string():
        return column
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
