"""From a parsed table to a rig run: rates, steps, gaps and dropouts.

What may be missing: up to `BRIDGE` steps in a row are bridged by a straight line, the rows
flagged; after a longer hole in time or in the gyros the attitude cannot be known, and the cycle is
split there. Rows of zeros are empty, and readings that stand alone are replaced
(`sinscal.recording.mend`). All of it is told in the run's warnings.
"""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.errors import InputError
from errormodel.io.tables import RawTable
from sinscal.recording.mend import (
    refuse_many,
    sensors_of,
    wild_readings,
    with_even_times,
    zero_rows,
)
from sinscal.recording.rows import (
    check_times,
    cycles_of,
    fail,
    flags,
    interpolated,
    refuse_impossible,
    require_filled,
    stretches,
    temperatures,
)
from sinscal.recording.run import AXES, BoolArray, Quantum, RigFacts, RigRun

BRIDGE = 5  # steps
NEITHER = "expected either; navigation outputs are for rig calibrate --mode navigation alone"
GAP = 1.5  # steps: a longer one misses a row
MAX_PIECES = 20  # of one cycle: more holes than that are no recording
MAX_MISSING = 0.1  # share of a column in a cycle
SHORTEST_S = 10.0  # of what is left of a split cycle


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """Columns of a run under work, and what was noticed."""

    row: IntArray  # in the file
    time_s: FloatArray
    cycle: IntArray
    gyro: FloatArray
    accel: FloatArray
    temp_c: FloatArray | None
    angle: FloatArray | None
    flag: BoolArray

    def take(self, rows: IntArray | BoolArray) -> "_Rows":
        return _Rows(
            row=self.row[rows],
            time_s=self.time_s[rows],
            cycle=self.cycle[rows],
            gyro=self.gyro[rows],
            accel=self.accel[rows],
            temp_c=None if self.temp_c is None else self.temp_c[rows],
            angle=None if self.angle is None else self.angle[rows],
            flag=self.flag[rows],
        )


def build_rig(raw: RawTable, facts: RigFacts, *, mend: bool = True) -> RigRun:
    """Make a rig run of a table.

    Parameters
    ----------
    raw : RawTable
    facts : RigFacts
    mend : bool
        Whether rows of zeros, readings that stand alone and stamps that jitter are put right.

    Raises
    ------
    InputError
        Naming the first row at fault.
    """
    refuse_impossible(raw)
    require_filled(raw, "time_s", "cycle")
    cycle = cycles_of(raw)
    check_times(raw, cycle)
    n_cycles = int(cycle[-1]) + 1
    if facts.axis_of_cycle is not None and len(facts.axis_of_cycle) != n_cycles:
        given = len(facts.axis_of_cycle)
        raise InputError(
            raw.source, "", f"{n_cycles} cycles, but axis_of_cycle of the sidecar names {given}"
        )
    warnings: list[str] = []
    raw = with_even_times(raw, cycle, warnings) if mend else raw
    nominal_s = _nominal_steps(raw, cycle)
    rows = _columns(raw, cycle, nominal_s)
    rows = _without_zeros(raw, rows, warnings) if mend else rows
    rows = _without_long_dropouts(raw, rows, warnings)
    rows = _bridged_dropouts(raw, rows, warnings)
    rows = _without_wild(raw, rows, facts.quantum, warnings) if mend else rows
    return _with_steps(raw, rows, nominal_s, facts, warnings)


def _nominal_steps(raw: RawTable, cycle: IntArray) -> FloatArray:
    """Return each cycle's usual step, s, shape (cycles,)."""
    step, inside = np.diff(raw.number["time_s"]), np.diff(cycle) == 0
    if not inside.any():
        raise InputError(raw.source, "", "no cycle has two rows, expected a recording")
    usual = float(np.median(step[inside]))
    found = np.full(int(cycle[-1]) + 1, usual)
    for k in range(found.size):
        mine = step[inside & (cycle[1:] == k)]
        found[k] = np.median(mine) if mine.size else usual
    return found


def _columns(raw: RawTable, cycle: IntArray, nominal_s: FloatArray) -> _Rows:
    own_s = _own_steps(raw.number["time_s"], cycle, nominal_s)
    angle = raw.number.get("rig_angle_rad")
    if angle is not None and np.isnan(angle).all():
        raise InputError(raw.source, "column rig_angle_rad", "is empty")
    return _Rows(
        row=np.arange(cycle.size),
        time_s=raw.number["time_s"],
        cycle=cycle,
        gyro=_triple(raw, "gyro", "dtheta", own_s),
        accel=_triple(raw, "accel", "dv", own_s),
        temp_c=temperatures(raw, cycle),
        angle=angle,
        flag=flags(raw),
    )


