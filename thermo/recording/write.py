"""Writing recorded runs: whole or not at all, and exact to the last bit."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from errormodel.io.table_write import write_with_sidecar
from thermo.recording.output_scale import OutputScale
from thermo.recording.runs import PIECE, RecordedRuns


def write_runs(record: RecordedRuns, path: Path | str) -> None:
    """Write a record to CSV or Parquet, by the path's suffix, and its sidecar NAME.toml.

    Numbers come back bit for bit. Either file is complete or as it was before: it is written
    aside, flushed to the disk and renamed.

    Raises
    ------
    InputError
        If the suffix is another, the units in the record differ, or the file cannot be written.
    """
    names = record.columns_in_use()
    begins = range(0, len(record), PIECE)
    pieces = (record.frame_of(slice(k, k + PIECE), names) for k in begins)
    write_with_sidecar(pieces, sidecar_text(record), Path(path))


def sidecar_text(record: RecordedRuns) -> str:
    """Return what stands in a record's sidecar.

    Raises
    ------
    InputError
        If the units in the record differ.
    """
    return sidecar_of(record.output_scale, record.run_start_utc, record.mount_deg)


def sidecar_of(
    scale: OutputScale,
    run_start_utc: Mapping[str, datetime],
    mount_deg: Mapping[tuple[str, str], float],
) -> str:
    """Return what stands in a sidecar; mountings by (run, serial)."""
    lines = [
        f"output_unit = {_quoted(scale.output_unit)}",
        f"gravity_m_s2 = {scale.gravity_m_s2!r}",
        f"nominal_scale = {scale.nominal_scale!r}",
    ]
    for name in ("temp_sigma_c", "temp_gain_ppm"):
        value = getattr(scale, name)
        lines += [f"{name} = {value!r}"] if value else []
    if run_start_utc:
        lines += ["", "[run_start_utc]"]
        lines += [f"{_quoted(r)} = {_quoted(t.isoformat())}" for r, t in run_start_utc.items()]
    for run in dict.fromkeys(run for run, _ in mount_deg):
        of_run = {s: angle for (r, s), angle in mount_deg.items() if r == run}
        lines += ["", f"[mount_deg.{_quoted(run)}]"]
        lines += [f"{_quoted(serial)} = {angle!r}" for serial, angle in of_run.items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return (
        '"'
        + "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c for c in escaped)
        + '"'
    )
