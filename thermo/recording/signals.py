"""Signals that an error model's terms may use, each with its unit, its column and how it is made.

A signal is made of what is known of readings: time, temperature, force, the head's angle, or a
column of the recording. One entry here, or in a user's file (`SIGNALS`), is all that a further
column needs: recorded runs, the import's mapping, the store, the emulated station, plans and
figures ask this registry.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from errormodel.arrays import FloatArray, IntArray, constant, sealed
from errormodel.errors import InputError
from errormodel.in_use import InUse
from errormodel.io.python_file import PythonFile, members_of

# The slope of temperature is a straight line over this span, or over five readings if that is
# longer: a thermistor's noise of 2 mK then leaves 1 % of a 1 °C/min ramp.
RATE_WINDOW_S = 120.0


def _no_columns() -> Mapping[str, FloatArray]:
    return {}


@dataclass(frozen=True, eq=False, kw_only=True)
class Conditions:
    """Conditions that signals are made of: n readings of one accelerometer, run by run.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        From the start of the reading's run.
    run : ndarray of int, shape (n,)
    temp_c : ndarray, shape (n,)
    position_deg : ndarray, shape (n,)
        The head's angle; NaN where it is not known.
    force_g : tuple of three ndarrays, shape (n,)
        Specific force along IA, PA, OA.
    elapsed_h : ndarray, shape (n,)
        Since the first run began.
    t_ref_c : float
    columns : mapping of str to ndarray
        What was recorded besides, by column.
    known_slow : pair of ndarray, optional
        Smooth temperature, °C, and its rate, °C/min, where they are known otherwise than by the
        readings: of an emulated accelerometer.
    known_mounting : float, optional
        The number of the mounting, where it is known.
    """

    time_s: FloatArray
    run: IntArray
    temp_c: FloatArray
    position_deg: FloatArray
    force_g: tuple[FloatArray, FloatArray, FloatArray]
    elapsed_h: FloatArray
    t_ref_c: float
    columns: Mapping[str, FloatArray] = field(default_factory=_no_columns)
    known_slow: tuple[FloatArray, FloatArray] | None = None
    known_mounting: float | None = None

    def __len__(self) -> int:
        return self.time_s.size

    @cached_property
    def smooth(self) -> tuple[FloatArray, FloatArray]:
        """The temperature without the thermistor's noise, °C, and its rate, °C/min."""
        if self.known_slow is not None:
            return self.known_slow
        return smooth_temperature(self.time_s, self.temp_c, self.run)

    @cached_property
    def mounted(self) -> Mapping[str, FloatArray]:
        """The head's angle and the number of the mounting."""
        if self.known_mounting is not None:
            number = constant(self.known_mounting, len(self))
            return {"head_deg": self.position_deg, "mounting": number}
        return mounting_signals(self.position_deg, *self.force_g[:2])


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """One signal.

    Attributes
    ----------
    name : str
        As terms use it: ``record["supply_v"]``.
    unit : str
    sentence : str
        What it is.
    make : callable, optional
        Of `Conditions`, shape (n,); by default the recorded column of the signal's name.
    columns : tuple of str
        Of the recording, that `make` needs: without one of them there is no such signal.
    recorded : bool
        Whether it is a column of a recorded run, beyond those that every run may have.
    within : pair of float
        What a recorded value may be.
    emulated : callable, optional
        Of `Conditions` without this column: what the emulated station records, and a plan assumes,
        shape (n,). One of the whole station depends on time alone.
    """

    name: str
    unit: str
    sentence: str
    make: Callable[[Conditions], FloatArray] | None = None
    columns: tuple[str, ...] = ()
    recorded: bool = False
    within: tuple[float, float] = (-1e12, 1e12)
    emulated: Callable[[Conditions], FloatArray] | None = None

    def values(self, at: Conditions) -> FloatArray | None:
        """Return the signal; None where its column is not there."""
        if self.make is not None:
            known = all(name in at.columns for name in self.columns)
            return self.make(at) if known else None
        return at.columns.get(self.name)


