"""Recorded chamber runs: the files, their sidecars, and the record they become.

`read_runs` and `write_runs` are the file format of a run; `make_runs` makes a record of a table
that is already in memory, checked in the same way.
"""

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from errormodel.arrays import constant
from errormodel.errors import InputError
from errormodel.io.tables import TableForm, read_table, sidecar_path
from errormodel.io.toml import check, read_toml
from thermo.recording.check import Table, build
from thermo.recording.copies import refuse_copies
from thermo.recording.further_columns import further_columns
from thermo.recording.labels import FloatArray, pair_keys
from thermo.recording.readings_check import flag_readings
from thermo.recording.runs import (
    REQUIRED,
    Labels,
    OutputScale,
    OutputUnit,
    RecordedRuns,
    number_columns,
)
from thermo.recording.signals import signals, using_signals
from thermo.recording.units_check import checked_units
from thermo.recording.write import write_runs

__all__ = [
    "OutputScale",
    "RecordedRuns",
    "Sidecar",
    "join_runs",
    "make_runs",
    "read_runs",
    "sidecar_path",
    "write_runs",
]

TEXTS = ("run", "serial", "flag")


def _instant(value: object) -> datetime:
    if isinstance(value, str):
        value = datetime.fromisoformat(value)  # its ValueError says what is wrong
    if not isinstance(value, datetime):
        if isinstance(value, date):
            value = datetime(value.year, value.month, value.day)
        else:
            raise ValueError("expected a time like 2026-11-22T22:15:00Z")
    try:
        return value.replace(tzinfo=value.tzinfo or UTC).astimezone(UTC)
    except OverflowError:
        raise ValueError("the time is out of range") from None


Instant = Annotated[datetime, BeforeValidator(_instant)]


MountAngle = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False, strict=True)]


