"""Time over which the attitude can be carried by what is known of the sensors.

A filter linearised about gyros that are 1 % wrong is lost after a few turns: after 450 s at 10 °/s
the attitude is 45° off, and its iteration diverges. So the first nominal is found from the first
part of each cycle, as far as the covariance says that the attitude is known; what that part shows
of the gyros carries it on into the next, until all is taken in.
"""

from itertools import pairwise

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Steps
from sinscal.filter.layout import RigLayout
from sinscal.recording.run import BoolArray

# Of an attitude angle: what is left out of the linearisation is half its square, 1 %.
KNOWN_RAD = 0.15
LEAST_INTERVALS = 20  # of a first part; less shows nothing
GROWTH = 1.2  # of a part over the one before, at least


def _begins(steps: Steps, layout: RigLayout) -> BoolArray:
    """Return which steps begin a cycle, in which the attitude becomes a copy of its start."""
    starts = [layout.start(k).start for k in range(layout.cycles)]
    return np.asarray(steps.phi[:, 0, starts].any(axis=1))


def attitude_sigmas(steps: Steps, layout: RigLayout, cov: FloatArray) -> FloatArray:
    """Return the sigma of the attitude against that at its cycle's start, after each step, rad.

    Parameters
    ----------
    steps : Steps
        K of them; of each cycle the first is the one in which it begins.
    layout : RigLayout
    cov : ndarray, shape (n, n)
        Of the states; only constants but the starts count, no noise.

    Returns
    -------
    ndarray, shape (K,)
    """
    lead = layout.moving
    begins = _begins(steps, layout)
    by = np.zeros((3, layout.size - lead))
    known = cov[lead:, lead:]
    out = np.empty(begins.size)
    for k, phi in enumerate(steps.phi):
        by = np.zeros_like(by) if begins[k] else phi[:3, :3] @ by + phi[:3, lead:]
        out[k] = np.sqrt(np.max(np.einsum("ij,jk,ik->i", by, known, by)))
    return out


def intervals_within_reach(steps: Steps, layout: RigLayout, cov: FloatArray, before: int) -> int:
    """Return how many intervals of each cycle can be taken in, more than the `before` ones.

    Parameters
    ----------
    steps, layout, cov
        As of `attitude_sigmas`.
    before : int
        How many have been.
    """
    lost = attitude_sigmas(steps, layout, cov) > KNOWN_RAD
    edges = [*np.flatnonzero(_begins(steps, layout)).tolist(), lost.size]
    longest = reached = max(b - a for a, b in pairwise(edges)) - 1
    for a, b in pairwise(edges):
        if lost[a:b].any():
            reached = min(reached, int(np.argmax(lost[a:b])) - 1)
    return min(max(reached, LEAST_INTERVALS, int(GROWTH * before)), longest)