def smooth_temperature(
    time_s: FloatArray, temp_c: FloatArray, run: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Fit a straight line to the temperature around each reading, within its run.

    Returns
    -------
    slow_c : ndarray, shape (n,)
        The line's value at the reading, °C.
    rate_c_per_min : ndarray, shape (n,)
        Its slope, °C/min.
    """
    slow = np.array(temp_c, dtype=float)
    rate = np.zeros(temp_c.size)
    for number in np.unique(run):
        rows = np.flatnonzero(run == number)
        if rows.size >= 3:
            slow[rows], rate[rows] = _local_line(time_s[rows], temp_c[rows])
    return slow, rate


def _local_line(t: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    half = max(RATE_WINDOW_S / 2, 2.5 * float(np.median(np.diff(t))))
    lo, hi = np.searchsorted(t, t - half, "left"), np.searchsorted(t, t + half, "right")
    at, level = t - t[0], y - y.mean()

    def window_sum(values: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return total[hi] - total[lo]

    n = window_sum(np.ones_like(at))
    mean_t, mean_y = window_sum(at) / n, window_sum(level) / n
    spread = window_sum(at**2) - n * mean_t**2
    cross = window_sum(at * level) - n * mean_t * mean_y
    enough = (n >= 3) & (spread > 1e-6 * half**2)
    slope = np.where(enough, cross / np.where(enough, spread, 1.0), 0.0)
    value = np.where(enough, mean_y + slope * (at - mean_t) + y.mean(), y)
    return value, slope * 60.0


def mounting_signals(
    position_deg: FloatArray, a_i_g: FloatArray, a_p_g: FloatArray
) -> dict[str, FloatArray]:
    """Return the head's angle and the number of the mounting, as signals.

    Where the forces say another angle than the head's, the accelerometer is mounted turned on it;
    mountings are counted from 0 as they come.

    Parameters
    ----------
    position_deg : ndarray, shape (n,)
        The head's angle, °; where it is not known, that of the forces is taken.
    a_i_g, a_p_g : ndarray, shape (n,)
        Specific force along IA and PA.
    """
    own = np.degrees(np.arctan2(a_i_g, a_p_g))
    known = np.isfinite(position_deg)
    head = position_deg if known.all() else sealed(np.where(known, position_deg, own))
    own -= head
    turned = np.round(own, out=own) % 360.0
    angles, first, which = np.unique(turned, return_index=True, return_inverse=True)
    if angles.size <= 1:
        return {"head_deg": head, "mounting": constant(0.0, head.size)}
    order = np.argsort(np.argsort(first))
    return {"head_deg": head, "mounting": sealed(order[which.reshape(-1)].astype(float))}


STANDARD: tuple[Signal, ...] = (
    Signal(
        name="a_i_g",
        unit="g",
        sentence="Specific force along the input axis.",
        make=lambda at: at.force_g[0],
    ),
    Signal(
        name="a_p_g",
        unit="g",
        sentence="Specific force along the pendulous axis.",
        make=lambda at: at.force_g[1],
    ),
    Signal(
        name="a_o_g",
        unit="g",
        sentence="Specific force along the output axis.",
        make=lambda at: at.force_g[2],
    ),
    Signal(
        name="x_c",
        unit="°C",
        sentence="Temperature less the reference temperature.",
        make=lambda at: sealed(at.temp_c - at.t_ref_c),
    ),
    Signal(
        name="x_slow_c",
        unit="°C",
        sentence="The same without the noise of the thermistor.",
        make=lambda at: sealed(at.smooth[0] - at.t_ref_c),
    ),
    Signal(
        name="rate_c_per_min",
        unit="°C/min",
        sentence="Rate of temperature.",
        make=lambda at: at.smooth[1],
    ),
    Signal(
        name="elapsed_h",
        unit="h",
        sentence="Time since the first run began.",
        make=lambda at: at.elapsed_h,
    ),
    Signal(
        name="head_deg",
        unit="°",
        sentence="Angle of the indexing head.",
        make=lambda at: at.mounted["head_deg"],
    ),
    Signal(
        name="mounting",
        unit="1",
        sentence="Number of the mounting on the head, from 0.",
        make=lambda at: at.mounted["mounting"],
    ),
    Signal(
        name="chamber_c",
        unit="°C",
        sentence="Temperature of the chamber's air.",
        emulated=lambda at: at.temp_c,
    ),
    Signal(
        name="chamber_less_case_c",
        unit="°C",
        sentence="Temperature of the chamber's air less that of the accelerometer.",
        make=lambda at: sealed(at.columns["chamber_c"] - at.smooth[0]),
        columns=("chamber_c",),
    ),
)
signals: InUse[tuple[Signal, ...]] = InUse(STANDARD)
using_signals = signals.using


def recorded_signals() -> tuple[Signal, ...]:
    """Return the signals that are columns of a recorded run beyond those every run may have."""
    return tuple(one for one in signals() if one.recorded)


def with_signal_file(file: PythonFile) -> tuple[Signal, ...]:
    """Return the signals in use with those of a user's file, its `SIGNALS`.

    Raises
    ------
    InputError
        If they are no signals, or a name stands already for a column or a signal.
    """
    more = members_of(file, "SIGNALS", Signal)
    taken = {one.name for one in signals()} | RESERVED
    for one in more:
        if one.name in taken or not one.name.isidentifier():
            problem = f"{one.name!r} is in use or not a valid name; expected another, like supply_v"
            raise InputError(file.path, "SIGNALS", problem)
        taken.add(one.name)
    return (*signals(), *more)


# columns of every recorded run, of the store and of a compensated run
RESERVED = frozenset(
    ("run", "serial", "time_s", "temp_c", "position_deg", "output", "flag", "slot", "attempt",
     "segment", "lateness_s", "voided")
)  # fmt: skip


def signals_of(at: Conditions) -> dict[str, FloatArray]:
    """Return every signal that there is of some readings, by name.

    A recorded column that nothing declares any more is one, too: it was asked for in reading.
    """
    made = {one.name: one.values(at) for one in signals()}
    columns = {name: values for name, values in at.columns.items() if name not in made}
    return {**columns, **{name: values for name, values in made.items() if values is not None}}


def emulated_columns(at: Conditions, names: Sequence[str] | None = None) -> dict[str, FloatArray]:
    """Return what an emulated station records of the recorded signals, by column.

    Parameters
    ----------
    at : Conditions
    names : sequence of str, optional
        Which; by default all, and the chamber's temperature.
    """
    return {
        one.name: one.emulated(at)
        for one in signals()
        if one.emulated is not None and (names is None or one.name in names)
    }
