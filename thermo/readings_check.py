"""Readings that cannot be true, found before anything is computed of them.

Every rule gives a flag of its own; a flagged reading is left out by whatever uses the recording,
and stays in it. The rules, their false-alarm rates and what they cannot see are described in
docs/explanation/readings.md.

- ``no_reading``: the instrument's word for an overload, or a temperature that no accelerometer
  can have.
- ``flat_line``: the same digits again and again while the input or the temperature changed.
- ``clipped``: the same digits again and again at the end of the range.
- ``temperature_outlier``: a temperature that leaves its neighbours and comes back faster than
  the accelerometer can follow.
- ``outlier``: an output that leaves its neighbours at the same position and comes back.
"""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from errormodel.arrays import FloatArray, IntArray
from errormodel.robust import bisquare_fit, robust_sigma, running_median
from thermo.recording_check import OVERLOAD
from thermo.recording_model import RecordedRuns

log = logging.getLogger(__name__)

POSSIBLE_C = (-120.0, 250.0)  # of an accelerometer; −127, −273.15 and 900 are a sensor's words
# A normal deviate is beyond 6.5 sigma once in 1e10. The rest is for sigmas that are estimated, and
# for tails somewhat heavier than normal.
LIMIT_SIGMA = 6.5
HALF_WINDOWS = (2, 5, 25)  # readings on either side; a burst shorter than that is found
SENSOR_STEP_C = 0.05  # smaller steps of a thermistor move no output by more than its noise
OUTPUT_HALF_WINDOW = 12  # visits of the same position on either side
MOST_OUTLIERS = 0.02  # of a series; what is more frequent is no accident but structure
# thermal time constants of an accelerometer in its case
RATE_SPANS_S = (30.0, 50.0, 80.0, 120.0, 170.0, 230.0, 300.0)
FEWEST = 20  # readings of a series that show what is usual in it
SAMPLE = 6000  # readings for the preliminary model, or for which it is evaluated at once
FEWEST_CLIPPED = 3
CLIP_SIGMA = 4.0
LIKELY_REPEATS = 1e-6  # chance of so many equal digits in a row that is called impossible
SAME_INPUT_G = 0.02  # inputs closer than that are one position
ALL = slice(None)
SHOWN = 3  # places named in a message


@dataclass(frozen=True, slots=True, eq=False)
class _Series:
    """The good readings of one accelerometer in one run, in order of time."""

    serial: str
    rows: IntArray  # in the record
    time_s: FloatArray
    temp_c: FloatArray
    fastest: FloatArray  # shape (m,): usual slopes of the temperature over RATE_SPANS_S, °C/min
    output: FloatArray  # in nominal g
    place: IntArray  # which position; 0 for all where the input is unknown
    a_g: FloatArray | None  # shape (n, 3)


def flag_readings(record: RecordedRuns, place: Callable[[int], str] | None = None) -> RecordedRuns:
    """Flag the readings of a record that cannot be true.

    Readings that are flagged already are neither judged nor used.

    Parameters
    ----------
    record : RecordedRuns
    place : callable, optional
        Turns a row's index into words for the messages; the reading's time if not given.

    Returns
    -------
    RecordedRuns
        The same readings; the record itself when none is flagged.
    """

    def at_time(row: int) -> str:
        return f"at {record.time_s[row]:g} s"

    flags: dict[int, str] = {}
    flags |= _no_reading(record)
    for one in _all_series(record, flags):
        flags |= _flat(one)
    for one in _all_series(record, flags):
        flags |= _temperature_outliers(one)
    usual = {serial: _preliminary(record, serial, flags) for serial in record.serials}
    before = len(flags)
    for one in _all_series(record, flags):
        flags |= _clipped(one, usual[one.serial])
    if len(flags) > before:  # they bent it
        usual = {serial: _preliminary(record, serial, flags) for serial in record.serials}
    structured = list[str]()
    for serial in record.serials:
        found: dict[int, str] = {}
        total = 0
        for one in _all_series(record, flags, serial):
            found |= _output_outliers(one, usual[serial])
            total += len(one.rows)
        if len(found) <= max(1.0, MOST_OUTLIERS * total):
            flags |= found
        else:
            structured.append(f"{serial}: {len(found)} of {total}")
    if structured:
        log.warning(
            "%s: too many readings leave their neighbours to be accidents (%s); none of them is "
            "left out: the head may still move, or the output settle after a move",
            record.source,
            ", ".join(structured),
        )
    if not flags:
        return record
    _tell(record, flags, place or at_time)
    return record.flagged(flags)


