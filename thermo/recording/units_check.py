"""Signs that a recording is in other units than its sidecar says, each with a guess.

The commonest slips: mA for µA, radians for degrees, kelvin or °F for °C, microseconds for
seconds, a wire the other way round. Each makes a model that is wrong by orders of magnitude and
still fits.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.io.time_units import time_complaint
from errormodel.statistics.robust import bisquare_fit, robust_sigma
from thermo.recording.runs import RecordedRuns

SCALE_RANGE = (0.5, 2.0)  # of nominal; no accelerometer is made so badly
LEAST_INPUT_G = 0.5  # of span: less tells no scale
SAMPLE = 5000
# Errors of an accelerometer that works are some 1e-3 g, of one mounted askew some 0.05: readings
# further from a line are not those of their positions. Few are outliers, which are left out.
ELSEWHERE_G, MOST_ELSEWHERE = 0.2, 0.02
FULL_TURN_RAD = 6.4
RADIANS_FIT_BETTER = 0.2  # of the residual that degrees leave
KELVIN_C = 180.0  # all above: no accelerometer works there, and −93 °C in kelvin is as cold
FAHRENHEIT_C = 135.0  # above: hotter than a quartz accelerometer is tested, and −40…176 °F is usual
FOLLOWS = 0.5  # correlation: less is no scale that is wrong, but another quantity
LONG_STEP_S, TYPICAL_STEP_S = 1000.0, 3.0
OWN_SCALE = {"g": 1.0}  # output unit per g where the unit itself says it
SI_PREFIXES = {1e3: "a thousand", 1e6: "a million", 1e-3: "a thousandth", 1e-6: "a millionth"}


def checked_units(record: RecordedRuns, *, trust_units: bool) -> tuple[str, ...]:
    """Return what is doubtful about the units of a record that is used all the same.

    Raises
    ------
    InputError
        With the first of what is doubtful, unless `trust_units`.
    """
    doubts = unit_complaints(record)
    if doubts and not trust_units:
        raise InputError(record.source, "", f"{doubts[0]} (--trust-units accepts them as stated)")
    return doubts


def unit_complaints(record: RecordedRuns) -> tuple[str, ...]:
    """Return what makes the units of a record doubtful, one sentence each.

    Parameters
    ----------
    record : RecordedRuns
        Its flagged readings are not looked at.

    Returns
    -------
    tuple of str
        Empty when nothing is.
    """
    return tuple(
        sentence
        for serial in record.serials
        for sentence in _of_accelerometer(record.select(serial), serial)
    )


def _of_accelerometer(part: RecordedRuns, serial: str) -> Iterator[str]:
    good = part.take(part.good) if part.good.any() else part
    yield from (f"{serial}: {text}" for text in _times(good))
    yield from (f"{serial}: {text}" for text in _temperatures(good))
    radians = _in_radians(good)
    if radians:
        yield f"{serial}: {radians}"
    else:
        yield from (f"{serial}: {text}" for text in _scale(good))


def _times(part: RecordedRuns) -> Iterator[str]:
    steps = np.diff(part.time_s)
    steps = steps[(np.diff(part.run.codes) == 0) & (steps > 0)]
    if doubt := time_complaint(steps, LONG_STEP_S, TYPICAL_STEP_S, "time_s"):
        yield doubt


def _temperatures(part: RecordedRuns) -> Iterator[str]:
    temp_c = part.temp_c[~np.isnan(part.temp_c)]
    if len(temp_c) == 0:
        return
    lo, hi = float(temp_c.min()), float(temp_c.max())
    if lo > KELVIN_C:
        yield f"temp_c is {lo:g} to {hi:g}: is it in kelvin?"
    elif hi > FAHRENHEIT_C:
        yield f"temp_c goes up to {hi:g}: is it in °F?"
    else:
        both = ~np.isnan(part.temp_c) & ~np.isnan(part.chamber_c)
        if both.sum() < 10:
            return
        own, air = part.temp_c[both], part.chamber_c[both]
        as_c, as_f = np.median(np.abs(own - air)), np.median(np.abs((own - 32) / 1.8 - air))
        if as_c > 5.0 and as_f < 0.2 * as_c:
            yield f"temp_c is {as_c:.0f} °C from chamber_c, and agrees with it in °F: is it in °F?"


def _in_radians(part: RecordedRuns) -> str:
    """Tell positions that look like radians: small, and a better model so."""
    angle = part.position_deg
    known = ~np.isnan(angle) & ~np.isnan(part.output) & np.all(np.isnan(part.a_g), axis=1)
    angle, output = angle[known], part.output[known]
    if len(angle) < 10 or np.ptp(angle) < 3.0 or np.abs(angle).max() > FULL_TURN_RAD:
        return ""
    left = [_residual(np.sin(turn * angle), output) for turn in (np.pi / 180, 1.0)]
    if left[1] > RADIANS_FIT_BETTER * left[0]:
        return ""
    return f"position_deg goes from {angle.min():g} to {angle.max():g}: is it in radians?"


def _residual(a_i: FloatArray, output: FloatArray) -> float:
    columns = np.column_stack([np.ones(len(a_i)), a_i])
    return robust_sigma(output - columns @ bisquare_fit(columns, output))


def _scale(part: RecordedRuns) -> Iterator[str]:
    line = _line_of(part)
    scale = next(iter(part.scales.values()))
    stated, unit = scale.nominal_scale, scale.output_unit
    own = {"m/s2": scale.gravity_m_s2} | OWN_SCALE
    if unit in own and not 0.8 < abs(stated) / own[unit] < 1.25:
        yield (
            f"output_unit is {unit} and nominal_scale {stated:g} {unit} per g, "
            f"expected {own[unit]:g}"
        )
    elif line is None:
        return
    elif not line.follows and abs(line.ratio) < SCALE_RANGE[0]:
        yield "the output does not follow the positions, expected an accelerometer's"
    elif not SCALE_RANGE[0] <= line.ratio <= SCALE_RANGE[1]:
        yield _guess(part, line.ratio, scale.gravity_m_s2)
    elif line.elsewhere > MOST_ELSEWHERE:
        yield (
            f"{100 * line.elsewhere:.0f} % of the readings are more than {ELSEWHERE_G:g} g from "
            f"the input at their positions: was the head still moving, or do the positions "
            f"belong to other readings?"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """Output over input: scale factor over nominal, share of readings far off, whether it fits."""

    ratio: float
    elsewhere: float
    follows: bool


def scale_ratio(part: RecordedRuns) -> float | None:
    """Return an accelerometer's scale factor over the nominal one; None where it is not shown."""
    line = _line_of(part)
    return None if line is None else line.ratio


