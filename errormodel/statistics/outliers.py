"""Values of a series that leave their neighbours and come back: outliers, single or in bursts."""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from errormodel.arrays import BoolArray, FloatArray, IntArray
from errormodel.statistics.robust import robust_sigma, running_median

OVERLOAD = 9.9e37  # what SCPI instruments give for an overload (and 9.91e37 for no number)
# A normal deviate is beyond 6.5 sigma once in 1e10. The rest is for sigmas that are estimated, and
# for tails somewhat heavier than normal.
LIMIT_SIGMA = 6.5
HALF_WINDOWS = (2, 5, 25)  # values on either side; a burst shorter than that is found
LONGEST_BURST = 12  # values; at an end of a series the median sees half a window of others
DIGIT_SIGMA = 0.74  # of a digit: 0.5/Φ⁻¹(3/4); with more noise than that most digits change
LINK_SIGMA = 4.0  # neighbours nearer than that belong together
REACH = 2  # over one outlier on the way
ROUNDING = 1e-12  # of the range: less is no step but the machine's
TREND_WINDOW = 5  # steps on either side


def usual_trend(at: FloatArray, values: FloatArray) -> FloatArray:
    """Return what a series does but for outliers: its usual slopes added up, shape (n,).

    The slope at a step is the median of those about it, which outliers do not move and which
    follows a ramp, its turn and an approach to a soak.

    Parameters
    ----------
    at : ndarray, shape (n,)
        Increasing: the times of the values.
    values : ndarray, shape (n,)
    """
    steps = np.diff(at)
    slope = running_median(np.diff(values) / steps, TREND_WINDOW)
    return np.concatenate([[0.0], np.cumsum(slope * steps)])


def sigma_of(off: FloatArray, digit: float) -> float:
    """Return a robust sigma of deviations that come in steps of a digit.

    Most of them may be 0: noise up to 0.74 of a digit can hide so.
    """
    return max(robust_sigma(off), DIGIT_SIGMA * digit)


def stray_values(values: FloatArray, digit: float, least: float = 0.0) -> BoolArray:
    """Tell the values that leave the running median of their neighbours, shape (n,).

    Where the series itself moves, the median is off by less than that within the window, which is
    allowed for: a ramp, a turn and a lasting step lose nothing.

    Parameters
    ----------
    values : ndarray, shape (n,)
    digit : float
        Smallest step of the values as they were read.
    least : float
        Smaller deviations are none.
    """
    stray = np.zeros(len(values), dtype=np.bool_)
    for half in HALF_WINDOWS:
        median = running_median(values, half)
        off = values - median
        moved = _spread(median, 2 * half)
        stray |= np.abs(off) > LIMIT_SIGMA * sigma_of(off, digit) + moved + least
    return stray


def cut_off(values: FloatArray, suspects: IntArray, tolerance: float) -> IntArray:
    """Return those of some suspects that no chain of neighbours links to the rest of the series.

    Neighbours, with at most one value between them, are linked when they differ by less than a
    tolerance. A real excursion, however steep, leads back step by step; a burst of wrong values
    begins and ends with a jump. What hangs together for longer than a burst is real, too.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In order of time.
    suspects : ndarray of int, shape (k,)
        Places in `values`.
    tolerance : float

    Returns
    -------
    ndarray of int, shape (m,)
    """
    if not len(suspects):
        return suspects
    near = np.zeros(len(values), dtype=np.bool_)
    near[suspects] = True
    near = maximum_filter1d(near.astype(np.uint8), 4 * LONGEST_BURST + 1, mode="constant") > 0
    rows = np.flatnonzero(near)
    some = values[rows]
    first, second = list[IntArray](), list[IntArray]()
    for lag in range(1, min(REACH, len(rows) - 1) + 1):
        linked = np.abs(some[lag:] - some[:-lag]) < tolerance
        linked &= rows[lag:] - rows[:-lag] == lag
        first.append(np.flatnonzero(linked))
        second.append(first[-1] + lag)
    if not first:
        return suspects
    a, b = np.concatenate(first), np.concatenate(second)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(rows), len(rows)))
    label = connected_components(graph, directed=False)[1]
    size = np.bincount(label)
    of_suspects = size[label[np.searchsorted(rows, suspects)]]
    return suspects[of_suspects <= LONGEST_BURST]


def smallest_step(values: FloatArray) -> float:
    """Return the smallest step between different values: the last digit, or the noise."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > ROUNDING * float(steps.sum())]
    return float(steps.min()) if len(steps) else 0.0


def _spread(values: FloatArray, half: int) -> FloatArray:
    """Return by how much a series moves within a window, shape (n,)."""
    size = 2 * half + 1
    high = maximum_filter1d(values, size, mode="nearest")
    return np.asarray(high - minimum_filter1d(values, size, mode="nearest"), dtype=np.float64)