# ---- the rules ----


def _no_reading(record: RecordedRuns) -> dict[int, str]:
    lo, hi = POSSIBLE_C
    none = np.abs(record.output) >= OVERLOAD
    none |= (record.temp_c < lo) | (record.temp_c > hi)
    return {int(row): "no_reading" for row in np.flatnonzero(none & record.good)}


def _flat(one: _Series) -> dict[int, str]:
    """Find outputs or temperatures that repeat their digits although they cannot be constant."""
    found: dict[int, str] = {}
    for first, last in _runs_of_equal(one.output, _usual_repeats(one.output, one.place)):
        if last - first + 1 == len(one.rows):
            continue  # nothing else is there to judge it by; whoever uses it says so
        inputs = len(np.unique(one.place[first : last + 1]))
        if inputs > 1 or (one.a_g is None and _moved_c(one, first, last) > 1.0):
            found |= {int(row): "flat_line" for row in one.rows[first + 1 : last + 1]}
    for first, last in _runs_of_equal(one.temp_c, _usual_repeats(one.temp_c)):
        if _comes_back_elsewhere(one, first, last):
            found |= {int(row): "flat_line" for row in one.rows[first + 1 : last + 1]}
    return found


def _is_clipped(one: _Series, extreme: float) -> bool:
    """Tell whether the readings of a position pile up at the extreme digits of a series."""
    for place in np.unique(one.place[one.output == extreme]):
        mine = one.output[one.place == place]
        equal = int((mine == extreme).sum())
        repeats = _usual_repeats(mine[mine != extreme])
        if len(mine) - equal < FEWEST:  # too few to tell what is usual: as at the other positions
            others = np.argsort(one.place, kind="stable")
            others = others[one.output[others] != extreme]
            repeats = min(repeats, _usual_repeats(one.output[others], one.place[others]))
        if equal >= FEWEST_CLIPPED and repeats ** (equal - 1) < LIKELY_REPEATS:
            return True
    return False


def _clipped(one: _Series, model: FloatArray) -> dict[int, str]:
    """Find readings at an end of the range, and those that were near enough to be cut off.

    What is left of a position just below the end is the lower half of its noise: readings that
    the model expects within the noise of the end go as well.
    """
    found: dict[int, str] = {}
    for end, extreme in ((-1.0, one.output.min()), (1.0, one.output.max())):
        if not _is_clipped(one, float(extreme)):
            continue
        expected = _expected(one, model)
        sigma = robust_sigma(one.output - expected)
        cut = (one.output == extreme) | (end * (expected - extreme) > -CLIP_SIGMA * sigma)
        found |= {int(row): "clipped" for row in one.rows[cut]}
    return found


def _temperature_outliers(one: _Series) -> dict[int, str]:
    """Find temperatures that leave the running median of their neighbours.

    The median follows a ramp, an approach to a soak and a step exactly; where a ramp turns it is
    off by less than the temperature moves within the window, which is allowed for.
    """
    bad = np.zeros(len(one.rows), dtype=np.bool_)
    if len(bad) < FEWEST:
        return {}
    for half in HALF_WINDOWS:
        median = running_median(one.temp_c, half)
        off = np.abs(one.temp_c - median)
        moved = _spread(median, 2 * half)
        bad |= off > LIMIT_SIGMA * robust_sigma(one.temp_c - median) + moved + SENSOR_STEP_C
    return {int(row): "temperature_outlier" for row in one.rows[bad]}


def _output_outliers(one: _Series, model: FloatArray) -> dict[int, str]:
    """Find outputs that leave the running median of their position, after the usual curve."""
    found: dict[int, str] = {}
    residual = one.output - _expected(one, model)
    places, count = np.unique(one.place, return_counts=True)
    rare = np.isin(one.place, places[count < FEWEST])
    group = np.where(rare, -1, one.place)  # too few visits to tell: judged together
    for place in np.unique(group):
        mine = np.flatnonzero(group == place)
        if len(mine) < FEWEST:
            continue
        off = residual[mine] - running_median(residual[mine], OUTPUT_HALF_WINDOW)
        limit = LIMIT_SIGMA * robust_sigma(off) + _step_of(one.output[mine])
        found |= {int(row): "outlier" for row in one.rows[mine[np.abs(off) > limit]]}
    return found


