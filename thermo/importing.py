"""Other people's logs made recorded runs, by a mapping file that says what their columns are."""

import logging
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from errormodel.errors import InputError
from errormodel.files import read_toml
from thermo.importing_log import Log, chosen_rows, matching, read_log
from thermo.importing_map import Accelerometer, LogMap, Temperature, TimeColumn, Value
from thermo.recording_check import Table, build
from thermo.recording_model import FORCES, BoolArray, FloatArray, IntArray, Labels, RecordedRuns

__all__ = ["LogMap", "import_log"]

log = logging.getLogger(__name__)


def import_log(file: Path | str, map_file: Path | str) -> RecordedRuns:
    """Make a recorded run of a log.

    Parameters
    ----------
    file : path
        The log: delimited text.
    map_file : path
        The mapping, TOML, see `thermo.importing_map.LogMap`.

    Returns
    -------
    RecordedRuns
        Each row of the log gives a reading of each accelerometer of the mapping.

    Raises
    ------
    InputError
        Naming file and line or key of the first fault. With ``on_bad_row = "flag"`` in the mapping
        a reading without a number is kept with the flag "bad"; a row whose time is missing, or not
        after the one before, cannot be placed and is left out, with a warning.
    """
    mapping = read_toml(map_file, LogMap)
    rows = chosen_rows(read_log(Path(file), mapping.file), mapping.rows)
    raw = _raw_times(rows, mapping)
    rows, raw = _placeable(rows, raw, mapping)
    runs, time_s, starts = _runs_and_times(rows, raw, mapping)
    parts = [_readings(rows, runs, time_s, a, mapping) for a in mapping.accelerometers]
    parts = [part for part in parts if len(part.rows)]
    if not parts:
        raise InputError(file, "", "no row belongs to any accelerometer of the mapping")
    return _record(rows, runs, time_s, parts, mapping, starts)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One accelerometer's readings; `rows` says which rows of the log they are."""

    serial: str
    rows: IntArray
    number: dict[str, FloatArray]
    flag: list[str]


@dataclass(frozen=True, slots=True, eq=False)
class _Times:
    """Times as exact as the log has them: whole numbers stay whole until the start is taken off."""

    values: list[int | float | None]
    unit_s: float
    zone_known: bool = False


def _raw_times(rows: Log, mapping: LogMap) -> _Times:
    cells = rows.cells(mapping.time.column)
    if mapping.time.format is not None:
        return _dates(cells, mapping.time)
    values: list[int | float | None] = []
    for cell in cells:
        number = rows.number(cell)
        whole = len(cell) < 30 and cell.lstrip("+-").isdecimal() and cell.isascii()
        values.append(int(cell) if whole else number if np.isfinite(number) else None)
    return _Times(values, mapping.time.unit_s)


