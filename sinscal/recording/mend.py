"""Single readings and stamps that cannot be true: found, so that they can be taken out and told.

What stands alone for one or two rows and is over is no motion: attitude carried through it would
be wrong for the rest of the cycle. A rig that knocks comes back, so that a straight line is right
there too.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy import ndimage

from errormodel.arrays import FloatArray, IntArray
from errormodel.errors import InputError
from errormodel.io.tables import RawTable
from sinscal.recording.abrupt import stands_out
from sinscal.recording.rows import fail, stretches
from sinscal.recording.run import AXES, BoolArray

MOST_MENDED = 0.01  # share of a cycle's rows: more is no recording
ALONE = 2  # rows
BEYOND = ALONE + 1  # rows
SIGMAS = 10.0  # as of shocks
COUNTS = 2.5  # steps of a counter: so far two roundings may lie from a third
OVER_MOTION = 2.0  # times what the neighbours differ by: a corner of a rate leaves a half
AROUND, LONELY = 10, 4.0  # rows on either side, and times what they are: a ripple is not alone
FEWEST = 50  # rows of a cycle; of fewer the noise is not known
TURNING = np.deg2rad(0.2)  # rad/s: gyros do not read zero between readings of more
EVEN_ROWS = 20  # of a piece without holes, to put a straight line through
HOLE = 1.5  # steps
JITTER = 1e-3  # of a step: stamps that jitter less do no harm
NOT_FOLLOWED = 0.5  # of the stamps' jitter is in the increments, at most
SURE = 4.0  # sigmas


def _cycles(cycle: IntArray) -> Iterator[slice]:
    edges = [0, *(np.flatnonzero(np.diff(cycle)) + 1).tolist(), cycle.size]
    yield from (slice(a, b) for a, b in pairwise(edges))


def refuse_many(raw: RawTable, bad: BoolArray, cycle: IntArray, row: IntArray, what: str) -> None:
    """Raise InputError at the first row of a cycle in which too many are bad.

    Parameters
    ----------
    raw : RawTable
    bad : ndarray of bool, shape (n,)
    cycle, row : ndarray of int, shape (n,)
        The cycle of each, and where in the file it stands.
    what : str
        What they are.
    """
    for rows in _cycles(cycle):
        share = float(np.mean(bad[rows]))
        if share > MOST_MENDED:
            first = int(row[rows][np.argmax(bad[rows])])
            text = f"{what}; so are {share:.1%} of the cycle's rows, expected {MOST_MENDED:.0%}"
            raise fail(raw, first, f"{text} at most")


def zero_rows(gyro: FloatArray, accel: FloatArray, cycle: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return the rows in which gyros and accelerometers read nothing at all, each of shape (n,).

    Three accelerometers at zero are no specific force; gyros at zero are none where the others
    are, or amid a turn.
    """
    no_force: BoolArray = np.all(accel == 0.0, axis=1)
    still: BoolArray = np.all(gyro == 0.0, axis=1)
    no_rate = still & no_force
    for rows in _cycles(cycle):
        part = gyro[rows]
        for a, b in stretches(still[rows]):
            if a == 0 or b == len(part):
                continue
            before, after = part[a - 1], part[b]
            least = min(np.linalg.norm(before), np.linalg.norm(after))
            if least > TURNING and before @ after > 0.0:
                no_rate[rows.start + a : rows.start + b] = True
    return no_rate, no_force