class Sidecar(BaseModel):
    """Sidecar of a recorded run: what its outputs are measured in.

    `nominal_scale` is in output units per g; a negative one is a reversed polarity. `mount_deg`
    says by run and serial how far an accelerometer was mounted turned on the head. `temp_sigma_c`
    and `temp_gain_ppm` are what the thermistors may be wrong by, 1 sigma: an offset, and a gain
    about 0 °C.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    output_unit: OutputUnit
    gravity_m_s2: Annotated[float, Field(gt=9.7, lt=9.9)]
    nominal_scale: Annotated[float, Field(allow_inf_nan=False, strict=True)]
    run_start_utc: dict[str, Instant] = {}
    mount_deg: dict[str, dict[str, MountAngle]] = {}
    temp_sigma_c: Annotated[float, Field(ge=0, le=50, allow_inf_nan=False)] = 0.0
    temp_gain_ppm: Annotated[float, Field(ge=0, le=100_000, allow_inf_nan=False)] = 0.0

    @field_validator("nominal_scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("must not be 0")
        return value

    @property
    def scale(self) -> OutputScale:
        """The same without the times."""
        return OutputScale(
            output_unit=self.output_unit,
            gravity_m_s2=self.gravity_m_s2,
            nominal_scale=self.nominal_scale,
            temp_sigma_c=self.temp_sigma_c,
            temp_gain_ppm=self.temp_gain_ppm,
        )


def read_runs(
    paths: Sequence[Path | str],
    *,
    checked: bool = True,
    trust_units: bool = False,
    more_columns: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> RecordedRuns:
    """Read recorded runs from CSV or Parquet files (`*.parquet`, `*.pq`) and join them.

    Each file has its sidecar NAME.toml beside it; unit, gravity and scale may differ from file to
    file. A run may be continued in another file, but not with the same readings.

    Parameters
    ----------
    paths : sequence of path
        The files, in any order.
    checked : bool
        Whether readings, units and copies are judged; False gives what the files hold.
    trust_units : bool
        Whether units and signs are taken as stated, however unlikely.
    more_columns : bool
        Whether columns of one's own that no library declares are read as well
        (`thermo.recording.further_columns`): `discrepancy` holds the residual against them.
    tell : callable
        Told in a line which they are.

    Returns
    -------
    RecordedRuns
        The readings in the order of the files; an accelerometer's run that is spread over files
        is in order of time. Readings that cannot be true have a flag
        (`thermo.recording.readings_check.flag_readings`).

    Raises
    ------
    InputError
        Naming file and line of the first fault; also where the units are doubtful
        (`thermo.recording.units_check.checked_units`), and where two runs hold the same readings.
    """
    if not paths:
        raise InputError("recorded runs", "", "no file given, expected at least one")
    if more_columns:
        with using_signals((*signals(), *further_columns(paths, tell))):
            return read_runs(paths, checked=checked, trust_units=trust_units)
    record = join_runs([_read_one(Path(path), checked=checked) for path in paths])
    if not checked:
        return record
    refuse_copies(record)
    if not trust_units:
        checked_units(record, trust_units=False)
    return record


def make_runs(
    frame: pd.DataFrame,
    *,
    output_unit: OutputUnit,
    gravity_m_s2: float,
    nominal_scale: float,
    run_start_utc: Mapping[str, datetime] | None = None,
    mount_deg: Mapping[str, Mapping[str, float]] | None = None,
    temp_sigma_c: float = 0.0,
    temp_gain_ppm: float = 0.0,
    source: str = "the record",
    place: Callable[[int], str] | None = None,
) -> RecordedRuns:
    """Make a record of a table in memory.

    Parameters
    ----------
    frame : DataFrame
        With the columns of a recorded run; others are ignored. NaN is an empty cell.
    output_unit : str
        "mA", "V", "m/s2", "g" or "count".
    gravity_m_s2 : float
        Gravity at the place, m/s².
    nominal_scale : float
        Output unit per g.
    run_start_utc : mapping, optional
        Run id → time at which it began.
    mount_deg : mapping, optional
        Run id → serial → how far it is mounted turned on the head, °.
    temp_sigma_c, temp_gain_ppm : float
        What the thermistors may be wrong by, 1 sigma.
    source : str
        Where the table came from, for messages.
    place : callable, optional
        Turns a row's index into words, for messages; default: rows are counted from 1.

    Raises
    ------
    InputError
        If a value is not what it should be.
    """
    given = {
        "output_unit": output_unit,
        "gravity_m_s2": gravity_m_s2,
        "nominal_scale": nominal_scale,
        "run_start_utc": dict(run_start_utc or {}),
        "mount_deg": {run: dict(of_run) for run, of_run in (mount_deg or {}).items()},
        "temp_sigma_c": temp_sigma_c,
        "temp_gain_ppm": temp_gain_ppm,
    }
    sidecar = check(given, Sidecar, source)
    missing = [name for name in REQUIRED if name not in frame.columns]
    if missing:
        raise InputError(source, "", f"no column {', '.join(missing)}")
    text: dict[str, Labels] = {}
    number: dict[str, Any] = {}
    numbers = number_columns()
    for name in (name for name in (*numbers, *TEXTS) if name in frame.columns):
        column = frame[name]
        if name in numbers:
            try:
                number[name] = column.to_numpy(dtype=np.float64, na_value=np.nan)
            except (TypeError, ValueError):
                raise InputError(source, f"column {name}", "expected numbers") from None
        else:
            text[name] = Labels.of(column.to_numpy(dtype=object))
    table = Table(text, number, source, place or (lambda row: f"row {row + 1}"))
    return build(table, sidecar.scale, sidecar.run_start_utc, sidecar.mount_deg)


def _read_one(path: Path, *, checked: bool) -> RecordedRuns:
    if not path.is_file():
        raise InputError(path, "", "no such file")
    side = sidecar_path(path)
    if side == path or not side.is_file():
        raise InputError(
            path,
            "",
            f"expected {side.name} beside it with the keys output_unit, gravity_m_s2, "
            "nominal_scale and optionally run_start_utc and mount_deg",
        )
    sidecar = read_toml(side, Sidecar)
    form = TableForm(numbers=number_columns(), texts=TEXTS, required=REQUIRED)
    raw = read_table(path, form)
    text = {name: Labels(codes, names) for name, (codes, names) in raw.text.items()}
    table = Table(text, raw.number, raw.source, raw.place)
    record = build(table, sidecar.scale, sidecar.run_start_utc, sidecar.mount_deg)
    return flag_readings(record, raw.place) if checked else record


def join_runs(parts: Sequence[RecordedRuns]) -> RecordedRuns:
    """Put recorded runs together; unit, gravity and scale may differ from part to part.

    Raises
    ------
    InputError
        If a run is in two parts with the same readings, or with different meanings.
    """
    if len(parts) == 1:
        return parts[0]
    scales: dict[tuple[str, str], OutputScale] = {}
    starts: dict[str, datetime] = {}
    mounts: dict[tuple[str, str], float] = {}
    for part in parts:
        for (run, serial), scale in part.scales.items():
            if scales.setdefault((run, serial), scale) != scale:
                raise InputError(
                    part.source, "", f"run {run!r} serial {serial!r}: unit, gravity or scale "
                    "differ from those in another file"
                )  # fmt: skip
            turned = part.mount_deg.get((run, serial), 0.0)
            if mounts.setdefault((run, serial), turned) != turned:
                raise InputError(
                    part.source, "", f"run {run!r} serial {serial!r}: mounted differently in "
                    "another file"
                )  # fmt: skip
        for run, start in part.run_start_utc.items():
            if starts.setdefault(run, start) != start:
                raise InputError(
                    part.source, "", f"run {run!r} has another start time in another file"
                )
    joined = RecordedRuns(
        run=Labels.join([part.run for part in parts]),
        serial=Labels.join([part.serial for part in parts]),
        flag=Labels.join([part.flag for part in parts]),
        time_s=np.concatenate([part.time_s for part in parts]),
        temp_c=np.concatenate([part.temp_c for part in parts]),
        position_deg=np.concatenate([part.position_deg for part in parts]),
        output=np.concatenate([part.output for part in parts]),
        chamber_c=np.concatenate([part.chamber_c for part in parts]),
        a_g=np.concatenate([part.a_g for part in parts]),
        more=_joined_signals(parts),
        scales=scales,
        run_start_utc=starts,
        mount_deg={key: angle for key, angle in mounts.items() if angle},
        source=", ".join(part.source for part in parts),
    )
    if sum(len(part.scales) for part in parts) == len(scales):
        return joined  # no run of an accelerometer is in two files
    return _in_order_of_time(joined, parts)


def _joined_signals(parts: Sequence[RecordedRuns]) -> Mapping[str, FloatArray]:
    """Return the recorded signals of all parts; NaN in a part that has not one of them."""
    names = dict.fromkeys(name for part in parts for name in part.more)
    return {
        name: np.concatenate([part.more.get(name, constant(np.nan, len(part))) for part in parts])
        for name in names
    }


def _in_order_of_time(joined: RecordedRuns, parts: Sequence[RecordedRuns]) -> RecordedRuns:
    key = pair_keys(joined.run, joined.serial)
    order = np.lexsort((joined.time_s, key))
    again = (np.diff(key[order]) == 0) & (np.diff(joined.time_s[order]) == 0)
    if again.any():
        row = int(max(order[np.argmax(again)], order[np.argmax(again) + 1]))
        ends = np.cumsum([len(part) for part in parts])
        raise InputError(
            parts[int(np.searchsorted(ends, row, side="right"))].source,
            "",
            f"run {joined.run.at(row)!r} serial {joined.serial.at(row)!r} time_s "
            f"{joined.time_s[row]} is also in another file",
        )
    return joined.take(order)
