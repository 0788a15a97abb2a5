"""Other people's logs made recorded runs, by a mapping file that says what their columns are."""

import logging
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from itertools import pairwise
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from errormodel.errors import InputError
from errormodel.io.toml import read_toml
from errormodel.statistics.robust import longest_increasing
from thermo.recording.check import Table, build
from thermo.recording.foreign.log import Log, chosen_rows, matching, read_log
from thermo.recording.foreign.map import Accelerometer, LogMap, Temperature, TimeColumn, Value
from thermo.recording.readings_check import flag_readings
from thermo.recording.runs import FORCES, BoolArray, FloatArray, IntArray, Labels, RecordedRuns
from thermo.recording.units_check import unit_complaints

__all__ = ["LogMap", "import_log"]

log = logging.getLogger(__name__)

CLOCKS = "were the clocks changed? give zone in [time], like Europe/Berlin"


def import_log(file: Path | str, map_file: Path | str) -> RecordedRuns:
    """Make a recorded run of a log.

    Parameters
    ----------
    file : path
        The log: delimited text.
    map_file : path
        The mapping, TOML, see `thermo.recording.foreign.map.LogMap`.

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
        raise InputError(file, "", "no row matches an accelerometer of the mapping")
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
        if mapping.time.date is not None:
            days = rows.cells(mapping.time.date)
            cells = [f"{day} {cell}" for day, cell in zip(days, cells, strict=True)]
        return _dates(rows, cells, mapping.time)
    values: list[int | float | None] = []
    for cell in cells:
        number = rows.number(cell)
        whole = len(cell) < 30 and cell.lstrip("+-").isdecimal() and cell.isascii()
        values.append(int(cell) if whole else number if np.isfinite(number) else None)
    if mapping.time.wrap_bits is not None:
        values = _continued(rows, values, 2**mapping.time.wrap_bits, "the counter overflowed")
    return _Times(values, mapping.time.unit_s)


def _continued(
    rows: Log, values: list[int | float | None], period: int, what: str
) -> list[int | float | None]:
    """Count on where a counter of `period` begins anew: where it falls by more than half of it."""
    begun: list[int] = []
    offset, before = 0, None
    out: list[int | float | None] = []
    for i, value in enumerate(values):
        if value is not None:
            if before is not None and value - before < -period / 2:
                offset += period
                begun.append(i)
            before = value
        out.append(None if value is None else value + offset)
    if begun:
        where = ", ".join(f"line {rows.lines[i]}" for i in begun[:3])
        log.warning("%s: %s %d times (%s …)", rows.path, what, len(begun), where)
    return out


def _dates(rows: Log, cells: list[str], column: TimeColumn) -> _Times:
    """Return dates as whole microseconds; either all of them tell their time zone or none."""
    epoch, step = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
    zone = UTC if column.zone is None else ZoneInfo(column.zone)
    before: datetime | None = None
    values: list[int | float | None] = []
    zones: set[bool] = set()
    for cell in cells:
        try:
            if column.format == "iso":
                instant = datetime.fromisoformat(cell)
            else:
                instant = datetime.strptime(cell, column.format or "")
            zones.add(instant.tzinfo is not None or column.zone is not None)
            if instant.tzinfo is None:
                instant = _in_zone(instant, zone, before)
            before = instant
            values.append((instant - epoch) // step)
        except (ValueError, OverflowError):
            values.append(None)
    if column.without_day:
        day = timedelta(days=1) // step
        values = _continued(rows, values, day, "the time of day passed midnight")
    elif zones == {False}:
        _tell_change_of_clocks(rows, values)
    return _Times(values, 1e-6, zones == {True} and not column.without_day)


def _in_zone(instant: datetime, zone: tzinfo, before: datetime | None) -> datetime:
    """Give a local time its zone; an hour that comes twice is the second one after the first."""
    first = instant.replace(tzinfo=zone)
    if before is not None and first <= before:
        second = first.replace(fold=1)
        if second.astimezone(UTC) > before.astimezone(UTC):
            return second.astimezone(UTC)
    return first.astimezone(UTC)


def _tell_change_of_clocks(rows: Log, values: list[int | float | None]) -> None:
    """Say where local times go back by an hour: the clocks were changed, and a zone would tell."""
    for i, (before, after) in enumerate(pairwise(values)):
        if before is not None and after is not None and _is_change_of_clocks(before, after):
            where = f"line {rows.lines[i + 1]}"
            log.warning("%s: %s: the time goes back by an hour: %s", rows.path, where, CLOCKS)
            return


def _placeable(rows: Log, times: _Times, mapping: LogMap) -> tuple[Log, _Times]:
    """Leave out rows without a time or out of order, or refuse them.

    Of each run the longest sequence that increases is kept: one wrong stamp costs one row.
    """
    least = _least(times.values)
    given = [np.nan if v is None else float(v - least) for v in times.values]
    value = np.array(given, dtype=np.float64)
    keep = ~np.isnan(value)
    # where rows belong to different accelerometers, each one's own order is checked later
    if not any(a.only is not None for a in mapping.accelerometers):
        run_of = np.array(_run_cells(rows, mapping), dtype=object)
        for run in dict.fromkeys(run_of.tolist()):
            mine = np.flatnonzero(run_of == run)
            keep[mine] = longest_increasing(value[mine])
    if not keep.all():
        if mapping.on_bad_row == "error":
            raise _first_fault(rows, value, mapping)
        _tell_left_out(rows, np.flatnonzero(~keep), mapping)
    if not keep.any():
        raise InputError(rows.path, "", "no row has a time")
    kept = [v for v, k in zip(times.values, keep.tolist(), strict=True) if k]
    return rows.take(keep), _Times(kept, times.unit_s, times.zone_known)


def _first_fault(rows: Log, value: FloatArray, mapping: LogMap) -> InputError:
    """Return the complaint about the first row without a time or out of order."""
    run_of, cells = _run_cells(rows, mapping), rows.cells(mapping.time.column)
    last: dict[str, int] = {}
    for i, run in enumerate(run_of):
        before = last.get(run)
        if np.isnan(value[i]) or (before is not None and value[i] <= value[before]):
            what, help_ = "is no time", 'on_bad_row = "flag" leaves such rows out'
            if before is not None and not np.isnan(value[i]):
                what = f"is not after {cells[before]} of line {rows.lines[before]}"
                if mapping.time.local and _is_change_of_clocks(value[before], value[i]):
                    help_ = CLOCKS
            problem = f"time {cells[i]!r:.60} {what}; {help_}"
            return InputError(rows.path, f"line {rows.lines[i]}", problem)
        last[run] = i
    raise AssertionError("called for a log without a fault")


def _is_change_of_clocks(before_us: float, after_us: float) -> bool:
    """Tell a time that goes back by an hour, less what there was between two rows."""
    hour_us = 3.6e9
    return -hour_us <= after_us - before_us < -0.9 * hour_us


def _tell_left_out(rows: Log, left: IntArray, mapping: LogMap) -> None:
    cells = rows.cells(mapping.time.column)
    shown = [f"line {rows.lines[i]} ({cells[i]!r:.40})" for i in left[:3].tolist()]
    log.warning(
        "%s: %d rows left out, time missing or out of order: %s%s",
        rows.path,
        len(left),
        ", ".join(shown),
        " …" if len(left) > len(shown) else "",
    )


def _least(values: list[int | float | None]) -> int | float:
    """Return the least time: taken off first, what is left is exact enough to be ordered by."""
    return min((v for v in values if v is not None), default=0)


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
    number = {"time_s": time_s[keep], "temp_c": np.full(len(mine.rows), np.nan)}
    if temperature is not None:
        number["temp_c"] = _celsius(mine, temperature, mark)
    with np.errstate(over="ignore"):  # an infinite product is found out with its line
        number["output"] = _counts(mine, one, mark) * mapping.factor(one)
    if mapping.chamber is not None:
        number["chamber_c"] = _celsius(mine, mapping.chamber, mark)
    for name, column in mapping.signals.items():
        with np.errstate(over="ignore"):
            number[name] = mine.numbers(column.column, mark) * column.scale + column.offset
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


def _counts(rows: Log, one: Accelerometer, bad: BoolArray | None) -> FloatArray:
    """Return an accelerometer's column; counts written as unsigned are made signed again."""
    value = rows.numbers(one.column, bad)
    if not one.signed or one.bits is None:
        return value
    return np.where(value >= 2.0 ** (one.bits - 1), value - 2.0**one.bits, value)


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
    record = flag_readings(build(table, mapping.output.scale, starts), table.place)
    for doubt in unit_complaints(record):  # whoever reads the recording refuses it
        log.warning("%s: %s", rows.path, doubt)
    return record
