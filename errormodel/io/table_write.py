"""Writing tables to CSV and Parquet, exact to the last bit."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from errormodel.errors import InputError
from errormodel.io.atomic import written_together
from errormodel.io.tables import PARQUET_SUFFIXES, TABLE_SUFFIXES, sidecar_path
from errormodel.io.text_cells import cell_of_text

arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
arrow_parquet: Any = pyarrow.parquet


def write_with_sidecar(
    frame: pd.DataFrame | Iterable[pd.DataFrame], sidecar: str, path: Path
) -> None:
    """Write a table to CSV or Parquet, by the path's suffix, and the text of its sidecar.

    Either file is complete or as it was before: it is written aside, flushed to the disk and
    renamed. NaN becomes an empty cell; a text that a spreadsheet would take for a formula gets
    an apostrophe in CSV (`errormodel.io.text_cells`).

    Parameters
    ----------
    frame : DataFrame or iterable of DataFrame
        The table, or its pieces one below the other, of the same columns; at least one.
    sidecar : str
    path : Path

    Raises
    ------
    InputError
        If the suffix is another or a file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in TABLE_SUFFIXES:
        raise InputError(path, "", "expected a name ending in .csv or .parquet")
    pieces = iter([frame] if isinstance(frame, pd.DataFrame) else frame)
    with written_together([path, sidecar_path(path)]) as (draft, side_draft):
        (_write_parquet if suffix in PARQUET_SUFFIXES else _write_csv)(pieces, draft)
        side_draft.write_text(sidecar, encoding="utf-8")


def _write_parquet(pieces: Iterator[pd.DataFrame], path: Path) -> None:
    first = arrow.Table.from_pandas(next(pieces), preserve_index=False)
    with arrow_parquet.ParquetWriter(path, first.schema, write_page_checksum=True) as writer:
        writer.write_table(first)
        for piece in pieces:
            writer.write_table(arrow.Table.from_pandas(piece, first.schema, preserve_index=False))


def _write_csv(pieces: Iterator[pd.DataFrame], path: Path) -> None:
    with path.open("wb") as file:
        for number, piece in enumerate(pieces):
            if number == 0:
                file.write((",".join(str(name) for name in piece.columns) + "\n").encode())
            table, special = _cells(piece)
            style = "needed" if special else "none"  # "needed" puts every text between quotes
            options = arrow_csv.WriteOptions(include_header=False, quoting_style=style)
            arrow_csv.write_csv(table, file, options)


def _cells(frame: pd.DataFrame) -> tuple[Any, bool]:
    """Return a table with its texts as they go into cells, and whether one needs quotes."""
    changed: dict[str, Any] = {}
    special = False
    for name in frame.columns:
        if pd.api.types.is_numeric_dtype(frame[name]):
            continue
        cells = {text: cell_of_text(str(text)) for text in frame[name].unique()}
        special = special or any(set(cell) & set(',"\r\n') for cell in cells.values())
        if any(str(text) != cell for text, cell in cells.items()):
            changed[name] = frame[name].map(cells)
    return arrow.Table.from_pandas(frame.assign(**changed), preserve_index=False), special