def wild_readings(values: FloatArray, cycle: IntArray, step: float = 0.0) -> BoolArray:
    """Return the readings of a triad that stand alone for one or two rows, shape (n, 3).

    Parameters
    ----------
    values : ndarray, shape (n, 3)
    cycle : ndarray, shape (n,)
    step : float
        Of the readings, where they are counts or rounded; 0 when not stated.
    """
    found = np.zeros(values.shape, dtype=np.bool_)
    for rows in _cycles(cycle):
        part = values[rows]
        if len(part) < FEWEST:
            continue
        # the noise is that about a line through rows beyond: a median follows a slope without any
        off = np.zeros(part.shape)
        off[BEYOND:-BEYOND] = part[BEYOND:-BEYOND] - 0.5 * (
            part[: -2 * BEYOND] + part[2 * BEYOND :]
        )
        usual = ndimage.median_filter(part, size=(2 * BEYOND + 1, 1), mode="nearest")
        # the rows that a line takes one end from are off by half of it, and not from the median
        apart = np.abs(part - usual)
        seen = stands_out(off, SIGMAS) & (apart > 0.5 * np.abs(off))
        seen &= apart > COUNTS * step
        for a, b in stretches(np.asarray(seen.any(axis=1))):
            if b - a > ALONE or a == 0 or b == len(part):
                continue
            before, after = part[a - 1], part[b]
            size = np.linalg.norm(part[a:b] - 0.5 * (before + after), axis=1)
            if size.min() > OVER_MOTION * np.linalg.norm(after - before):
                around = np.vstack([apart[max(a - AROUND, 0) : a], apart[b : b + AROUND]])
                lonely = apart[a:b] > LONELY * around.max(axis=0)
                found[rows.start + a : rows.start + b] = seen[a:b] & lonely
    return found


def sensors_of(found: BoolArray, kind: str) -> str:
    """Return which of a triad's sensors have something, as the file's columns are called."""
    return ", ".join(f"{kind}_{a}" for k, a in enumerate(AXES) if found[:, k].any())


def with_even_times(raw: RawTable, cycle: IntArray, warnings: list[str]) -> RawTable:
    """Return a table of increments with even times where its stamps jitter and they do not.

    Increments of velocity are as long as the steps they were summed over: gravity times the
    step. Where the stamps vary and the increments do not follow, the sensors kept time and the
    recorder did not.
    """
    names = [f"dv_{axis}" for axis in AXES]
    if any(name not in raw.number for name in names):
        return raw
    time_s = raw.number["time_s"]
    gain = np.linalg.norm(np.column_stack([raw.number[name] for name in names]), axis=1)
    even = np.array(time_s)
    followed, moved2, left2, n = 0.0, 0.0, 0.0, 0
    for rows in _cycles(cycle):
        usual = float(np.median(np.diff(time_s[rows]))) if rows.stop - rows.start > 2 else 0.0
        holes = np.flatnonzero(np.diff(time_s[rows]) > HOLE * usual) + 1
        edges = [int(rows.start), *(int(rows.start + h) for h in holes), int(rows.stop)]
        for a, b in pairwise(edges):
            if b - a < EVEN_ROWS:
                continue
            index: FloatArray = np.arange(b - a, dtype=np.float64) - 0.5 * (b - a - 1)
            slope = float(index @ time_s[a:b]) / float(index @ index)
            line = float(time_s[a:b].mean()) + slope * index
            if np.max(np.abs(time_s[a:b] - line)) > 0.5 * usual:
                continue
            even[a:b] = line
            step = np.diff(time_s[a:b]) / slope - 1.0
            size = gain[a + 1 : b] / np.nanmedian(gain[a:b]) - 1.0
            known = np.isfinite(size) & (np.abs(size) < HOLE - 1.0)
            step, size = step[known], size[known]
            followed += float(step @ size)
            moved2 += float(step @ step)
            left2 += float(size @ size)
            n += step.size
    if n == 0 or moved2 < n * JITTER**2:
        return raw
    share, sigma = followed / moved2, np.sqrt(left2 / n / moved2)
    if share + SURE * sigma > NOT_FOLLOWED:
        return raw
    off = np.abs(even - time_s)
    worst = int(np.argmax(off))
    warnings.append(
        f"stamps_evened: time_s is up to {1e3 * off[worst]:.3g} ms ({raw.place(worst)}) from even "
        f"times, {1e3 * float(np.sqrt(np.mean(off**2))):.2g} ms rms, and dv_* do not follow it: "
        "even times were taken"
    )
    if np.any((np.diff(even) <= 0) & (np.diff(cycle) == 0)):
        raise InputError(raw.source, raw.place(worst), "expected time_s to jitter by less")
    return replace(raw, number={**raw.number, "time_s": even})
