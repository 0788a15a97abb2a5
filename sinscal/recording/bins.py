"""Means of a rig run over short spans, each within one cycle and free of flagged rows."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from sinscal.recording.run import RigRun


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bins:
    """Means over spans of equally many rows, m spans.

    Attributes
    ----------
    cycle : ndarray of int, shape (m,)
    length_s : ndarray, shape (m,)
    gyro, accel : ndarray, shape (m, 3)
    follows : ndarray of bool, shape (m - 1,)
        Whether a span begins where the one before ends.
    rows : int
        Rows of each span.
    turned : ndarray, shape (m,)
        Change of the rig's angle from the span's first row to its last, over the time between,
        rad/s; NaN without an angle.
    """

    cycle: IntArray
    length_s: FloatArray
    gyro: FloatArray
    accel: FloatArray
    follows: FloatArray
    rows: int
    turned: FloatArray


def bins_of(run: RigRun, span_s: float) -> Bins:
    """Return means over spans of about `span_s`; spans with flagged rows are left out."""
    rows = max(1, round(span_s / float(np.median(run.step_s))))
    first = [k for s in run.cycles for k in range(s.start, s.stop - rows + 1, rows)]
    starts = np.array(first, dtype=np.intp)
    good = ~np.asarray(run.flag)
    clear = np.array([bool(good[a : a + rows].all()) for a in first], dtype=np.bool_)
    starts = starts[clear]
    pick = starts[:, None] + np.arange(rows)
    weight = run.step_s[pick]
    length = weight.sum(axis=1)
    gyro = np.einsum("mr,mrk->mk", weight, run.gyro[pick]) / length[:, None]
    accel = np.einsum("mr,mrk->mk", weight, run.accel[pick]) / length[:, None]
    turned = np.full(starts.size, np.nan)
    if run.rig_angle_rad is not None and rows > 1:
        last = starts + rows - 1
        between = run.time_s[last] - run.time_s[starts]
        turned = (run.rig_angle_rad[last] - run.rig_angle_rad[starts]) / between
    cycle = run.cycle[starts]
    follows = (np.diff(starts) == rows) & (np.diff(cycle) == 0)
    return Bins(
        cycle=cycle,
        length_s=length,
        gyro=gyro,
        accel=accel,
        follows=follows,
        rows=rows,
        turned=turned,
    )
