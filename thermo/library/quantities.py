"""Quantities of a reading that an error may follow: of its temperature, its head, its time.

A residual is looked at over each of them, and a term may be a function of one. Those with a memory
are as exact reading by reading as over a whole run.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Memory, Values, by_run
from thermo.library.moves import TURNED_DEG, last_changes

# The temperature must go back by so much before it has turned: several times what a thermistor's
# noise leaves of the smoothed one.
TURNED_C = 0.3
DAY_H = 24.0

OneRun = Callable[[Record, slice, Memory], tuple[FloatArray, Memory]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A quantity of a reading that an error may follow.

    Attributes
    ----------
    name : str
    unit : str
    words : str
        What an error does that follows it.
    axis : str
        What it is, for a picture.
    needs : frozenset of str
        Signals that it is made of.
    one_run : callable
        Of a record, the readings of one run and a memory: its values, and the memory to go on.
    """

    name: str
    unit: str
    words: str
    axis: str
    needs: frozenset[str]
    one_run: OneRun

    def columns(self, record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        """Return its values as a term's column, shape (n, 1), and the memory after them."""

        def one_run(
            record: Record, readings: slice, values: Values, memory: Memory
        ) -> tuple[FloatArray, Memory]:
            return self.one_run(record, readings, memory)

        return by_run(one_run)(record, values, memory)

    def of(self, record: Record) -> FloatArray:
        """Return its values in a record, shape (n,)."""
        return self.columns(record, {}, None)[0][:, 0]


def of_signal(name: str, unit: str, words: str, axis: str, signal: str) -> Quantity:
    """Return a quantity that is a signal."""
    return Quantity(
        name=name,
        unit=unit,
        words=words,
        axis=axis,
        needs=frozenset([signal]),
        one_run=lambda record, readings, memory: (record[signal][readings], memory),
    )


@numba.njit(cache=True)
def _ramp(
    time_s: FloatArray, x: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the side (1 heating, −1 cooling, 0 before), and since when and from where it is.

    `state` is changed: side, extreme and its time, begin of the side and the temperature there.
    """
    side, since_s, from_c = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for k in range(x.size):
        if state[0] == 0.0:
            away = x[k] - state[1]
            if abs(away) > TURNED_C:
                state[0] = 1.0 if away > 0.0 else -1.0
                state[1], state[2] = x[k], time_s[k]
        elif state[0] * (x[k] - state[1]) >= 0.0:
            state[1], state[2] = x[k], time_s[k]
        elif state[0] * (state[1] - x[k]) > TURNED_C:
            state[0] = -state[0]
            state[3], state[4] = state[2], state[1]
            state[1], state[2] = x[k], time_s[k]
        side[k], since_s[k], from_c[k] = state[0], time_s[k] - state[3], state[4]
    return side, since_s, from_c


def _of_ramp(which: int) -> OneRun:
    def one_run(record: Record, readings: slice, memory: Memory) -> tuple[FloatArray, Memory]:
        time_s = np.ascontiguousarray(record.time_s[readings])
        x = np.ascontiguousarray(record["x_slow_c"][readings])
        before = memory or (0.0, float(x[0]), float(time_s[0]), float(time_s[0]), float(x[0]))
        state = np.array(before)
        made = _ramp(time_s, x, state)
        return made[which], tuple(state.tolist())

    return one_run


def _of_head(values: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]) -> OneRun:
    """Return a quantity of the time since the last turn, its size and the present angle."""

    def one_run(record: Record, readings: slice, memory: Memory) -> tuple[FloatArray, Memory]:
        time_s, head = record.time_s[readings], record["head_deg"][readings]
        begun_s, before = memory or (float(time_s[0]), None)
        since_s, size, after = last_changes(time_s, head, TURNED_DEG, before)
        return values(np.minimum(since_s, time_s - begun_s), size, head), (begun_s, after)

    return one_run


_RAMP, _HEAD = frozenset(["x_slow_c"]), frozenset(["head_deg"])
TEMPERATURE = of_signal(
    "temperature", "°C", "follows temperature, the same on the way up and down",
    "temperature less the reference temperature", "x_slow_c",
)  # fmt: skip
RATE = of_signal(
    "rate", "°C/min", "follows the rate of temperature", "rate of temperature", "rate_c_per_min"
)
HEAT_FLOW = of_signal(
    "chamber_less_case", "°C", "follows the difference between chamber and accelerometer",
    "chamber less accelerometer", "chamber_less_case_c",
)  # fmt: skip
POSITION = of_signal(
    "position", "°", "depends on the position of the head", "position of the head", "head_deg"
)
SINCE_MOVE = Quantity(
    name="since_move",
    unit="s",
    words="depends on the time since the head last turned",
    axis="time since the head turned",
    needs=_HEAD,
    one_run=_of_head(lambda since_s, size, head: since_s),
)
LAST_MOVE = Quantity(
    name="last_move",
    unit="°",
    words="depends on how far and which way the head last turned",
    axis="last turn of the head",
    needs=_HEAD,
    one_run=_of_head(lambda since_s, size, head: size),
)
POSITION_BEFORE = Quantity(
    name="position_before",
    unit="°",
    words="depends on the position of the head before its last turn",
    axis="position of the head before its last turn",
    needs=_HEAD,
    one_run=_of_head(lambda since_s, size, head: head - size),
)
SIDE = Quantity(
    name="direction",
    unit="1",
    words="differs between heating and cooling at the same temperature",
    axis="heating or cooling",
    needs=_RAMP,
    one_run=_of_ramp(0),
)
SINCE_RAMP_CHANGE = Quantity(
    name="since_ramp_change",
    unit="s",
    words="depends on the time since heating or cooling last began",
    axis="time since heating or cooling began",
    needs=_RAMP,
    one_run=_of_ramp(1),
)
TURNED_AT = Quantity(
    name="turned_at",
    unit="°C",
    words="depends on the temperature at which heating or cooling last began",
    axis="temperature at which the ramp began, less the reference temperature",
    needs=_RAMP,
    one_run=_of_ramp(2),
)
TIME_IN_RUN = Quantity(
    name="time_in_run",
    unit="s",
    words="depends on the time since the run began, the same in every run",
    axis="time in the run",
    needs=frozenset(),
    one_run=lambda record, readings, memory: (record.time_s[readings], memory),
)
HOUR_OF_DAY = Quantity(
    name="hour_of_day",
    unit="h",
    words="has the period of a day",
    axis="hours of a day, from the start of the first run",
    needs=frozenset(["elapsed_h"]),
    one_run=lambda record, readings, memory: (record["elapsed_h"][readings] % DAY_H, memory),
)
ELAPSED = of_signal(
    "run", "h", "differs from run to run", "time since the first run began", "elapsed_h"
)
QUANTITIES: dict[str, Quantity] = {
    one.name: one
    for one in (
        TEMPERATURE, RATE, HEAT_FLOW, POSITION, SINCE_MOVE, LAST_MOVE, POSITION_BEFORE, SIDE,
        SINCE_RAMP_CHANGE, TURNED_AT, TIME_IN_RUN, HOUR_OF_DAY, ELAPSED,
    )
}  # fmt: skip
