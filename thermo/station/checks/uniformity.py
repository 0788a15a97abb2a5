"""Uniformity of ramps at the accelerometer, and comparison with the self-heating of the SINS."""

from collections.abc import Sequence as Many
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from thermo.planning.legs import FloatArray, Leg
from thermo.planning.plan import Plan
from thermo.planning.sequence import SelfHeating, Uniformity

MIN_POINTS = 3  # of a line with a sigma
# Noise puts a slope outside the band when it is beyond it by more than this many sigmas in 0.3 %.
NOISE_SIGMAS = 3.0
MAD = 1.4826  # sigma of normal values over their median absolute deviation


@dataclass(frozen=True, slots=True, kw_only=True)
class RampVerdict:
    """One ramp at one accelerometer; rates in °C/min.

    Attributes
    ----------
    serial : str
    run, segment : int
    commanded, measured, measured_sigma : float
        The commanded rate, the median of the local slopes and the median of their sigmas; nan
        when there were too few readings.
    share_inside : float
        Of the readings after the transient, those whose local slope is inside the band.
    half_band : float
        Half the width of the band.
    readings : int
        Number of readings used.
    longest_outside_min : float
        The longest time without a slope inside the band, or without a reading.
    unread_min : float
        Time at the end of the ramp in which nothing was read.
    noise_c : float
        Noise of the thermistor: a slope is outside when it is beyond the band by more than 3 sigma.
    slope_gain : float
        Sigma of a slope for a noise of 1 °C, median, 1/min.
    passed : bool
    sins_rate, mismatch_percent : float or None
        The self-heating rate of the SINS, and the difference of the measured rate from it.
    sentence : str
    """

    serial: str
    run: int
    segment: int
    commanded: float
    measured: float
    measured_sigma: float
    share_inside: float
    half_band: float
    readings: int
    longest_outside_min: float
    unread_min: float
    noise_c: float
    slope_gain: float
    passed: bool
    sins_rate: float | None
    mismatch_percent: float | None
    sentence: str


def local_slopes(
    time_s: ArrayLike, temp_c: ArrayLike, window_s: float
) -> tuple[FloatArray, FloatArray]:
    """Fit a straight line about every reading.

    Parameters
    ----------
    time_s, temp_c : array_like, shape (n,)
        In order of time; °C.
    window_s : float
        Full width of the window about a reading, s; at the ends it is cut, not shifted.

    Returns
    -------
    slope, sigma : ndarray, shape (n,)
        °C/min; nan where the window holds fewer than three readings or one moment only. The
        sigma is that of least squares, from the window's own scatter.
    """
    time = np.asarray(time_s, dtype=np.float64)
    temp = np.asarray(temp_c, dtype=np.float64)
    slope, sigma = np.full(time.size, np.nan), np.full(time.size, np.nan)
    if time.size < MIN_POINTS:
        return slope, sigma
    # sums over windows as differences of running sums, about the means to keep the digits
    t, y = (time - time.mean()) / 60, temp - temp.mean()
    low = np.searchsorted(time, time - window_s / 2 - 1e-9, side="left")
    high = np.searchsorted(time, time + window_s / 2 + 1e-9, side="right")

    def window_sum(values: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return total[high] - total[low]

    n = (high - low).astype(np.float64)
    t_mean, y_mean = window_sum(t) / n, window_sum(y) / n
    tt = window_sum(t * t) - n * t_mean**2
    ty = window_sum(t * y) - n * t_mean * y_mean
    yy = window_sum(y * y) - n * y_mean**2
    enough = (n >= MIN_POINTS) & (tt > 1e-12)
    slope[enough] = ty[enough] / tt[enough]
    left = np.clip(yy[enough] - slope[enough] * ty[enough], 0.0, None)
    sigma[enough] = np.sqrt(left / (n[enough] - 2) / tt[enough])
    return slope, sigma


def _slope_gain(time_s: FloatArray, window_s: float) -> FloatArray:
    """Return the sigma of each local slope for a noise of 1 °C, °C/min, shape (n,)."""
    low = np.searchsorted(time_s, time_s - window_s / 2 - 1e-9, side="left")
    high = np.searchsorted(time_s, time_s + window_s / 2 + 1e-9, side="right")
    t = (time_s - time_s.mean()) / 60 if time_s.size else time_s
    total, square = (np.concatenate([[0.0], np.cumsum(v)]) for v in (t, t * t))
    n = np.maximum(high - low, 1)
    spread = square[high] - square[low] - (total[high] - total[low]) ** 2 / n
    return np.asarray(1.0 / np.sqrt(np.maximum(spread, 1e-12)))


def thermistor_noise(time_s: ArrayLike, temp_c: ArrayLike) -> float:
    """Estimate a thermistor's noise from readings of a moving temperature, °C.

    The difference between a reading and the straight line through its neighbours contains no slope;
    the median of its size is not affected by stops and jumps.

    Parameters
    ----------
    time_s, temp_c : array_like, shape (n,)
        In order of time. With fewer than three readings the noise is 0.
    """
    t, y = np.asarray(time_s, dtype=np.float64), np.asarray(temp_c, dtype=np.float64)
    if t.size < 3:
        return 0.0
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    apart = y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]
    size = np.abs(apart) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    return MAD * float(np.median(size))


