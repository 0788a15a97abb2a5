"""Writing recorded runs: whole or not at all, and exact to the last bit."""

import os
import secrets
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import pandas as pd
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from errormodel.errors import InputError
from thermo.recording_model import RecordedRuns

arrow: Any = pyarrow  # it has no types
arrow_csv: Any = pyarrow.csv
arrow_parquet: Any = pyarrow.parquet


def write_runs(record: RecordedRuns, path: Path | str) -> None:
    """Write a record to CSV or Parquet, by the path's suffix, and its sidecar NAME.toml.

    Numbers come back bit for bit. Either file is complete or as it was before: it is written
    aside, flushed to the disk and renamed.

    Raises
    ------
    InputError
        If the suffix is another, the units in the record differ, or the file cannot be written.
    """
    path = Path(path)
    writer = {".csv": _write_csv, ".parquet": _write_parquet, ".pq": _write_parquet}.get(
        path.suffix.lower()
    )
    if writer is None:
        raise InputError(path, "", "expected a name ending in .csv or .parquet")
    sidecar = _sidecar_text(record)
    frame = record.frame()
    try:
        with ExitStack() as pending:
            data_file = _aside(path, pending, lambda file: writer(frame, file))
            side_file = _aside(
                sidecar_path(path), pending, lambda file: _write_bytes(sidecar.encode(), file)
            )
            os.replace(data_file, path)
            os.replace(side_file, sidecar_path(path))
    except OSError as err:
        raise InputError(path, "", f"cannot be written: {err.strerror or err}") from None


def sidecar_path(path: Path | str) -> Path:
    """Return where the sidecar of a recorded run is."""
    return Path(path).with_suffix(".toml")


def _sidecar_text(record: RecordedRuns) -> str:
    lines = [
        f"output_unit = {_quoted(record.output_unit)}",
        f"gravity_m_s2 = {record.gravity_m_s2!r}",
        f"nominal_scale = {record.nominal_scale!r}",
    ]
    if record.run_start_utc:
        lines += ["", "[run_start_utc]"]
        lines += [
            f"{_quoted(r)} = {_quoted(t.isoformat())}" for r, t in record.run_start_utc.items()
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return (
        '"'
        + "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c for c in escaped)
        + '"'
    )


def _write_bytes(data: bytes, file: IO[bytes]) -> None:
    file.write(data)


def _aside(path: Path, pending: ExitStack, write: Callable[[IO[bytes]], None]) -> Path:
    """Write a file next to where it shall be; it vanishes unless it is renamed."""
    aside = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    pending.callback(lambda: aside.unlink(missing_ok=True))
    with open(aside, "xb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())
    return aside


def _write_csv(frame: pd.DataFrame, file: IO[bytes]) -> None:
    table = arrow.Table.from_pandas(frame, preserve_index=False)  # NaN becomes an empty cell
    texts = [name for name in ("run", "serial", "flag") if name in frame.columns]
    special = any(set(str(v)) & set(',"\r\n') for name in texts for v in frame[name].unique())
    file.write((",".join(frame.columns) + "\n").encode())
    style = "needed" if special else "none"  # "needed" puts every text between quotes
    options = arrow_csv.WriteOptions(include_header=False, quoting_style=style)
    arrow_csv.write_csv(table, file, options)


def _write_parquet(frame: pd.DataFrame, file: IO[bytes]) -> None:
    table = arrow.Table.from_pandas(frame, preserve_index=False)
    arrow_parquet.write_table(table, file, write_page_checksum=True)
