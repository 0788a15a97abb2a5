"""Rows across which the rate changes faster than the samples can tell.

Of a rate that jumps within a step its mean alone is known. Where in the step it jumped decides on
which side of an interval's edge a sensing mass off the axis was accelerated (20 °/s turned round
with a mass 5 cm off: 17 mm/s², over 1 s) and where the attitude stood in the mean (Δω·dt/12 from
what smooth motion has). The attitude after the jump is right all the same: only the force during it
is not used.
"""

import numpy as np
from scipy import ndimage

from errormodel.arrays import FloatArray
from sinscal.recording.run import BoolArray

# Fourth differences: central differences and the rule for the mean attitude are exact for a rate
# that is a cubic of time, and these vanish for one.
ORDER = 4
SIGMAS = 10.0  # beyond the gyros' own noise, as for shocks
# A row on either side of those that show: the derivative of theirs is taken from them.
AROUND = 1
LEAST = 1e-6  # of the largest rate: what is left of readings without noise
MOST = 0.1  # share of a cycle: more is how the rig moves, and cannot be left out


def stands_out(signals: FloatArray, sigmas: float) -> BoolArray:
    """Return which values of columns are beyond so many sigmas of their own noise.

    The noise is measured by the median, which outliers do not move.
    """
    size = np.abs(signals - np.median(signals, axis=0))
    sigma = np.median(size, axis=0) / 0.6745
    # of coarsely quantised readings most may be equal: then one step is the measure
    step = np.min(np.where(size > 0, size, np.inf), axis=0)
    return np.abs(signals) > sigmas * np.maximum(sigma, np.where(sigma > 0, 0.0, step))


def abrupt_rows(w: FloatArray) -> BoolArray:
    """Return the rows in which the rate changes abruptly, shape (n,).

    Parameters
    ----------
    w : ndarray, shape (n, 3)
        Step means of one cycle's rates, in any unit.
    """
    marked = np.zeros(w.shape[0], dtype=np.bool_)
    if w.shape[0] > 4 * ORDER:
        half = ORDER // 2
        left = np.diff(w, ORDER, axis=0)
        seen = np.abs(left) > LEAST * np.max(np.abs(w))
        inside = (stands_out(left, SIGMAS) & seen).any(axis=1)
        marked = np.pad(inside, half, mode="edge")  # a cycle may begin and end in a jump
    marked = ndimage.binary_dilation(marked, iterations=AROUND)
    return marked & bool(np.mean(marked) <= MOST)