def longest_outside_s(time_s: FloatArray, outside: NDArray[np.bool_]) -> float:
    """Return the longest time without a slope inside the band, s; gaps in the readings count."""
    inside = time_s[~outside]
    if time_s.size < 2:
        return 0.0
    step = float(np.median(np.diff(time_s)))
    edges = np.concatenate([[time_s[0] - step], inside, [time_s[-1] + step]])
    return (
        max(float(np.max(np.diff(edges))) - step, 0.0) if edges.size > 2 else float(np.ptp(time_s))
    )


def self_heating_rate(
    rate_c_per_min: float | None, table: SelfHeating | None, low_c: float, high_c: float
) -> float | None:
    """Return the mean self-heating rate of the SINS over a range of temperature, °C/min.

    Parameters
    ----------
    rate_c_per_min : float or None
        Stated as one number.
    table : SelfHeating or None
        Or as a curve over time; the part between the temperatures is used, or the whole curve if it
        does not reach them.
    low_c, high_c : float
        °C.
    """
    if table is None:
        return rate_c_per_min
    minutes, temps = np.array(table.time_min), np.array(table.temp_c)
    inside = (temps >= low_c) & (temps <= high_c)
    if np.count_nonzero(inside) >= 2:
        minutes, temps = minutes[inside], temps[inside]
    return abs(float((temps[-1] - temps[0]) / (minutes[-1] - minutes[0])))


def judge_ramp(
    time_s: ArrayLike,
    temp_c: ArrayLike,
    leg: Leg,
    rule: Uniformity,
    *,
    serial: str,
    run: int,
    begin_s: float | None = None,
) -> RampVerdict:
    """Return the verdict on one ramp at one accelerometer.

    Parameters
    ----------
    time_s, temp_c : array_like, shape (n,)
        The accelerometer's own temperature during the ramp, in order of time; nan is left out.
    leg : Leg
        What was commanded.
    rule : Uniformity
    serial : str
    run : int
    begin_s : float, optional
        Start of the ramp on `time_s`; the first reading if not given.

    Returns
    -------
    RampVerdict
    """
    time, temp = np.asarray(time_s, dtype=np.float64), np.asarray(temp_c, dtype=np.float64)
    good = np.isfinite(time) & np.isfinite(temp)
    time, temp = time[good], temp[good]
    start_s = begin_s if begin_s is not None else (time[0] if time.size else 0.0)
    settled = time >= start_s + 60 * rule.transient_min
    time, temp = time[settled], temp[settled]
    slope, sigma = local_slopes(time, temp, 60 * rule.window_min)
    known = np.isfinite(slope)
    time, temp, slope, sigma = time[known], temp[known], slope[known], sigma[known]
    commanded = leg.rate_c_per_min
    half_band = rule.band_c_per_min or rule.band_fraction * abs(commanded)
    judged = int(slope.size)
    noise_c = thermistor_noise(time, temp)
    gain = _slope_gain(time, 60 * rule.window_min)
    reach = half_band + NOISE_SIGMAS * noise_c * gain
    outside = np.abs(slope - commanded) > reach
    share = float(np.mean(~outside)) if judged else 0.0
    longest_min = longest_outside_s(time, outside) / 60
    unread_s = float(start_s + leg.end_s - leg.start_s - time[-1]) if judged else 0.0
    unread_min = max(unread_s, 0.0) / 60
    measured = float(np.median(slope)) if judged else float("nan")
    low_c, high_c = sorted((leg.start_c, leg.end_c))
    sins = self_heating_rate(
        rule.sins_self_heating_rate_c_per_min, rule.sins_self_heating, low_c, high_c
    )
    mismatch = None if not sins or not judged else 100 * (abs(measured) - sins) / sins
    # a long ramp could hide a stop in its share, so the rate may never be outside for longer than a
    # window
    passed = bool(
        judged > 0
        and share >= rule.min_share_inside
        and max(longest_min, unread_min) <= rule.window_min
    )
    verdict = RampVerdict(
        serial=serial,
        run=run,
        segment=leg.index,
        commanded=commanded,
        measured=measured,
        measured_sigma=float(np.median(sigma)) if judged else float("nan"),
        share_inside=share,
        half_band=half_band,
        readings=judged,
        longest_outside_min=longest_min,
        unread_min=unread_min,
        noise_c=noise_c,
        slope_gain=float(np.median(gain)) if judged else 0.0,
        passed=passed,
        sins_rate=sins,
        mismatch_percent=mismatch,
        sentence="",
    )
    return _with_sentence(verdict, rule)


