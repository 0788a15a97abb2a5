"""Check of a recorded run's readings; a complaint says in which row, and what was expected."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from errormodel.arrays import constant, sealed
from errormodel.errors import InputError
from errormodel.statistics.outliers import OVERLOAD
from thermo.recording.labels import pair_keys, pairs, present_only
from thermo.recording.runs import (
    FORCES,
    GOOD_FLAGS,
    NUMBERS,
    BoolArray,
    FloatArray,
    Labels,
    OutputScale,
    RecordedRuns,
    nothing,
    number_columns,
)
from thermo.recording.signals import recorded_signals

TEMP_RANGE_C = (-273.15, 1000.0)
# No accelerometer outlives 10⁶ g, no head turns 10⁶ times, no run lasts 30 000 years.
LARGEST = {"time_s": 1e12, "position_deg": 3.6e8, **dict.fromkeys(FORCES, 1e6)}
LARGEST_OUTPUT_G = 1e6
# Mountings are told apart by the degree; where the input axis and the pendulous one share less of
# gravity than this, in g, their forces tell no angle.
MOUNT_TOLERANCE_DEG, LEAST_FORCE_G = 0.5, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Readings as parsed and not yet checked: texts, numbers (NaN where the cell is empty).

    `place` turns a row's index into words ("line 12"); `text` has run and serial, perhaps flag;
    `number` has the columns the file has.
    """

    text: Mapping[str, Labels]
    number: Mapping[str, FloatArray]
    source: str
    place: Callable[[int], str]

    def __len__(self) -> int:
        return len(self.text["run"].codes)

    def fail(self, row: int, problem: str) -> InputError:
        """Return the complaint about a row."""
        return InputError(self.source, self.place(row), problem)


def build(
    table: Table,
    scale: OutputScale,
    run_start_utc: Mapping[str, datetime] | None = None,
    mount_deg: Mapping[str, Mapping[str, float]] | None = None,
) -> RecordedRuns:
    """Check readings and make them a record; `mount_deg` by run and serial.

    Raises
    ------
    InputError
        Naming the first row at fault.
    """
    if len(table) == 0:
        raise InputError(table.source, "", "has no readings")
    run, serial = _checked_names(table, "run"), _checked_names(table, "serial")
    flag = _normal_flags(table)
    good = np.array([name == "" for name in flag.names], dtype=np.bool_)[flag.codes]
    empty = constant(np.nan, len(table))
    number = {name: table.number.get(name, empty) for name in number_columns()}
    forced = any(name in table.number for name in FORCES)
    _check_finite(table, number, good, _without_temperature(number, run, serial))
    _check_temperatures(table, number)
    _check_sizes(table, number, scale, good)
    _check_signals(table, number)
    _check_time(table, run, serial)
    _check_input(table, run, serial, good)
    stated = {(r, s): v for r, of_run in (mount_deg or {}).items() for s, v in of_run.items()}
    mounts = present_only(stated, run, serial)
    _check_mounts(table, run, serial, mounts)
    return RecordedRuns(
        run=run,
        serial=serial,
        flag=flag,
        a_g=sealed(np.column_stack([number[name] for name in FORCES]))
        if forced
        else nothing(len(table)),
        more={one.name: number[one.name] for one in recorded_signals() if one.name in table.number},
        scales={key: scale for key in pairs(run, serial)},
        run_start_utc={r: t for r, t in (run_start_utc or {}).items() if r in run.names},
        mount_deg=mounts,
        source=table.source,
        **{name: number[name] for name in NUMBERS if name not in FORCES},
    )


def _first(bad: BoolArray) -> int | None:
    return int(np.argmax(bad)) if bad.any() else None


def _checked_names(table: Table, column: str) -> Labels:
    labels = table.text[column]
    stripped = [name.strip() for name in labels.names]
    for code, name in enumerate(stripped):
        if not name or not name.isprintable():
            row = int(np.argmax(labels.codes == code))
            raise table.fail(row, f"{column} {name!r:.60}, expected a printable text")
    return labels.renamed(stripped)


def _normal_flags(table: Table) -> Labels:
    labels = table.text.get("flag")
    if labels is None:
        return Labels.all_alike("", len(table))
    names = [" ".join(name.split()) for name in labels.names]
    return labels.renamed(["" if name.lower() in GOOD_FLAGS else name for name in names])


def _without_temperature(
    number: Mapping[str, FloatArray], run: Labels, serial: Labels
) -> BoolArray:
    """Tell the readings of accelerometers that have no temperature at all in their run."""
    key = pair_keys(run, serial)
    known = np.zeros(len(run.names) * len(serial.names), dtype=np.bool_)
    known[key[~np.isnan(number["temp_c"])]] = True
    return ~known[key]


def _check_finite(
    table: Table, number: Mapping[str, FloatArray], good: BoolArray, without: BoolArray
) -> None:
    for name in number:
        if name in table.number and (row := _first(np.isinf(number[name]))) is not None:
            raise table.fail(row, f"{name} is infinite, expected a finite number")
    # a flagged reading may lack what could not be measured, but it has its place in time
    all_rows = np.ones_like(good)
    for name, needed in (("time_s", all_rows), ("temp_c", good & ~without), ("output", good)):
        if (row := _first(np.isnan(number[name]) & needed)) is not None:
            raise table.fail(row, f"{name} is empty or not a number, expected a finite number")


