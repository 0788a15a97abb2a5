"""Writing recorded runs: whole or not at all, and exact to the last bit."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from errormodel.io.table_write import write_with_sidecar
from errormodel.io.toml_write import Plain, toml_text
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
    mounted: dict[str, dict[str, float]] = {}
    for (run, serial), angle in mount_deg.items():
        mounted.setdefault(run, {})[serial] = angle
    errors = {n: v for n in ("temp_sigma_c", "temp_gain_ppm") if (v := getattr(scale, n))}
    data: dict[str, Plain] = {
        "output_unit": scale.output_unit,
        "gravity_m_s2": scale.gravity_m_s2,
        "nominal_scale": scale.nominal_scale,
        **errors,
    }
    if run_start_utc:
        data["run_start_utc"] = {run: t.isoformat() for run, t in run_start_utc.items()}
    if mounted:
        data["mount_deg"] = mounted
    return toml_text(data)
