"""Factors that the residual of a chamber run may follow, and columns that would repeat."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.problem import Factor
from errormodel.linear import independent
from thermo.discrepancy.blocks import Blocks
from thermo.library import quantities
from thermo.library.quantities import DAY_H, Quantity, of_signal
from thermo.recording.channel import HOLD, Channel
from thermo.recording.further_columns import signal_of_column
from thermo.recording.signals import signals

FINE_C, COARSE_C = 4.0, 12.0
TIME_KNOT_S = 1500.0
MAX_POSITIONS = 36
CORNERS = 8  # of a broken line over a quantity
# A day's period of less than this share of it is a drift; of more than this it has come again.
DAY_SEEN, DAY_AGAIN = 0.75, 1.5
LEAST_RESTS = 4  # runs
# Columns that the noise is estimated beside are no more than this share of the block means.
MOST_HELD = 0.25

Groups = tuple[FloatArray, ...]


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
        self.channel, self.blocks = channel, blocks
        self._means: dict[str, FloatArray] = {}
        self.run = record.run[first]
        self.time_s = blocks.times.time_s
        self.temp = blocks.mean(record["x_slow_c"])
        self.rate = blocks.mean(record["rate_c_per_min"])
        self.direction = channel.direction[first].astype(np.intp)
        self.has_input = channel.has_input
        angle = np.round(np.degrees(np.arctan2(record["a_i_g"], record["a_p_g"])), 0)[first]
        self.position = np.unique(angle, return_inverse=True)[1]

    @property
    def runs(self) -> int:
        """Number of runs."""
        return int(self.run[-1]) + 1

    def of(self, quantity: Quantity) -> FloatArray:
        """Return block means of a quantity."""
        if quantity.name not in self._means:
            self._means[quantity.name] = self.blocks.mean(quantity.of(self.channel.record))
        return self._means[quantity.name]

    def side(self) -> IntArray:
        """Return heating or cooling; a hold has the direction of the preceding ramp."""
        side = self.direction.copy()
        for k in range(1, side.size):
            if side[k] == HOLD and self.run[k] == self.run[k - 1]:
                side[k] = side[k - 1]
        return side

    def rest_h(self) -> FloatArray:
        """Return how long the rest before each run was, h; before the first, the longest."""
        elapsed_h = self.blocks.times.elapsed_s / 3600.0
        starts = np.flatnonzero(np.diff(self.run, prepend=-1))
        ends = np.append(starts[1:], self.run.size) - 1
        rests = elapsed_h[starts[1:]] - elapsed_h[ends[:-1]]
        longest = float(rests.max()) if rests.size else 0.0
        return np.concatenate([[longest], rests])[self.run]


@dataclass(frozen=True, slots=True, kw_only=True)
class FactorKind:
    """A quantity as a factor: how it is resolved, and what its finding means.

    Attributes
    ----------
    quantity : Quantity
    groups : callable
        Of `Seen` and its values: groups of columns that resolve it; none where the runs do not
        show it.
    repeatable : bool
        Whether a new run would show the same.
    held : callable, optional
        Of its values: the few smooth columns that the noise is estimated beside, where a slow
        noise could follow it otherwise. Not one a level: what comes in one run alone would take
        that run's offset for something that repeats.
    values : callable, optional
        Of `Seen`, where block means of the quantity are not what it is resolved by.
    """

    quantity: Quantity
    groups: Callable[[Seen, FloatArray], Groups]
    repeatable: bool = True
    held: Callable[[FloatArray], FloatArray] | None = None
    values: Callable[[Seen], FloatArray] | None = None

    def values_in(self, seen: Seen) -> FloatArray:
        """Return the quantity's values by block."""
        return self.values(seen) if self.values else seen.of(self.quantity)


def corners(x: FloatArray, count: int = CORNERS) -> FloatArray:
    """Return hats over a quantity, their corners at its quantiles, shape (n, m)."""
    at = np.unique(np.round(np.quantile(x, np.linspace(0, 1, count)), 3))
    if at.size < 2:
        return np.ones((x.size, 1))
    return np.column_stack([np.interp(x, at, row) for row in np.eye(at.size)])


def _over(seen: Seen, x: FloatArray) -> Groups:
    columns = corners(x)
    return (columns,) if columns.shape[1] > 1 else ()


def _soon_after(seen: Seen, since_s: FloatArray) -> Groups:
    """Return hats over a time since something, closer together soon after it."""
    longest, least = float(since_s.max()), 0.5 * seen.blocks.times.step_s
    if longest <= 2.0 * least:
        return ()
    return (corners(np.log(since_s + least), 6),)


def _early(since_s: FloatArray) -> FloatArray:
    """Return what dies away within some seconds, minutes and quarters of an hour."""
    return np.column_stack([np.exp(-since_s / tau_s) for tau_s in (15.0, 60.0, 240.0)])


def _sizes(turn_deg: FloatArray) -> FloatArray:
    return np.column_stack([np.sign(turn_deg), turn_deg])


def _few(x: FloatArray) -> FloatArray:
    return corners(x, 4)


def _levels(seen: Seen, x: FloatArray) -> Groups:
    """Return one column a level of what has few."""
    if not seen.has_input:
        return ()
    levels = np.unique(np.round(x, 1), return_inverse=True)[1].reshape(-1)
    return (indicator(levels),) if 0 < levels.max() < MAX_POSITIONS else ()