# ---- what is usual ----


def _preliminary(record: RecordedRuns, serial: str, flags: dict[int, str]) -> FloatArray:
    """Fit output over temperature and input roughly, by a method that outliers do not move."""
    total = int((record.serial.codes == record.serials.index(serial)).sum())
    thin = slice(None, None, max(1, total // SAMPLE))
    columns, outputs = list[FloatArray](), list[FloatArray]()
    for one in _all_series(record, flags, serial):
        a_g = None if one.a_g is None else one.a_g[thin]
        columns.append(_columns(one.temp_c[thin], _rates(one, thin), a_g))
        outputs.append(one.output[thin])
    if not columns:
        return np.zeros(0)
    return bisquare_fit(np.vstack(columns), np.concatenate(outputs))


def _columns(temp_c: FloatArray, rate: FloatArray, a_g: FloatArray | None) -> FloatArray:
    """Return the regressors of a preliminary model.

    K0 and K1 to the fourth order, the static terms, and K0 and K1 by the rate of temperature: an
    inner temperature that lags shifts both curves by what it lags, most where a ramp turns.
    """
    x = (temp_c - 25.0) / 50.0
    powers = np.vander(x, 5, increasing=True)
    lagged = np.hstack([rate, rate * x[:, None]])
    thermal = np.hstack([powers, lagged])
    if a_g is None:
        return thermal
    a_i, a_p, a_o = a_g.T
    static = np.column_stack([a_i**2, a_i**3, a_p, a_o, a_i * a_p, a_i * a_o])
    return np.hstack([thermal, thermal * a_i[:, None], static])


def _expected(one: _Series, model: FloatArray) -> FloatArray:
    """Return what a preliminary model gives, shape (n,), without all regressors at once."""
    expected = np.empty(len(one.rows))
    for begin in range(0, len(expected), SAMPLE):
        rows = slice(begin, begin + SAMPLE)
        a_g = None if one.a_g is None else one.a_g[rows]
        expected[rows] = _columns(one.temp_c[rows], _rates(one, rows), a_g) @ model
    return expected


def _usual_repeats(values: FloatArray, group: IntArray | None = None) -> float:
    """Return the chance that a reading repeats the digits of the one before it."""
    same = np.diff(values) == 0
    if group is not None:
        same = same[np.diff(group) == 0]
    # one repeat among few readings says little: the upper end of what they allow
    return (float(same.sum()) + 1.0) / (len(same) + 2.0)


def _runs_of_equal(values: FloatArray, repeats: float) -> Iterator[tuple[int, int]]:
    """Yield the first and last index of equal values in a row that chance does not explain."""
    least = FEWEST // 2
    if repeats < 1:
        least = max(least, int(np.ceil(np.log(LIKELY_REPEATS) / np.log(repeats))))
    edges = np.flatnonzero(np.diff(values) != 0)
    first = np.concatenate([[0], edges + 1])
    last = np.concatenate([edges, [len(values) - 1]])
    for a, b in zip(first.tolist(), last.tolist(), strict=True):
        if b - a >= least:
            yield a, b


def _moved_c(one: _Series, first: int, last: int) -> float:
    span = one.temp_c[first : last + 1]
    return float(span.max() - span.min())


def _comes_back_elsewhere(one: _Series, first: int, last: int) -> bool:
    """Tell whether a constant temperature ends in a step that its neighbours do not make."""
    steps = np.abs(np.diff(one.temp_c))
    moving = steps[steps > 0]
    usual_c = float(np.quantile(moving, 0.99)) if len(moving) > FEWEST else np.inf
    after = steps[last] if last < len(steps) else 0.0
    return bool(after > 3 * usual_c + SENSOR_STEP_C)


def _spread(values: FloatArray, half: int) -> FloatArray:
    """Return by how much a series moves within a window, shape (n,)."""
    size = 2 * half + 1
    high = maximum_filter1d(values, size, mode="nearest")
    return np.asarray(high - minimum_filter1d(values, size, mode="nearest"), dtype=np.float64)


def _step_of(values: FloatArray) -> float:
    """Return the smallest step between different values: the last digit, or the noise."""
    distinct = np.unique(values)
    return float(np.diff(distinct).min()) if len(distinct) > 1 else 0.0


# ---- the record ----


def _all_series(
    record: RecordedRuns, flags: dict[int, str], serial: str | None = None
) -> Iterator[_Series]:
    """Yield the readings of each accelerometer in each run that are good so far."""
    good = record.good.copy()
    good[list(flags)] = False
    force = record.specific_force_g if record.has_input else None
    key = record.run.codes * len(record.serials) + record.serial.codes
    if serial is not None:
        good &= record.serial.codes == record.serials.index(serial)
    chosen = np.flatnonzero(good)
    order = chosen[np.lexsort((record.time_s[chosen], key[chosen]))]
    for rows in np.split(order, np.flatnonzero(np.diff(key[order])) + 1):
        if not len(rows):
            continue
        run, name = record.run.at(int(rows[0])), record.serial.at(int(rows[0]))
        a_g = None if force is None else force[rows]
        # a run without any temperature was at one temperature
        temp_c = np.nan_to_num(record.temp_c[rows], nan=25.0)
        yield _Series(
            serial=name,
            rows=rows,
            time_s=record.time_s[rows],
            temp_c=temp_c,
            fastest=_fastest(record.time_s[rows], temp_c),
            output=record.output[rows] / record.scale_of(run, name).nominal_scale,
            place=_places(a_g, len(rows)),
            a_g=a_g,
        )


def _slopes(time_s: FloatArray, temp_c: FloatArray, rows: slice = ALL) -> Iterator[FloatArray]:
    """Yield the temperature's slope over each of the last `RATE_SPANS_S`, °C/min.

    Taken backwards: what lags behind the temperature goes by what it was.
    """
    for span_s in RATE_SPANS_S:
        before_c = np.interp(time_s[rows] - span_s, time_s, temp_c)
        yield 60.0 * (temp_c[rows] - before_c) / span_s


def _fastest(time_s: FloatArray, temp_c: FloatArray) -> FloatArray:
    """Return the usual slopes: those into and out of a burst of wrong values are none."""
    most = [
        1.5 * float(np.quantile(np.abs(slope), 0.95)) + 60.0 * SENSOR_STEP_C / span_s
        for span_s, slope in zip(RATE_SPANS_S, _slopes(time_s, temp_c), strict=True)
    ]
    return np.array(most)


def _rates(one: _Series, rows: slice) -> FloatArray:
    """Return the slopes of some readings, cut to what is usual, shape (n, m)."""
    slopes = np.column_stack(list(_slopes(one.time_s, one.temp_c, rows)))
    return np.clip(slopes, -one.fastest, one.fastest)


def _places(a_g: FloatArray | None, n: int) -> IntArray:
    """Return which position each reading was taken at, shape (n,)."""
    if a_g is None:
        return np.zeros(n, dtype=np.intp)
    key = np.zeros(n, dtype=np.int64)
    for column in a_g.T:  # each within ±50 000 steps, so that one number holds all three
        key = np.asarray(key * 100_003 + np.round(column / SAME_INPUT_G), dtype=np.int64)
    return np.unique(key, return_inverse=True)[1]


def _tell(record: RecordedRuns, flags: dict[int, str], where: Callable[[int], str]) -> None:
    """Say which readings are left out, by rule, run and accelerometer."""
    groups: dict[tuple[str, str, str], list[int]] = {}
    for row in sorted(flags):
        key = (flags[row], record.run.at(row), record.serial.at(row))
        groups.setdefault(key, []).append(row)
    for (flag, run, serial), rows in groups.items():
        value = "temp_c" if flag == "temperature_outlier" else "output"
        shown = ", ".join(_words(record, row, value, where) for row in rows[:SHOWN])
        more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        log.warning(
            "%s: run %s, %s: %d readings left out as %s: %s%s",
            record.source, run, serial, len(rows), flag, shown, more,
        )  # fmt: skip


def _words(record: RecordedRuns, row: int, value: str, where: Callable[[int], str]) -> str:
    lo, hi = POSSIBLE_C
    if not lo <= record.temp_c[row] <= hi:
        value = "temp_c"
    number = record.temp_c[row] if value == "temp_c" else record.output[row]
    return f"{where(row)} ({value} {number:g})"
