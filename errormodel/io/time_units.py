"""Signs that times said to be in seconds are in another unit."""

import numpy as np

from errormodel.arrays import FloatArray

UNITS = ("ms", "µs", "ns")
FEWEST = 10  # steps that show what is usual


def time_complaint(steps_s: FloatArray, longest_s: float, typical_s: float, name: str) -> str:
    """Return what makes the unit of some times doubtful; empty when nothing does.

    Parameters
    ----------
    steps_s : ndarray, shape (n,)
        From reading to reading, positive.
    longest_s : float
        From here on a usual step is doubtful.
    typical_s : float
        Step of an ordinary recording of the kind: the unit that comes nearest is the guess.
    name : str
        Of the times, for the sentence.
    """
    if len(steps_s) < FEWEST:
        return ""
    usual_s = float(np.median(steps_s))
    if usual_s >= longest_s:
        off = np.abs(np.log10(usual_s / typical_s) - np.array([3.0, 6.0, 9.0]))
        unit = UNITS[int(np.argmin(off))]
        return f"{name} grows by {usual_s:g} from reading to reading: are the times in {unit}?"
    for factor, unit in ((1e3, "ms"), (1e6, "µs")):
        long = np.abs(steps_s / (factor * usual_s) - 1) < 0.01
        if long.sum() >= 3:
            return (
                f"{int(long.sum())} steps of {name} are {factor:g} times the usual "
                f"{usual_s:g} s: are some of the times in {unit}?"
            )
    return ""