def _line_of(part: RecordedRuns) -> _Line | None:
    rows = np.flatnonzero(part.good)
    if not part.has_input or len(rows) < 10:
        return None
    rows = rows[:: max(1, len(rows) // SAMPLE)]
    a_i = part.specific_force_g[rows, 0]
    if np.ptp(a_i) < LEAST_INPUT_G:
        return None
    output = np.array(
        [part.output[r] / part.scale_of(part.run.at(r), part.serial.at(r)).nominal_scale
         for r in rows.tolist()]
    )  # fmt: skip
    columns = np.column_stack([np.ones(len(a_i)), a_i])
    line = bisquare_fit(columns, output)
    off_g = np.abs(output - columns @ line) / abs(float(line[1]) or 1.0)
    moves = np.ptp(output) > 0
    follows = bool(moves and abs(np.corrcoef(a_i, output)[0, 1]) > FOLLOWS)
    elsewhere = float(np.mean(off_g > ELSEWHERE_G))
    return _Line(ratio=float(line[1]), elsewhere=elsewhere, follows=follows)


def _guess(part: RecordedRuns, ratio: float, gravity_m_s2: float) -> str:
    if _is_unsigned(part):
        return (
            "the output jumps by a power of two where the input changes its sign: are signed "
            "counts written as unsigned? import with signed = true and bits"
        )
    stated = next(iter(part.scales.values()))
    found = f"{ratio * stated.nominal_scale:.3g} {stated.output_unit}/g"
    what = f"the output is {found}, the sidecar's nominal_scale says {stated.nominal_scale:g}"
    if ratio < 0:
        return f"{what}: is it wired or mounted with reversed polarity?"
    for factor, words in SI_PREFIXES.items():
        if 0.5 < ratio / factor < 2:
            return f"{what}: is output_unit or nominal_scale {words} of what it should be?"
    for factor in (gravity_m_s2, 1 / gravity_m_s2):
        if 0.8 < ratio / factor < 1.25:
            return f"{what}: is one of them in g and the other in m/s²?"
    return f"{what}; expected {SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g} times that"


def _is_unsigned(part: RecordedRuns) -> bool:
    output = part.output[~np.isnan(part.output)]
    if len(output) == 0 or output.min() < 0 or np.any(output != np.round(output)):
        return False
    return any(
        output.max() < 2.0**bits and np.mean(output > 2.0 ** (bits - 1)) > 0.02
        and np.mean(output < 2.0 ** (bits - 1)) > 0.02
        and np.mean(np.abs(output - 2.0 ** (bits - 1)) < 2.0 ** (bits - 4)) < 0.01
        for bits in (8, 12, 14, 16, 18, 20, 24, 32)
        if output.max() >= 2.0 ** (bits - 1)
    )  # fmt: skip