def _own_steps(time_s: FloatArray, cycle: IntArray, nominal_s: FloatArray) -> FloatArray:
    """Return what a row is the mean over: its step, or the usual one where rows are missing."""
    usual = nominal_s[cycle]
    step = np.concatenate([[np.inf], np.diff(time_s)])
    first = np.concatenate([[True], np.diff(cycle) != 0])
    return np.where(first | (step > GAP * usual), usual, step)


def _triple(raw: RawTable, mean: str, increment: str, own_s: FloatArray) -> FloatArray:
    """Return three columns as means over the step, shape (n, 3)."""
    found = [
        name for name in (mean, increment) if any(f"{name}_{axis}" in raw.number for axis in AXES)
    ]
    if len(found) != 1:
        what = "both given, expected one of them" if found else NEITHER
        raise InputError(raw.source, "header", f"columns {mean}_*, {increment}_*: {what}")
    names = [f"{found[0]}_{axis}" for axis in AXES]
    missing = [name for name in names if name not in raw.number]
    if missing:
        raise InputError(raw.source, "header", f"no column {', '.join(missing)}")
    for name in names:
        if np.isnan(raw.number[name]).all():
            raise InputError(raw.source, f"column {name}", "is empty")
    values = np.column_stack([raw.number[name] for name in names])
    return values / own_s[:, None] if found[0] == increment else values


def _without_zeros(raw: RawTable, rows: _Rows, warnings: list[str]) -> _Rows:
    """Empty the cells of triads that read nothing at all."""
    no_rate, no_force = zero_rows(rows.gyro, rows.accel, rows.cycle)
    either = no_rate | no_force
    if not either.any():
        return rows
    refuse_many(raw, either, rows.cycle, rows.row, "zeros in all of a triad's cells")
    which = [name for name, bad in (("gyros", no_rate), ("accelerometers", no_force)) if bad.any()]
    warnings.append(
        f"zero_rows: {int(either.sum())} rows of zeros ({', '.join(which)}) are taken as empty "
        f"cells, from {raw.place(int(rows.row[np.argmax(either)]))}"
    )
    gyro, accel = np.array(rows.gyro), np.array(rows.accel)
    gyro[no_rate], accel[no_force] = np.nan, np.nan
    return replace(rows, gyro=gyro, accel=accel)


def _without_wild(raw: RawTable, rows: _Rows, quantum: Quantum, warnings: list[str]) -> _Rows:
    """Put straight lines in place of readings that stand alone and flag their rows."""
    usual_s = float(np.median(np.diff(rows.time_s)))
    steps = {
        "gyro": max(quantum.gyro_rad / usual_s, quantum.gyro_rad_s),
        "accel": max(quantum.accel_m_s / usual_s, quantum.accel_m_s2),
    }
    found = {k: wild_readings(getattr(rows, k), rows.cycle, step) for k, step in steps.items()}
    either = np.asarray(np.hstack([*found.values()]).any(axis=1))
    if not either.any():
        return rows
    refuse_many(raw, either, rows.cycle, rows.row, "an isolated reading")
    which = [sensors_of(bad, kind) for kind, bad in found.items() if bad.any()]
    warnings.append(
        f"wild_readings: isolated readings replaced by straight lines in "
        f"{int(either.sum())} row(s) ({', '.join(which)}), from "
        f"{raw.place(int(rows.row[np.argmax(either)]))}"
    )
    straight = {
        kind: interpolated(np.where(bad, np.nan, getattr(rows, kind)), rows.cycle)
        for kind, bad in found.items()
    }
    return replace(rows, **straight, flag=rows.flag | either)


def _without_long_dropouts(raw: RawTable, rows: _Rows, warnings: list[str]) -> _Rows:
    """Take out rows without gyros where too many stand together, or at a cycle's ends."""
    empty: BoolArray = np.isnan(rows.gyro).max(axis=1)
    if not empty.any():
        return rows
    keep = np.ones_like(empty)
    for a, b in stretches(empty):
        _refuse_many(raw, rows, empty, a)
        inside = a > 0 and b < empty.size and rows.cycle[a - 1] == rows.cycle[b]
        if b - a > BRIDGE or not inside:
            keep[a:b] = False
    if not keep.all():
        first = raw.place(int(np.argmin(keep)))
        warnings.append(f"dropouts: {int((~keep).sum())} rows without gyros left out, from {first}")
    return rows.take(keep)


def _bridged_dropouts(raw: RawTable, rows: _Rows, warnings: list[str]) -> _Rows:
    """Fill empty cells of sensors and angle by straight lines and flag their rows."""
    angle = np.zeros(rows.row.size) if rows.angle is None else rows.angle
    empty: BoolArray = np.isnan(np.column_stack([rows.gyro, rows.accel, angle])).max(axis=1)
    if not empty.any():
        return rows
    for a, _ in stretches(empty):
        _refuse_many(raw, rows, empty, a)
    first = raw.place(int(rows.row[np.argmax(empty)]))
    warnings.append(f"dropouts: {int(empty.sum())} rows with empty cells flagged, from {first}")
    turned = None if rows.angle is None else interpolated(rows.angle[:, None], rows.cycle)[:, 0]
    return replace(
        rows,
        gyro=interpolated(rows.gyro, rows.cycle),
        accel=interpolated(rows.accel, rows.cycle),
        angle=turned,
        flag=rows.flag | empty,
    )


