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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.statistics.outliers import (
    LIMIT_SIGMA,
    LINK_SIGMA,
    OVERLOAD,
    cut_off,
    sigma_of,
    smallest_step,
    stray_values,
    usual_trend,
)
from errormodel.statistics.robust import robust_sigma, running_median
from thermo.recording.readings_series import (
    AT_THE_SAME_TIME,
    SENSOR_STEP_C,
    ReadingSeries,
    all_series,
    expected_output,
    preliminary_model,
)
from thermo.recording.runs import RecordedRuns

log = logging.getLogger(__name__)

POSSIBLE_C = (-120.0, 250.0)  # of an accelerometer; −127, −273.15 and 900 are a sensor's words
OUTPUT_HALF_WINDOW = 12  # visits of the same position on either side
MOST_OUTLIERS = 0.02  # of a series; what is more frequent is no accident but structure
FEWEST = 20  # readings of a series that show what is usual in it
FEWEST_CLIPPED = 3
CLIP_SIGMA = 4.0
LIKELY_REPEATS = 1e-6  # chance of so many equal digits in a row that is called impossible
SHOWN = 3  # places named in a message


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
    for one in all_series(record, flags):
        flags |= _flat(one)
    for one in all_series(record, flags):
        flags |= _temperature_outliers(one)
    usual = {serial: preliminary_model(record, serial, flags) for serial in record.serials}
    before = len(flags)
    for serial in record.serials:
        flags |= _clipped(list(all_series(record, flags, serial)), usual[serial])
    if len(flags) > before:  # they bent it
        usual = {serial: preliminary_model(record, serial, flags) for serial in record.serials}
    structured = list[str]()
    for serial in record.serials:
        found: dict[int, str] = {}
        total = 0
        for one in all_series(record, flags, serial):
            found |= _output_outliers(one, usual[serial])
            total += len(one.rows)
        if len(found) <= max(1.0, MOST_OUTLIERS * total):
            flags |= found
        else:
            structured.append(f"{serial}: {len(found)} of {total}")
    if structured:
        log.warning(
            "%s: too many readings deviate from their neighbours to be accidental (%s); none of "
            "them is left out: the head may still move, or the output may settle after a move",
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


def _flat(one: ReadingSeries) -> dict[int, str]:
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


def _is_clipped(one: ReadingSeries, extreme: float) -> bool:
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


def _pile_up(runs: Sequence[ReadingSeries], extreme: float) -> bool:
    """Tell whether more readings of all runs have some digits than chance explains."""
    if any(np.any(one.output > extreme) and np.any(one.output < extreme) for one in runs):
        return False  # it is no end of the range
    equal = sum(int((one.output == extreme).sum()) for one in runs)
    repeats = max(_usual_repeats(one.output[one.output != extreme]) for one in runs)
    return equal >= FEWEST_CLIPPED and repeats ** (equal - 1) < LIKELY_REPEATS


def _clipped(runs: Sequence[ReadingSeries], model: FloatArray) -> dict[int, str]:
    """Find readings at an end of the range, and those that were near enough to be cut off.

    Digits that are the end in one run are so in all of them. What is left of a position just below
    the end is the lower half of its noise: readings that the model expects within the noise of the
    end go as well.
    """
    found: dict[int, str] = {}
    ends = [
        (sign, extreme)
        for one in runs
        for sign, extreme in ((-1.0, float(one.output.min())), (1.0, float(one.output.max())))
        if _is_clipped(one, extreme) or _pile_up(runs, extreme)
    ]
    for one in runs if ends else ():
        expected = expected_output(one, model)
        sigma = robust_sigma(one.output - expected)
        for sign, extreme in ends:
            cut = (one.output == extreme) | (sign * (expected - extreme) > -CLIP_SIGMA * sigma)
            found |= {int(row): "clipped" for row in one.rows[cut]}
    return found


def _temperature_outliers(one: ReadingSeries) -> dict[int, str]:
    """Find temperatures that leave what their neighbours do, and come back."""
    if len(one.rows) < FEWEST:
        return {}
    trend = usual_trend(one.time_s, one.temp_c)
    bad = stray_values(one.temp_c - trend, smallest_step(one.temp_c), SENSOR_STEP_C)
    return {int(row): "temperature_outlier" for row in one.rows[bad]}


def _output_outliers(one: ReadingSeries, model: FloatArray) -> dict[int, str]:
    """Find outputs that leave the usual curve of their position, and come back with a jump.

    A reading far from the running median of its position, taken at visits long ago and to come,
    may be in the midst of a real change. Then those beside it in time lead to it.
    """
    still = expected_output(one, model, with_rates=False)
    residual = one.output - expected_output(one, model)
    places, count = np.unique(one.place, return_counts=True)
    rare = np.isin(one.place, places[count < FEWEST])
    group = np.where(rare, -1, one.place)  # too few visits to tell: judged together
    off, bad = np.zeros(len(residual)), np.zeros(len(residual), dtype=np.bool_)
    digit = smallest_step(one.output)
    warmer = replace(one, temp_c=one.temp_c + smallest_step(one.temp_c))
    # what the thermometer's last digit may hide
    unseen = np.abs(expected_output(warmer, model, with_rates=False) - still)
    for place in np.unique(group):
        mine = np.flatnonzero(group == place)
        if len(mine) < FEWEST:
            continue
        off[mine] = residual[mine] - running_median(residual[mine], OUTPUT_HALF_WINDOW)
        sigma = sigma_of(off[mine], digit)
        suspect = np.flatnonzero(np.abs(off[mine]) > LIMIT_SIGMA * sigma + unseen[mine])
        bad[mine[cut_off(residual[mine], suspect, LINK_SIGMA * sigma)]] = True
    left_over, tolerance = np.flatnonzero(bad), LINK_SIGMA * sigma_of(off, digit)
    # what lags turns smoothly; the slopes of temperature in the model turn at once
    for left in (residual, one.output - still):
        left_over = cut_off(_as_one(left, group), left_over, tolerance)
    return {int(row): "outlier" for row in one.rows[left_over]}


def _as_one(residual: FloatArray, group: IntArray) -> FloatArray:
    """Take off what each position differs by from those visited at the same time, shape (n,)."""
    differs = residual - running_median(residual, AT_THE_SAME_TIME)
    out = residual.copy()
    for place in np.unique(group):
        out[group == place] -= np.median(differs[group == place])
    return out


# ---- what is usual ----


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


def _moved_c(one: ReadingSeries, first: int, last: int) -> float:
    span = one.temp_c[first : last + 1]
    return float(span.max() - span.min())


def _comes_back_elsewhere(one: ReadingSeries, first: int, last: int) -> bool:
    """Tell whether a constant temperature ends in a step that its neighbours do not make."""
    steps = np.abs(np.diff(one.temp_c))
    moving = steps[steps > 0]
    usual_c = float(np.quantile(moving, 0.99)) if len(moving) > FEWEST else np.inf
    after = steps[last] if last < len(steps) else 0.0
    return bool(after > 3 * usual_c + SENSOR_STEP_C)


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
