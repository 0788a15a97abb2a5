"""Factors that the residual of a chamber run may follow, and columns that would repeat."""

import numpy as np
from scipy.interpolate import BSpline

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.problem import Factor
from errormodel.linear import independent
from thermo.discrepancy.blocks import Blocks
from thermo.recording.channel import HOLD, Channel

FINE_C, COARSE_C = 4.0, 12.0
TIME_KNOT_S = 1500.0
MAX_POSITIONS = 36
RATE_BINS = 8


def splines(x: FloatArray, knot: float) -> FloatArray:
    """Return cubic B-splines over the range of x with knots about `knot` apart, shape (n, m)."""
    lo, hi = float(x.min()), float(x.max())
    pieces = max(1, round((hi - lo) / knot))
    if hi <= lo:
        return np.ones((x.size, 1))
    inner = np.linspace(lo, hi, pieces + 1)
    knots = np.concatenate([[lo] * 3, inner, [hi] * 3])
    return BSpline.design_matrix(np.clip(x, lo, hi), knots, 3).toarray()


def indicator(labels: IntArray) -> FloatArray:
    """Return one indicator column per label."""
    return (labels[:, None] == np.unique(labels)[None, :]).astype(float)


def by_label(columns: FloatArray, labels: IntArray) -> FloatArray:
    """Return every column once per label, zero elsewhere, without empty columns."""
    marks = indicator(labels)
    product = np.hstack([columns * marks[:, [k]] for k in range(marks.shape[1])])
    return product[:, np.any(product != 0, axis=0)]


class Seen:
    """Block means of the quantities that the residual of a channel may follow."""

    def __init__(self, channel: Channel, blocks: Blocks) -> None:
        record = channel.record
        first = blocks.starts
        self.blocks = blocks
        self.run = record.run[first]
        self.time_s = blocks.times.time_s
        self.temp = blocks.mean(record["x_slow_c"])
        self.rate = blocks.mean(record["rate_c_per_min"])
        self.direction = channel.direction[first].astype(np.intp)
        self.has_input = channel.has_input
        angle = np.round(np.degrees(np.arctan2(record["a_i_g"], record["a_p_g"])), 0)[first]
        self.position = np.unique(angle, return_inverse=True)[1]
        self.dwell = self._dwell_s(np.round(angle, 0))

    @property
    def runs(self) -> int:
        """Number of runs."""
        return int(self.run[-1]) + 1

    def _dwell_s(self, angle: FloatArray) -> FloatArray:
        """Return the time since the head last turned, s."""
        new = np.concatenate([[True], (np.diff(angle) != 0) | (np.diff(self.run) != 0)])
        begun = self.time_s[new][np.cumsum(new) - 1]
        return self.time_s - begun

    def side(self) -> IntArray:
        """Return heating or cooling; a hold has the direction of the preceding ramp."""
        side = self.direction.copy()
        for k in range(1, side.size):
            if side[k] == HOLD and self.run[k] == self.run[k - 1]:
                side[k] = side[k - 1]
        return side


def factors_of(seen: Seen) -> tuple[Factor, ...]:
    """Return the factors for a verdict; a single run does not show what repeats."""
    again = seen.runs > 1
    n_groups = int(seen.position.max()) + 1
    coarse = splines(seen.temp, COARSE_C)
    made = [
        Factor(name="temperature", groups=(splines(seen.temp, FINE_C),), repeatable=again),
        Factor(name="direction", groups=(by_label(coarse, seen.side()),), repeatable=again),
        Factor(name="rate", groups=(_rate(seen.rate),), repeatable=again),
        Factor(name="time", groups=_periods(seen), repeatable=False),
    ]
    if seen.has_input and 1 < n_groups <= MAX_POSITIONS:
        slope = np.column_stack([np.ones(seen.temp.size), seen.temp])
        made.append(
            Factor(name="position", groups=(by_label(slope, seen.position),), repeatable=again)
        )
        if float(np.max(seen.dwell)) > 4.0 * seen.blocks.times.step_s:
            made.append(
                Factor(name="rotation_phase", groups=(_phase(seen.dwell),), repeatable=again)
            )
    if again:
        whole = splines(seen.time_s, TIME_KNOT_S)
        made.append(Factor(name="time_in_run", groups=(whole,), repeatable=True))
        columns = by_label(splines(seen.time_s, 3.0 * TIME_KNOT_S), seen.run)
        made.append(Factor(name="run", groups=(columns,), repeatable=False))
    return tuple(made)


def _rate(rate: FloatArray) -> FloatArray:
    """Return hats over the rate, their corners at its quantiles."""
    corners = np.unique(np.round(np.quantile(rate, np.linspace(0, 1, RATE_BINS)), 3))
    if corners.size < 2:
        return np.ones((rate.size, 1))
    return np.column_stack([np.interp(rate, corners, row) for row in np.eye(corners.size)])


def _phase(dwell: FloatArray) -> FloatArray:
    corners = np.linspace(0.0, float(dwell.max()), 6)
    return np.column_stack([np.interp(dwell, corners, row) for row in np.eye(6)])


def _periods(seen: Seen) -> tuple[FloatArray, ...]:
    """Return a sine and cosine of each run by itself, one group a period."""
    span_s, step_s = seen.blocks.times.span_s, seen.blocks.times.step_s
    shortest = max(6.0 * step_s, span_s / 40.0)
    count = int(np.floor(span_s / shortest))
    if count < 2:
        return (np.ones((seen.time_s.size, 1)),)
    groups: list[FloatArray] = []
    for cycles in np.arange(2.0, count + 0.25, 0.5):
        angle = 2.0 * np.pi * cycles * seen.time_s / span_s
        groups.append(by_label(np.column_stack([np.sin(angle), np.cos(angle)]), seen.run))
    return tuple(groups)


def saturated_columns(seen: Seen) -> FloatArray:
    """Return columns for everything that would repeat: temperature by direction and position.

    With a single run it is not known what repeats, and temperature by direction is equivalent to
    time. Then only the position is used, because time cannot imitate it.
    """
    columns: list[FloatArray] = [np.ones((seen.temp.size, 1))]
    n_positions = int(seen.position.max()) + 1
    few = seen.has_input and 1 < n_positions <= MAX_POSITIONS
    if few:
        knot = COARSE_C if n_positions <= 12 else 3.0 * COARSE_C
        columns.append(by_label(splines(seen.temp, knot), seen.position))
    if seen.runs > 1:
        for knot in (FINE_C, 1.5 * FINE_C, 2.0 * FINE_C, 4.0 * FINE_C):
            wanted = by_label(splines(seen.temp, knot), seen.side())
            if wanted.shape[1] + sum(c.shape[1] for c in columns) < 0.25 * seen.temp.size:
                columns.append(wanted)
                break
        columns.append(_rate(seen.rate))
    return independent(np.hstack(columns))
