"""Rows that must not be used as measurements: shocks and saturated samples.

Thresholds come from the recording's own noise, so units do not matter.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from errormodel.arrays import FloatArray
from sinscal.recording.abrupt import stands_out
from sinscal.recording.rows import stretches
from sinscal.recording.run import AXES, BoolArray, RigRun, rate_derivative

THRESHOLD = 10.0  # sigmas; Gaussian noise of a year at 100 Hz does not reach 7
SPAN_S = 1.0  # of the running median that a shock stands out from
WIDEN_S = 0.05  # what rings on either side
MOST = 0.02  # share of a cycle: more is the motion itself, not shocks
CLIPPED = 4  # equal extreme samples in a row
BEYOND = 1.1  # times gravity
ARM_M = 0.3  # of a sensing mass from the axis: three times what is expected of a SINS
SENSORS_OFF = 0.01  # of gravity, by a radian's turn: bias, scale and misalignment of a poor triad
FORCE_OFF = 0.15  # of the usual force: beyond any sensor's error and any rig's acceleration


@dataclass(frozen=True, slots=True, kw_only=True)
class Flagged:
    """Rows first to last (inclusive) of a run that were flagged, and why."""

    first: int
    last: int
    reason: str


def find_shocks(run: RigRun) -> tuple[Flagged, ...]:
    """Return where shocks and saturation are, in order of rows."""
    found: list[Flagged] = []
    for part in run.cycles:
        marked = _shocked(run, part)
        if np.mean(marked) <= MOST:
            found += [
                Flagged(first=part.start + a, last=part.start + b - 1, reason="shock")
                for a, b in stretches(marked)
            ]
    gravity = run.facts.site.gravity_m_s2
    for k, axis in enumerate(AXES):
        found += [
            Flagged(first=a, last=b - 1, reason=f"accel_{axis} saturated")
            for a, b in _clipped(run.accel[:, k], gravity)
        ]
    return tuple(sorted(found, key=lambda one: one.first))


def violent_rows(accel: FloatArray, step_s: FloatArray) -> BoolArray:
    """Return the rows of a cycle whose force no rig makes, with what rings about them, shape (n,).

    A filter that takes them for gravity is thrown so far that its gate refuses what is right.

    Parameters
    ----------
    accel : ndarray, shape (n, 3)
        As measured, m/s².
    step_s : ndarray, shape (n,)
    """
    force = np.linalg.norm(accel, axis=1)
    usual = float(np.median(force))
    size = np.abs(force - usual)
    marked = size > max(FORCE_OFF * usual, THRESHOLD * float(np.median(size)) / 0.6745)
    if not marked.any() or np.mean(marked) > MOST:
        return np.zeros_like(marked)
    around = max(1, round(WIDEN_S / float(np.median(step_s))))
    return ndimage.binary_dilation(marked, iterations=around)


def _shocked(run: RigRun, part: slice) -> BoolArray:
    """Return the rows of a cycle in which a reading stands alone, or the force stands out."""
    rows = part.stop - part.start
    marked = np.zeros(rows, dtype=np.bool_)
    if rows < 20:
        return marked
    step_s = float(np.median(run.step_s[part]))
    size = min(2 * round(0.5 * SPAN_S / step_s) + 1, 2 * (rows // 4) + 1)
    force = np.linalg.norm(run.accel[part], axis=1)
    usual = ndimage.median_filter(force, size=max(size, 3), mode="nearest")
    off = force - usual
    beyond = np.abs(off) > _moved_force(run, part, size)
    marked |= stands_out(off[:, None], THRESHOLD)[:, 0] & beyond
    for values in (run.gyro[part], run.accel[part]):
        alone = values[1:-1] - 0.5 * (values[:-2] + values[2:])
        # where a rate begins to change its neighbours differ too, along whatever axis: motion
        apart = np.linalg.norm(values[2:] - values[:-2], axis=1)
        motion = np.linalg.norm(alone, axis=1) < apart
        marked[1:-1] |= stands_out(alone, THRESHOLD).any(axis=1) & ~motion
    around = max(1, round(WIDEN_S / step_s))
    return ndimage.binary_dilation(marked, iterations=around)


def _moved_force(run: RigRun, part: slice, size: int) -> FloatArray:
    """Return by how much the motion may change the size of the force within so many rows, m/s².

    Masses off the axis feel the turn begin, and errors of the sensors turn with gravity.
    """
    rate = np.linalg.norm(run.gyro[part], axis=1)
    change = np.linalg.norm(rate_derivative(run.gyro[part], run.step_s[part]), axis=1)
    spin = ndimage.maximum_filter1d(rate, size) ** 2 - ndimage.minimum_filter1d(rate, size) ** 2
    turn = ndimage.uniform_filter1d(rate, size) * size * float(np.median(run.step_s[part]))
    gravity = run.facts.site.gravity_m_s2
    return ARM_M * (ndimage.maximum_filter1d(change, 3) + spin) + SENSORS_OFF * gravity * turn


def _clipped(force: FloatArray, gravity: float) -> list[tuple[int, int]]:
    """Return stretches in which a channel rests exactly at its largest or smallest value.

    A sound one may do so too, at rest or turning evenly, when it is coarsely quantised: only what
    is well beyond gravity is believed to be the end of the range. Gyros are not judged: a constant
    rate looks the same.
    """
    found: list[tuple[int, int]] = []
    for extreme in (float(force.max()), float(force.min())):
        if abs(extreme) > BEYOND * gravity:
            found += [(a, b) for a, b in stretches(force == extreme) if b - a >= CLIPPED]
    return found