def _check_temperatures(table: Table, number: Mapping[str, FloatArray]) -> None:
    lo, hi = TEMP_RANGE_C
    for name in ("temp_c", "chamber_c"):
        values = number[name]
        if (row := _first((values < lo) | (values > hi))) is not None:
            raise table.fail(row, f"{name} {values[row]:g}, expected {lo:g} to {hi:g} °C")


def _check_signals(table: Table, number: Mapping[str, FloatArray]) -> None:
    """Refuse a recorded signal outside of what it may be."""
    for one in recorded_signals():
        (lo, hi), values = one.within, number[one.name]
        if (row := _first((values < lo) | (values > hi))) is not None:
            problem = f"{one.name} {values[row]:g}, expected {lo:g} to {hi:g} {one.unit}"
            raise table.fail(row, problem)


def _check_sizes(
    table: Table, number: Mapping[str, FloatArray], scale: OutputScale, good: BoolArray
) -> None:
    """Refuse what no instrument gives: its square or its products would overflow in a fit."""
    for name, most in LARGEST.items():
        size = np.abs(number[name]) if name in table.number else np.zeros(1)
        if (row := _first(size > most)) is not None:
            raise table.fail(row, f"{name} {number[name][row]:g}, expected {most:g} at most")
    output = number["output"]
    too_large = np.abs(output) > LARGEST_OUTPUT_G * abs(scale.nominal_scale)
    too_large &= np.abs(output) < OVERLOAD  # an instrument's word for no reading is flagged later
    if (row := _first(too_large & good)) is not None:
        raise table.fail(
            row,
            f"output {output[row]:g} {scale.output_unit} at nominal_scale {scale.nominal_scale:g} "
            f"is more than {LARGEST_OUTPUT_G:g} g, beyond any instrument; flag the reading or "
            f"correct the scale",
        )


def _check_time(table: Table, run: Labels, serial: Labels) -> None:
    key = pair_keys(run, serial)
    order = np.argsort(key, kind="stable")
    time_s = table.number["time_s"][order]
    stuck = (np.diff(key[order]) == 0) & ~(np.diff(time_s) > 0)
    if not stuck.any():
        return
    at = np.flatnonzero(stuck)
    worst = at[np.argmin(order[at + 1])]
    before, row = int(order[worst]), int(order[worst + 1])
    who = f"run {run.at(row)!r} serial {serial.at(row)!r}"
    same = all(np.array_equal(v[before], v[row], equal_nan=True) for v in table.number.values())
    if same:
        raise table.fail(row, f"{who}: a duplicate of {table.place(before)}")
    raise table.fail(
        row,
        f"{who}: time_s {time_s[worst + 1]!s} is not after {time_s[worst]!s} "
        f"in {table.place(before)}",
    )


def _check_input(table: Table, run: Labels, serial: Labels, good: BoolArray) -> None:
    """Within a run an accelerometer's input is known in all its good readings, or in none."""
    columns = [table.number[name] for name in FORCES if name in table.number]
    used = [column for column in columns if not np.all(np.isnan(column))]
    some, complete = np.zeros_like(good), np.zeros_like(good)
    if used:
        filled = ~np.isnan(np.column_stack(used))
        some, complete = filled.any(axis=1), filled.all(axis=1)
    if (row := _first(some & ~complete & good)) is not None:
        raise table.fail(row, "a_i_g, a_p_g, a_o_g are given in part, expected all of them or none")
    position = table.number.get("position_deg")
    known = complete if position is None else complete | ~np.isnan(position)
    key = pair_keys(run, serial)
    somewhere = np.zeros(len(run.names) * len(serial.names), dtype=np.bool_)
    somewhere[key[known & good]] = True
    if (row := _first(somewhere[key] & ~known & good)) is not None:
        raise table.fail(
            row, "position_deg is empty though other readings of the same run have a position"
        )


def _check_mounts(
    table: Table, run: Labels, serial: Labels, mounts: Mapping[tuple[str, str], float]
) -> None:
    """Check forces given beside the head's angle against the stated mounting."""
    needed = [table.number.get(name) for name in ("position_deg", *FORCES[:2])]
    angle, a_i, a_p = needed
    if angle is None or a_i is None or a_p is None:
        return
    own = np.degrees(np.arctan2(a_i, a_p))
    sure = np.hypot(a_i, a_p) > LEAST_FORCE_G  # False where one is not given
    for (of_run, of_serial), stated in mounts.items():
        mine = run.codes == run.names.index(of_run)
        mine &= serial.codes == serial.names.index(of_serial)
        off = np.abs((own - angle - stated + 180.0) % 360.0 - 180.0) > MOUNT_TOLERANCE_DEG
        if (row := _first(mine & sure & off)) is not None:
            turned = (own[row] - angle[row]) % 360.0
            raise table.fail(
                row,
                f"a_i_g and a_p_g agree with a mounting rotated by {turned:.1f}°, "
                f"the sidecar's mount_deg says {stated:g}°",
            )
