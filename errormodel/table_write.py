"""Writing tables to CSV and Parquet, exact to the last bit."""

from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from errormodel.atomic import written_together
from errormodel.errors import InputError
from errormodel.tables import PARQUET_SUFFIXES, sidecar_path

arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
arrow_parquet: Any = pyarrow.parquet


def write_with_sidecar(frame: pd.DataFrame, sidecar: str, path: Path) -> None:
    """Write a table to CSV or Parquet, by the path's suffix, and the text of its sidecar.

    Either file is complete or as it was before: it is written aside, flushed to the disk and
    renamed. NaN becomes an empty cell.

    Raises
    ------
    InputError
        If the suffix is another or a file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in {".csv", *PARQUET_SUFFIXES}:
        raise InputError(path, "", "expected a name ending in .csv or .parquet")
    table = arrow.Table.from_pandas(frame, preserve_index=False)
    with written_together([path, sidecar_path(path)]) as (draft, side_draft):
        if suffix == ".csv":
            _write_csv(table, frame, draft)
        else:
            arrow_parquet.write_table(table, draft, write_page_checksum=True)
        side_draft.write_text(sidecar, encoding="utf-8")


def _write_csv(table: Any, frame: pd.DataFrame, path: Path) -> None:
    texts = [name for name in frame.columns if not pd.api.types.is_numeric_dtype(frame[name])]
    special = any(set(str(v)) & set(',"\r\n') for name in texts for v in frame[name].unique())
    style = "needed" if special else "none"  # "needed" puts every text between quotes
    options = arrow_csv.WriteOptions(include_header=False, quoting_style=style)
    with path.open("wb") as file:
        file.write((",".join(str(name) for name in frame.columns) + "\n").encode())
        arrow_csv.write_csv(table, file, options)