def _with_sentence(verdict: RampVerdict, rule: Uniformity) -> RampVerdict:
    place = f"{verdict.serial}, run {verdict.run}, segment {verdict.segment}"
    if verdict.readings == 0:
        sentence = (
            f"{place}: no verdict: fewer than {MIN_POINTS} readings in {rule.window_min:g} min "
            f"after the transient of {rule.transient_min:g} min"
        )
    else:
        word = "uniform" if verdict.passed else "not uniform"
        sentence = (
            f"{place}: {word}: {verdict.measured:+.3f} ± {verdict.measured_sigma:.1g} °C/min for "
            f"{verdict.commanded:+.3f} commanded, {100 * verdict.share_inside:.1f} % of "
            f"{verdict.readings} readings within ±{verdict.half_band:.3f} "
            f"({100 * rule.min_share_inside:g} % are required)"
        )
        if max(verdict.longest_outside_min, verdict.unread_min) > rule.window_min:
            what = (
                "outside" if verdict.longest_outside_min > rule.window_min else "unread at its end"
            )
            longest = max(verdict.longest_outside_min, verdict.unread_min)
            sentence += f"; {what} for {longest:.1f} min in a row ({rule.window_min:g} are allowed)"
        blur = NOISE_SIGMAS * verdict.noise_c * verdict.slope_gain
        if blur > verdict.half_band:
            sentence += (
                f"; the thermistor's noise of {verdict.noise_c:.2g} °C hides differences of less "
                f"than {verdict.half_band + blur:.2g} °C/min"
            )
        if verdict.mismatch_percent is not None:
            sentence += (
                f"; the SINS warms up at {verdict.sins_rate:.3f} °C/min, mismatch "
                f"{verdict.mismatch_percent:+.1f} %"
            )
    return replace(verdict, sentence=sentence)


def judge_test(plan: Plan, readings: pd.DataFrame) -> tuple[RampVerdict, ...]:
    """Return the verdict on every ramp of a test for every accelerometer.

    Parameters
    ----------
    plan : Plan
    readings : DataFrame
        As `Store.readings` gives them; voided ones are left out.

    Returns
    -------
    tuple of RampVerdict
        In order of run, segment and serial number.
    """
    valid = readings[readings["voided"] == ""] if "voided" in readings else readings
    verdicts: list[RampVerdict] = []
    runs: Many[int] = sorted(int(run) for run in valid["run"].unique())
    for run in runs:
        of_run = valid[valid["run"] == run]
        for leg in plan.legs:
            if not leg.is_ramp:
                continue
            of_leg = of_run[of_run["segment"] == leg.index]
            for accelerometer in plan.sequence.accelerometers:
                own = of_leg[of_leg["serial"] == accelerometer.serial].sort_values("time_s")
                verdicts.append(
                    judge_ramp(
                        own["time_s"].to_numpy(),
                        own["temp_c"].to_numpy(dtype=float, na_value=np.nan),
                        leg,
                        plan.sequence.uniformity,
                        serial=accelerometer.serial,
                        run=run,
                    )
                )
    return tuple(verdicts)