def _dates(cells: list[str], column: TimeColumn) -> _Times:
    """Return dates as whole microseconds; either all of them tell their time zone or none."""
    epoch, step = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
    values: list[int | float | None] = []
    zones: set[bool] = set()
    for cell in cells:
        try:
            if column.format == "iso":
                instant = datetime.fromisoformat(cell)
            else:
                instant = datetime.strptime(cell, column.format or "")
            zones.add(instant.tzinfo is not None)
            values.append((instant.replace(tzinfo=instant.tzinfo or UTC) - epoch) // step)
        except (ValueError, OverflowError):
            values.append(None)
    return _Times(values, 1e-6, zones == {True})


def _placeable(rows: Log, times: _Times, mapping: LogMap) -> tuple[Log, _Times]:
    """Leave out rows without a time, or refuse them; and so those that run backwards."""
    keep = np.ones(len(rows.rows), dtype=np.bool_)
    run_of = _run_cells(rows, mapping)
    interleaved = any(a.only is not None for a in mapping.accelerometers)
    last: dict[str, int | float] = {}
    for i, value in enumerate(times.values):
        before = last.get(run_of[i])
        # where rows belong to different accelerometers, each one's own order is checked later
        backwards = not interleaved and value is not None and before is not None and value <= before
        if value is None or backwards:
            cell = rows.cells(mapping.time.column)[i] if mapping.on_bad_row == "error" else ""
            what = f"is not after {before}" if backwards else "is no time"
            keep[i] = _left_out(rows, i, f"time {cell!r:.60} {what}", mapping)
        else:
            last[run_of[i]] = value
    left = len(keep) - int(keep.sum())
    if left:
        log.warning("%s: %d rows left out: time missing or not increasing", rows.path, left)
    if not keep.any():
        raise InputError(rows.path, "", "no row has a time")
    kept = [value for value, k in zip(times.values, keep.tolist(), strict=True) if k]
    return rows.take(keep), _Times(kept, times.unit_s, times.zone_known)


def _left_out(rows: Log, i: int, problem: str, mapping: LogMap) -> bool:
    if mapping.on_bad_row == "error":
        raise InputError(rows.path, f"line {rows.lines[i]}", problem)
    return False


def _run_cells(rows: Log, mapping: LogMap) -> list[str]:
    if mapping.run.column is not None:
        return rows.cells(mapping.run.column)
    return [mapping.run.id or ""] * len(rows.rows)


def _runs_and_times(
    rows: Log, times: _Times, mapping: LogMap
) -> tuple[list[str], FloatArray, dict[str, datetime]]:
    """Return each row's run and the seconds since that run's start; and starts that are known."""
    runs = _run_cells(rows, mapping)
    if mapping.run.gap_s is not None:
        runs, number, before = [], 1, None
        for value in times.values:
            assert value is not None
            if before is not None and (value - before) * times.unit_s > mapping.run.gap_s:
                number += 1
            runs.append(str(number))
            before = value
    first: dict[str, int | float] = {}
    seconds: list[float] = []
    for run, value in zip(runs, times.values, strict=True):
        assert value is not None
        start = first.setdefault(run, value) if mapping.time.start == "first" else 0
        seconds.append(float(value - start) * times.unit_s)
    starts: dict[str, datetime] = dict(mapping.output.run_start_utc)
    if times.zone_known:
        epoch = datetime(1970, 1, 1, tzinfo=UTC)
        for run, value in first.items():
            starts.setdefault(run, epoch + timedelta(microseconds=int(value)))
    return runs, np.array(seconds), starts


def _readings(
    rows: Log, runs: list[str], time_s: FloatArray, one: Accelerometer, mapping: LogMap
) -> _Part:
    keep = np.ones(len(rows.rows), dtype=np.bool_)
    if one.only is not None:
        keep = matching(rows, one.only)
    mine = rows.take(keep)
    strict = mapping.on_bad_row == "error"
    bad = np.zeros(len(mine.rows), dtype=np.bool_)
    if not len(bad):
        return _Part(one.serial, np.flatnonzero(keep), {}, [])
    mark = None if strict else bad
    temperature = one.temperature or mapping.temperature
    assert temperature is not None
    number = {"time_s": time_s[keep], "temp_c": _celsius(mine, temperature, mark)}
    with np.errstate(over="ignore"):  # an infinite product is found out with its line
        number["output"] = mine.numbers(one.column, mark) * mapping.factor(one)
    if mapping.chamber is not None:
        number["chamber_c"] = _celsius(mine, mapping.chamber, mark)
    for name in ("position_deg", *FORCES):
        given: Value | None = getattr(one, name)
        if isinstance(given, str):
            number[name] = mine.numbers(given, mark)
        elif given is not None:
            number[name] = np.full(len(mine.rows), given)
    flag = ["bad" if b else "" for b in bad.tolist()]
    for rule in mapping.flag:
        right = mine.matches(rule.column, rule.good).tolist()
        flag = [f if f or r else rule.flag for f, r in zip(flag, right, strict=True)]
    return _Part(one.serial, np.flatnonzero(keep), number, flag)


def _celsius(rows: Log, column: Temperature, bad: BoolArray | None) -> FloatArray:
    with np.errstate(over="ignore"):
        value = rows.numbers(column.column, bad) * column.scale + column.offset
    if column.unit == "K":
        return value - 273.15
    return (value - 32.0) / 1.8 if column.unit == "F" else value


def _record(
    rows: Log,
    runs: list[str],
    time_s: FloatArray,
    parts: list[_Part],
    mapping: LogMap,
    starts: dict[str, datetime],
) -> RecordedRuns:
    """Put the accelerometers' readings in the order of the log's rows, and check them."""
    row = np.concatenate([part.rows for part in parts])
    order = np.argsort(row, kind="stable")
    row = row[order]
    names = sorted({name for part in parts for name in part.number})
    number = {
        name: np.concatenate(
            [part.number.get(name, np.full(len(part.rows), np.nan)) for part in parts]
        )[order]
        for name in names
    }
    serial = np.repeat([part.serial for part in parts], [len(part.rows) for part in parts])
    flags = np.array([flag for part in parts for flag in part.flag], dtype=object)
    run = np.array(runs, dtype=object)[row]
    text = {
        "run": Labels.of(run),
        "serial": Labels.of(serial[order]),
        "flag": Labels.of(flags[order]),
    }
    table = Table(text, number, str(rows.path), lambda i: f"line {rows.lines[int(row[i])]}")
    return build(table, mapping.output.scale, starts)
