"""The readings of one accelerometer in one run, and what its output usually is.

A preliminary model, fitted by a method that outliers do not move: rough, but good enough to tell
what is not usual.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.statistics.robust import bisquare_fit, running_median
from thermo.recording.runs import RecordedRuns

SENSOR_STEP_C = 0.05  # smaller steps of a thermistor move no output by more than its noise
# thermal time constants of an accelerometer in its case
RATE_SPANS_S = (30.0, 50.0, 80.0, 120.0, 170.0, 230.0, 300.0)
SAMPLE = 6000  # readings for the preliminary model, or for which it is evaluated at once
SAME_INPUT_G = 0.02  # inputs closer than that are one position
AT_THE_SAME_TIME = 25  # readings on either side
ALL = slice(None)


@dataclass(frozen=True, slots=True, eq=False)
class ReadingSeries:
    """The good readings of one accelerometer in one run, in order of time."""

    serial: str
    rows: IntArray  # in the record
    time_s: FloatArray
    temp_c: FloatArray
    fastest: FloatArray  # shape (m,): usual slopes of the temperature over RATE_SPANS_S, °C/min
    output: FloatArray  # in nominal g
    place: IntArray  # which position; 0 for all where the input is unknown
    a_g: FloatArray | None  # shape (n, 3)


def preliminary_model(record: RecordedRuns, serial: str, flags: dict[int, str]) -> FloatArray:
    """Fit output over temperature and input roughly, by a method that outliers do not move.

    Fitted twice: what the first leaves at all positions alike, a step or a loop, is taken off
    before the second, which it would bend.
    """
    total = int((record.serial.codes == record.serials.index(serial)).sum())
    thin = slice(None, None, max(1, total // SAMPLE))
    runs = list(all_series(record, flags, serial))
    if not runs:
        return np.zeros(0)
    columns = np.vstack(
        [
            _columns(
                one.temp_c[thin], _rates(one, thin), None if one.a_g is None else one.a_g[thin]
            )
            for one in runs
        ]
    )
    output = [one.output[thin] for one in runs]
    model = bisquare_fit(columns, np.concatenate(output))
    common = [
        running_median(one.output - expected_output(one, model), AT_THE_SAME_TIME)[thin]
        for one in runs
    ]
    return bisquare_fit(columns, np.concatenate(output) - np.concatenate(common))


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


def expected_output(
    one: ReadingSeries, model: FloatArray, *, with_rates: bool = True
) -> FloatArray:
    """Return what a preliminary model gives, shape (n,), in nominal g.

    Parameters
    ----------
    one : ReadingSeries
    model : ndarray, shape (p,)
        From `preliminary_model`.
    with_rates : bool
        Whether what follows the slope of temperature is in it.
    """
    expected = np.empty(len(one.rows))
    for begin in range(0, len(expected), SAMPLE):  # without room for all regressors at once
        rows = slice(begin, begin + SAMPLE)
        a_g = None if one.a_g is None else one.a_g[rows]
        rates = _rates(one, rows) * with_rates
        expected[rows] = _columns(one.temp_c[rows], rates, a_g) @ model
    return expected


def all_series(
    record: RecordedRuns, flags: dict[int, str], serial: str | None = None
) -> Iterator[ReadingSeries]:
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
        yield ReadingSeries(
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


def _rates(one: ReadingSeries, rows: slice) -> FloatArray:
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
