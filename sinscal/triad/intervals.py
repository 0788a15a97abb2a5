"""Intervals at rest of a recording, found in raw readings of any unit.

In a window of w rows at rest the scatter about the window's mean is the sensors' noise. The
statistic is that scatter over the noise, averaged over the channels: the generalised likelihood
ratio of "at rest" against "anything else". The noise and how much the statistic scatters at rest
come from the recording: from the lowest peak of the statistic's distribution and what lies below
it, for motion only adds above.

A converter may be coarser than the noise. Then a reading at rest keeps its digits, or goes to and
fro between two of them: half a step is the least scatter that is called motion. The mean over a
rest does not tell where within the step the value lies; what that leaves is `digit_sigma`.

References
----------
B. Widrow, I. Kollár, "Quantization Noise", Cambridge 2008, chapter 4 (error of a quantised mean
with Gaussian dither).
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int
from errormodel.errors import InputError
from errormodel.statistics.outliers import smallest_step
from sinscal.recording.rows import stretches
from sinscal.recording.run import BoolArray

WINDOW_S = 0.5
SHORTEST_S = 1.0
SIGMAS = 5.0  # above the mode; of log-normal scatter, one window at rest in three million
FACTORS = (1.5, 4.0)  # the threshold over the mode is kept between: 22 % to twice the noise
SAME = 3.0  # sigmas of a sample: two stretches nearer than this are one rest with a knock
KNOCK_S = 2.0
BIN, SMOOTH = 0.05, 0.2  # of the logarithm of scatter; 0.2 is what 50 rows at rest have
SHARE = 0.05  # of the windows, and of the largest peak: less is no peak


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RestIntervals:
    """Stretches at rest, k of them.

    Attributes
    ----------
    first, last : ndarray of int, shape (k,)
        Rows, both inclusive.
    means : ndarray, shape (k, c)
        Of the channels over each.
    noise : ndarray, shape (c,)
        Sigma of one sample at rest, in the channels' units.
    digit : ndarray, shape (c,)
        Smallest step between different readings.
    digit_sigma : ndarray, shape (c,)
        Sigma of a mean from that step, which more rows do not reduce.
    step_s : float
    too_short : int
        Stretches that were at rest for less than the shortest wanted.
    rest_s, total_s : float
        Time at rest in the intervals, and of the recording.
    """

    first: IntArray
    last: IntArray
    means: FloatArray
    noise: FloatArray
    digit: FloatArray
    digit_sigma: FloatArray
    step_s: float
    too_short: int
    total_s: float

    def __post_init__(self) -> None:
        freeze(
            self,
            first=readonly_int(self.first),
            last=readonly_int(self.last),
            means=readonly(self.means),
            noise=readonly(self.noise),
            digit=readonly(self.digit),
            digit_sigma=readonly(self.digit_sigma),
        )

    def __len__(self) -> int:
        return self.first.size

    @property
    def rows(self) -> IntArray:
        """Number of rows of each, shape (k,)."""
        return self.last - self.first + 1

    @property
    def rest_s(self) -> float:
        """Time in the intervals, s."""
        return float(self.rows.sum()) * self.step_s

    def means_of(self, values: FloatArray) -> FloatArray:
        """Return the means of other channels over the intervals, shape (k, c)."""
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        return (total[self.last + 1] - total[self.first]) / self.rows[:, None]


def find_intervals(
    values: FloatArray,
    step_s: float,
    *,
    window_s: float = WINDOW_S,
    shortest_s: float = SHORTEST_S,
    source: str = "the recording",
) -> RestIntervals:
    """Find where all channels are at rest.

    Parameters
    ----------
    values : ndarray, shape (n, c)
        Raw readings: counts, g, m/s² or anything that is linear.
    step_s : float
        Time between rows.
    window_s : float
        Over which scatter is judged; a rest loses half of it at either end.
    shortest_s : float
        Shorter stretches are counted, not used.

    Raises
    ------
    InputError
        If the recording is shorter than ten windows, or holds anything but finite numbers.
    """
    window = max(round(window_s / step_s), 5)
    if values.shape[0] < 10 * window:
        raise InputError(
            source, "", f"{values.shape[0]} rows, expected ten windows of {window} at least"
        )
    if not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values).all(axis=1)))
        raise InputError(source, f"row {row + 1}", "expected finite numbers")
    digit = np.array([smallest_step(column) for column in values.T])
    scatter = np.maximum(_variance(values, window), (0.5 * digit) ** 2)
    noise2 = _quiet(scatter)
    statistic = np.mean(scatter / noise2, axis=1)
    still = np.zeros(values.shape[0], dtype=np.bool_)
    still[window // 2 : window // 2 + statistic.size] = statistic < _threshold(statistic)
    return _assemble(values, still, step_s, shortest_s, np.sqrt(noise2), digit)


def _variance(values: FloatArray, window: int) -> FloatArray:
    """Return the variance within each window, shape (n − window + 1, c)."""
    centred = values - np.mean(values, axis=0)
    parts = [
        sliding_window_view(centred[:, k], window).var(axis=1, ddof=1)
        for k in range(values.shape[1])
    ]
    return np.column_stack(parts)


def _quiet(scatter: FloatArray) -> FloatArray:
    """Return the noise variance of each channel, shape (c,)."""
    floor = np.array([np.min(c[c > 0], initial=1e-300) for c in scatter.T])
    logs = np.log(np.maximum(scatter, floor))
    return np.exp(np.array([_lowest_mode(column) for column in logs.T]))


def _lowest_mode(values: FloatArray) -> float:
    """Return the lowest peak of the values' distribution that holds a fair share of them.

    Motion that is even, like a steady turn, makes a peak too: a higher one.
    """
    edges = np.arange(values.min() - 1.0, values.max() + 1.0 + BIN, BIN)
    counts = np.histogram(values, edges)[0].astype(float)
    smooth = ndimage.gaussian_filter1d(counts, SMOOTH / BIN)
    around = ndimage.uniform_filter1d(counts, 2 * round(0.5 / BIN) + 1) * (2 * round(0.5 / BIN) + 1)
    inner = smooth[1:-1]
    peak = (inner > smooth[:-2]) & (inner >= smooth[2:])
    enough = (around[1:-1] > SHARE * values.size) & (inner > SHARE * smooth.max())
    at = int(np.flatnonzero(peak & enough)[0]) + 1 if np.any(peak & enough) else 0
    middle = 0.5 * float(edges[at] + edges[at + 1])
    near = values[np.abs(values - middle) < 0.5]
    return float(np.median(near)) if near.size else float(np.median(values))


def _threshold(statistic: FloatArray) -> float:
    logs = np.log(np.maximum(statistic, 1e-300))
    mode = _lowest_mode(logs)
    below = mode - logs[logs < mode]
    spread = float(np.median(below)) / 0.6745 if below.size else 0.0
    lo, hi = FACTORS
    return float(np.exp(mode) * np.clip(np.exp(SIGMAS * spread), lo, hi))


def _assemble(
    values: FloatArray,
    still: BoolArray,
    step_s: float,
    shortest_s: float,
    noise: FloatArray,
    digit: FloatArray,
) -> RestIntervals:
    found: list[tuple[int, int]] = []
    too_short = 0
    shortest = max(round(shortest_s / step_s), 2)
    for a, b in stretches(still):
        if b - a < shortest:
            too_short += 1
        else:
            found.append((a, b))
    joined = _joined(values, found, round(KNOCK_S / step_s), noise)
    first = np.array([a for a, _ in joined], dtype=np.intp)
    last = np.array([b - 1 for _, b in joined], dtype=np.intp)
    means = [np.mean(values[a:b], axis=0) for a, b in joined]
    within = [np.var(values[a:b], axis=0) for a, b in joined]
    unseen = np.zeros(values.shape[1])
    coarse = noise < digit  # finer ones are dither enough: e^(−2π²) of a step
    if joined and coarse.any():
        unseen[coarse] = [
            _unseen_sigma(float(v), float(q))
            for v, q in zip(np.mean(within, axis=0)[coarse], digit[coarse], strict=True)
        ]
    return RestIntervals(
        first=first,
        last=last,
        means=np.array(means).reshape(-1, values.shape[1]),
        noise=noise,
        digit=digit,
        digit_sigma=unseen,
        step_s=step_s,
        too_short=too_short,
        total_s=values.shape[0] * step_s,
    )


def _unseen_sigma(scatter2: float, digit: float) -> float:
    """Return the sigma of a mean of coarse readings, from their mean variance at rest.

    Of noise σ and step q, over all places within a step, readings have the variance
    σ² + q²/12 − B, and their means the variance B = q²/(2π²)·Σ e^(−(2πkσ/q)²)/k².
    """
    k = np.arange(1, 40)
    low, high, unseen2 = 0.0, digit, 0.0
    for _ in range(60):
        sigma = 0.5 * (low + high)
        terms = np.exp(-((2 * np.pi * k * sigma / digit) ** 2)) / k**2
        unseen2 = digit**2 / (2 * np.pi**2) * float(np.sum(terms))
        too_small = sigma**2 + digit**2 / 12 - unseen2 < scatter2
        low, high = (sigma, high) if too_small else (low, sigma)
    return float(np.sqrt(unseen2))


def _joined(
    values: FloatArray, found: list[tuple[int, int]], knock: int, noise: FloatArray
) -> list[tuple[int, int]]:
    """Keep the longer of two stretches that are the same pose with a knock between."""
    out: list[tuple[int, int]] = []
    for a, b in found:
        if out and a - out[-1][1] < knock:
            before = np.mean(values[slice(*out[-1])], axis=0)
            if np.all(np.abs(np.mean(values[a:b], axis=0) - before) < SAME * noise):
                if b - a > out[-1][1] - out[-1][0]:
                    out[-1] = (a, b)
                continue
        out.append((a, b))
    return out


def what_is_missing(intervals: RestIntervals, needed: int) -> str:
    """Say what a recording lacks that has too few rests; empty when there are enough."""
    k = len(intervals)
    if k >= needed:
        return ""
    if intervals.total_s == 0:
        return f"{k} positions, expected {needed} at least, better {2 * needed}"
    parts = [
        f"{k} rests of {SHORTEST_S:g} s or more found in {intervals.total_s:.0f} s, "
        f"expected {needed} at least, better {2 * needed}"
    ]
    if intervals.too_short:
        parts.append(
            f"{intervals.too_short} more are too short: hold each position still for 3 s or more"
        )
    share = intervals.rest_s / intervals.total_s
    if share > 0.8:
        parts.append("the recording is at rest nearly all the time: turn it to more positions")
    elif share < 0.1 and not intervals.too_short:
        noise = ", ".join(f"{v:.3g}" for v in intervals.noise)
        parts.append(
            f"the recording is hardly ever as quiet as its quietest half seconds (noise "
            f"{noise}): place it on a support instead of holding it by hand"
        )
    return "; ".join(parts)