def _positions(seen: Seen, x: FloatArray) -> Groups:
    del x
    if not (seen.has_input and 0 < seen.position.max() < MAX_POSITIONS):
        return ()
    slope = np.column_stack([np.ones(seen.temp.size), seen.temp])
    return (by_label(slope, seen.position),)


def _turning_points(seen: Seen, x: FloatArray) -> Groups:
    """Return a bias and a slope over where the temperature turned, where it did at several."""
    if np.unique(np.round(x)).size < 3:
        return ()
    return (np.column_stack([x, x**2]),)


def _day(seen: Seen, hour: FloatArray) -> Groups:
    hours = float(np.ptp(seen.blocks.times.elapsed_s)) / 3600.0
    if hours < DAY_SEEN * DAY_H:
        return ()
    angle = 2.0 * np.pi * hour / DAY_H
    return (np.column_stack([f(k * angle) for k in (1, 2) for f in (np.sin, np.cos)]),)


def _rests(seen: Seen, rest_h: FloatArray) -> Groups:
    if seen.runs < LEAST_RESTS or np.unique(np.round(rest_h, 1)).size < 3:
        return ()
    level = np.log1p(rest_h)
    return (np.column_stack([level, level * np.exp(-seen.time_s / 3600.0)]),)


def _by_run(seen: Seen, x: FloatArray) -> Groups:
    del x
    return (by_label(splines(seen.time_s, 3.0 * TIME_KNOT_S), seen.run),)


def _periods(seen: Seen, x: FloatArray) -> Groups:
    """Return a sine and cosine of each run by itself, one group a period."""
    del x
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


REST = Quantity(
    name="rest_before_run",
    unit="h",
    words="depends on the rest before the run",
    axis="rest before the run",
    needs=frozenset(["elapsed_h"]),
    one_run=quantities.ELAPSED.one_run,
)
TIME = of_signal(
    "time", "h", "comes and goes with time, otherwise in each run",
    "time since the first run began", "elapsed_h",
)  # fmt: skip
KINDS: tuple[FactorKind, ...] = (
    FactorKind(
        quantity=quantities.TEMPERATURE, groups=lambda seen, x: (splines(seen.temp, FINE_C),)
    ),
    FactorKind(
        quantity=quantities.SIDE,
        groups=lambda seen, x: (by_label(splines(seen.temp, COARSE_C), seen.side()),),
        values=lambda seen: seen.side().astype(float),
    ),
    FactorKind(quantity=quantities.RATE, groups=lambda seen, x: (corners(x),)),
    FactorKind(quantity=quantities.POSITION, groups=_positions),
    FactorKind(quantity=quantities.SINCE_MOVE, groups=_soon_after, held=_early),
    FactorKind(quantity=quantities.LAST_MOVE, groups=_levels, held=_sizes),
    FactorKind(quantity=quantities.POSITION_BEFORE, groups=_levels),
    FactorKind(quantity=quantities.HEAT_FLOW, groups=_over, held=_few),
    FactorKind(quantity=quantities.SINCE_RAMP_CHANGE, groups=_soon_after),
    FactorKind(quantity=quantities.TURNED_AT, groups=_turning_points),
    FactorKind(quantity=quantities.TIME_IN_RUN, groups=lambda seen, x: (splines(x, TIME_KNOT_S),)),
    FactorKind(quantity=REST, groups=_rests, values=Seen.rest_h),
    FactorKind(quantity=quantities.HOUR_OF_DAY, groups=_day),
    FactorKind(quantity=quantities.ELAPSED, groups=_by_run, repeatable=False),
    FactorKind(quantity=TIME, groups=_periods, repeatable=False),
)
# Of one run alone nothing tells what they follow from what time does.
SEVERAL_RUNS = frozenset({"time_in_run", "since_ramp_change", "turned_at", "run"})


def kinds_in(seen: Seen) -> Iterator[FactorKind]:
    """Yield the kinds of factors whose signals are recorded, the user's columns among them."""
    known = seen.channel.record.signals
    of_program = {one.name for one in signals() if not one.recorded}
    columns = (
        FactorKind(
            quantity=of_signal(
                one.name, one.unit, f"follows {one.name}", one.sentence.rstrip("."), one.name
            ),
            groups=_over,
            held=_few,
        )
        for one in (signal_of_column(name) for name in known if name not in of_program)
    )
    for kind in (*KINDS, *columns):
        if kind.quantity.needs <= set(known):
            yield kind


def factors_of(seen: Seen) -> tuple[Factor, ...]:
    """Return the factors a verdict may point at; one run alone tells nothing of what repeats."""
    again = seen.runs > 1
    return tuple(
        Factor(name=kind.quantity.name, groups=groups, repeatable=kind.repeatable and again)
        for kind in kinds_in(seen)
        if again or kind.quantity.name not in SEVERAL_RUNS
        if (groups := kind.groups(seen, kind.values_in(seen)))
    )


def factor_kind(seen: Seen, name: str) -> FactorKind:
    """Return a kind of factor by its name."""
    return next(kind for kind in kinds_in(seen) if kind.quantity.name == name)


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
            if wanted.shape[1] + sum(c.shape[1] for c in columns) < MOST_HELD * seen.temp.size:
                columns.append(wanted)
                break
        columns.append(corners(seen.rate))
    for kind in kinds_in(seen):
        if kind.held is not None:
            columns.append(kind.held(kind.values_in(seen)))
    return independent(np.hstack(columns))