def _refuse_many(raw: RawTable, rows: _Rows, empty: BoolArray, at: int) -> None:
    mine = rows.cycle == rows.cycle[at]
    share = float(np.mean(empty[mine]))
    if share > MAX_MISSING:
        raise fail(
            raw,
            int(rows.row[at]),
            f"empty cells; they are in {share:.0%} of the cycle's rows, expected "
            f"{MAX_MISSING:.0%} at most",
        )


def _with_steps(
    raw: RawTable, rows: _Rows, nominal_s: FloatArray, facts: RigFacts, warnings: list[str]
) -> RigRun:
    """Bridge short holes in time, split cycles at long ones, and make the run."""
    usual = nominal_s[rows.cycle]
    step = np.concatenate([[0.0], np.diff(rows.time_s)])
    first = np.concatenate([[True], np.diff(rows.cycle) != 0])
    step[first] = usual[first]
    hole = ~first & (step > GAP * usual)
    split = hole & (np.round(step / usual) > BRIDGE + 1)
    bridge = hole & ~split
    rows = _bridged_holes(raw, rows, step, usual, bridge, warnings)
    step[split] = usual[split]
    rows, step, old = _split(raw, rows, step, split, warnings)
    axes = facts.axis_of_cycle
    return RigRun(
        time_s=rows.time_s,
        step_s=step,
        cycle=rows.cycle,
        gyro=rows.gyro,
        accel=rows.accel,
        temp_c=rows.temp_c,
        rig_angle_rad=rows.angle,
        flag=rows.flag,
        facts=replace(facts, axis_of_cycle=None if axes is None else tuple(axes[k] for k in old)),
        source=raw.source,
        warnings=tuple(warnings),
    )


def _bridged_holes(
    raw: RawTable,
    rows: _Rows,
    step: FloatArray,
    usual: FloatArray,
    bridge: BoolArray,
    warnings: list[str],
) -> _Rows:
    """Let the row after a short hole stand for the hole too: its mean over both."""
    at = np.flatnonzero(bridge)
    if not at.size:
        return rows
    share = (usual[at] / step[at])[:, None]  # of the step that the row's own reading covers
    gyro, accel = np.array(rows.gyro), np.array(rows.accel)
    for values in (gyro, accel):
        middle = 0.5 * (values[at - 1] + values[at])
        values[at] = share * values[at] + (1.0 - share) * middle
    where = raw.place(int(rows.row[at[0]]))
    warnings.append(
        f"gaps_bridged: {at.size} of at most {BRIDGE} rows, their ends flagged, from {where}"
    )
    return replace(rows, gyro=gyro, accel=accel, flag=rows.flag | bridge)


def _split(
    raw: RawTable, rows: _Rows, step: FloatArray, split: BoolArray, warnings: list[str]
) -> tuple[_Rows, FloatArray, list[int]]:
    """Return rows with the pieces of cycles as cycles, their steps, and each one's old number."""
    starts = np.flatnonzero(split | np.concatenate([[True], np.diff(rows.cycle) != 0]))
    bounds = [*starts.tolist(), rows.row.size]
    old = rows.cycle[starts].tolist()
    keep, pieces = np.ones(rows.row.size, dtype=np.bool_), list[int]()
    number = np.zeros(rows.row.size, dtype=np.intp)
    for a, b, k in zip(bounds[:-1], bounds[1:], old, strict=True):
        if old.count(k) > 1 and rows.time_s[b - 1] - rows.time_s[a] < SHORTEST_S:
            keep[a:b] = False
            continue
        number[a:b] = len(pieces)
        pieces.append(k)
    for k in sorted(set(old)):
        holes = [int(a) for a in np.flatnonzero(split & (rows.cycle == k))]
        if not holes:
            continue
        where = raw.place(int(rows.row[holes[0]]))
        if len(holes) >= MAX_PIECES or k not in pieces:
            raise InputError(
                raw.source,
                where,
                f"cycle {k} has {len(holes)} gaps, expected a recording that attitude can be "
                f"carried through for {SHORTEST_S:g} s at least",
            )
        warnings.append(
            f"gap_in_cycle: cycle {k} is split at {len(holes)} gap(s), the first before {where}; "
            f"attitude starts anew there; {pieces.count(k)} piece(s) of {SHORTEST_S:g} s or more"
        )
    return replace(rows.take(keep), cycle=number[keep]), step[keep], pieces
