"""Check of a rig table's rows: times that increase, cycles that stand together."""

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.errors import InputError
from errormodel.io.tables import RawTable
from sinscal.recording.run import AXES, BoolArray

GOOD_FLAGS = frozenset({"", "0", "0.0", "ok"})
# In the units of the columns no angle, force, time or height comes near it, and its square and the
# sums of that stay far from overflow; 9.9e37 is what instruments give for an overload.
LARGEST = 1e12
TEMP_RANGE_C = (-100.0, 200.0)  # no sensor works outside; kelvin stands out


def fail(raw: RawTable, row: int, problem: str) -> InputError:
    """Return the complaint about a row."""
    return InputError(raw.source, raw.place(int(row)), problem)


def stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """Return the runs of true values as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def refuse_impossible(raw: RawTable) -> None:
    """Raise InputError at the first cell that is infinite or beyond all that is ever recorded."""
    for name, values in raw.number.items():
        bad = np.abs(values) > LARGEST
        if bad.any():
            row = int(np.argmax(bad))
            if np.isinf(values[row]):
                raise fail(raw, row, f"{name} is infinite, expected a finite number")
            raise fail(
                raw,
                row,
                f"{name} {values[row]:g}, expected {LARGEST:g} at most; if this value means an "
                f"overload, leave the cell empty",
            )


def require_filled(raw: RawTable, *names: str) -> None:
    """Raise InputError at the first empty cell of these columns."""
    for name in names:
        bad = np.isnan(raw.number[name])
        if bad.any():
            row = int(np.argmax(bad))
            raise fail(raw, row, f"{name} is empty or not a number, expected a finite number")


def cycles_of(raw: RawTable) -> IntArray:
    """Return the cycle of each row, numbered 0, 1, … in the order of the file, shape (n,).

    Raises
    ------
    InputError
        If a number is not whole, or a cycle is taken up again after another.
    """
    values = raw.number["cycle"]
    bad = values != np.round(values)
    if bad.any():
        row = int(np.argmax(bad))
        raise fail(raw, row, f"cycle {values[row]:g}, expected a whole number")
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    seen: set[float] = set()
    for row in starts.tolist():
        if values[row] in seen:
            raise fail(
                raw, row, f"cycle {values[row]:g} again, expected its rows to be consecutive"
            )
        seen.add(float(values[row]))
    return np.cumsum(np.isin(np.arange(values.size), starts)).astype(np.intp) - 1


def check_times(raw: RawTable, cycle: IntArray) -> None:
    """Raise InputError at the first time that does not come after the one before in its cycle."""
    time_s = raw.number["time_s"]
    stuck = (np.diff(cycle) == 0) & ~(np.diff(time_s) > 0)
    if not stuck.any():
        return
    row = int(np.argmax(stuck)) + 1
    now, before = float(time_s[row]), float(time_s[row - 1])
    what = "is a duplicate of that" if now == before else f"goes back from {before!r}"
    raise fail(
        raw, row, f"time_s {now!r} {what} in {raw.place(row - 1)}, expected times that increase"
    )


def temperatures(raw: RawTable, cycle: IntArray) -> FloatArray | None:
    """Return the temperatures of accelerometers x, y, z, °C, shape (n, 3); empty cells are bridged.

    Raises
    ------
    InputError
        If the columns are given in part or twice, hold no number, or are not in °C.
    """
    several = [f"temp_{axis}_c" for axis in AXES]
    given = [name for name in ("temp_c", *several) if name in raw.number]
    if not given:
        return None
    if given != ["temp_c"] and given != several:
        raise InputError(
            raw.source, "", f"columns {', '.join(given)}, expected temp_c, or {', '.join(several)}"
        )
    lo, hi = TEMP_RANGE_C
    for name in given:
        values = raw.number[name]
        bad = (values < lo) | (values > hi)
        if bad.any():
            row = int(np.argmax(bad))
            raise fail(raw, row, f"{name} {values[row]:g}, expected {lo:g} to {hi:g} °C")
        if np.isnan(values).all():
            raise InputError(raw.source, f"column {name}", "is empty")
    values = np.column_stack([raw.number[name] for name in given])
    return np.broadcast_to(interpolated(values, cycle), (cycle.size, 3)).copy()


def flags(raw: RawTable) -> BoolArray:
    """Return which rows the file marks as not to be used, shape (n,)."""
    if "flag" not in raw.text:
        return np.zeros(raw.number["time_s"].size, dtype=np.bool_)
    codes, names = raw.text["flag"]
    bad = np.array([" ".join(name.split()).lower() not in GOOD_FLAGS for name in names])
    return bad[codes]


def interpolated(values: FloatArray, cycle: IntArray) -> FloatArray:
    """Fill NaN in columns by straight lines within cycles; a cycle with no number by the others."""
    if not np.isnan(values).any():
        return values
    out = np.array(values, dtype=float)
    for column in out.T:
        for k in np.unique(cycle[np.isnan(column)]):
            rows = np.flatnonzero(cycle == k)
            good = rows[~np.isnan(column[rows])]
            source = good if good.size else np.flatnonzero(~np.isnan(column))
            column[rows] = np.interp(rows, source, column[source])
    return out
