"""Is the force reported upside down? Only the earth's rotation can tell.

A triad reversed as a whole turns as a sound one does. But the gyros feel the earth's rotation,
whose part along the upward force is Ω sin φ. Over whole turns the gyros' own errors cancel in that
part, or follow the rate, and both are fitted beside it.
"""

from itertools import product

import numpy as np

from sinscal.recording.bins import Bins
from sinscal.recording.run import RigRun

SURE, CLOSE = 8.0, 3.0  # sigmas from the sign that is refused; from the one that is found
FEWEST = 60  # spans
SLOWEST = np.deg2rad(0.2)  # rad/s: of slower turns nothing comes through scale or misalignment


def force_points_down(run: RigRun, bins: Bins) -> bool:
    """Return whether the measured force points down by the gyros' measure, beyond doubt."""
    if bins.cycle.size < FEWEST:
        return False
    up = bins.accel / np.linalg.norm(bins.accel, axis=1)[:, None]
    along = np.sum(bins.gyro * up, axis=1)
    columns = [np.ones((along.size, 1)), up]  # a bias of the gyros turns with the body
    size = np.abs(bins.gyro)
    turns = size.max(axis=1) > SLOWEST
    for k, axis in product(np.unique(bins.cycle), range(3)):
        mine = (bins.cycle == k) & turns & (size.argmax(axis=1) == axis)
        rate = (bins.gyro[:, axis] * mine)[:, None]
        columns += [rate, rate * up]  # a tilted axis; misalignments
    design = np.hstack(columns)
    scale = np.linalg.norm(design, axis=0)
    used = scale > 0
    design = design[:, used] / scale[used]
    u, s, vt = np.linalg.svd(design, full_matrices=False)
    kept = s > 1e-6 * s[0]
    found = vt[kept].T @ ((u[:, kept].T @ along) / s[kept])
    left = along - design @ found
    dof = along.size - int(kept.sum())
    if dof < FEWEST // 2 or np.any(np.abs(vt[~kept][:, 0]) > 0.1):
        return False  # the constant is not to be had
    cov00 = float(np.sum((vt[kept, 0] / s[kept]) ** 2)) * float(left @ left) / dof
    value, sigma = found[0] / scale[0], np.sqrt(cov00) / scale[0]
    expected = float(run.facts.site.earth_rate[2])
    return bool(abs(value - expected) > SURE * sigma and abs(value + expected) < CLOSE * sigma)
