"""The error budget of a calibration: what each noise and each prior leaves in its sigmas."""

from collections.abc import Iterator, Mapping

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.filter.gains import covariance_share, start_transition
from sinscal.filter.layout import RigLayout
from sinscal.library import rig_library
from sinscal.planning.covariance import RigCovariance


def error_budget(found: RigCovariance) -> Mapping[str, FloatArray]:
    """Split the final variances among the sources: each noise, each group of priors.

    Every source goes alone through the gains of the filter that knows them all:
    P⁺ = (I − K h) P (I − K h)ᵀ + K r Kᵀ and P = Φ P Φᵀ + Q are linear in the start's covariance,
    r and Q, so that the parts add up to the whole.

    Parameters
    ----------
    found : RigCovariance

    Returns
    -------
    mapping of str to ndarray, shape (p,)
        Variances in the order of `names`. "correlation of priors" is there only when priors of
        different groups are correlated; it alone may be negative.
    """
    layout, steps, gains = found.layout, found.steps, found.filtered.gains
    order = [layout.names.index(n) for n in found.names]
    nothing = np.zeros((layout.size, layout.size))
    out: dict[str, FloatArray] = {}
    for name, part, columns in _noises(layout):
        r, q = np.zeros_like(steps.r), np.zeros_like(steps.q)
        whole, mine = (steps.r, r) if part == "r" else (steps.q, q)
        mine[:, columns] = whole[:, columns]
        out[name] = np.diag(covariance_share(steps, gains, nothing, r, q))[order]
    across = start_transition(steps, gains)[order]
    left = found.start.cov
    for name, places in _groups(layout).items():
        block = left[np.ix_(places, places)]
        if np.any(block):
            out[f"prior: {name}"] = np.sum((across[:, places] @ block) * across[:, places], axis=1)
        left[np.ix_(places, places)] = 0.0
    if np.any(left):
        out["correlation of priors"] = np.sum((across @ left) * across, axis=1)
    return out


def _noises(layout: RigLayout) -> Iterator[tuple[str, str, slice]]:
    yield "accelerometer noise", "r", slice(0, 3)
    yield "gyro noise", "q", slice(0, 3)
    if layout.angle:
        yield "rig angle noise", "r", slice(3, 4)
        yield "wobble of the rotation axis", "r", slice(4, 6)
    if layout.drift:
        yield "gyro drift", "q", slice(3, 6)
        yield "accelerometer drift", "q", slice(6, 9)


def _states(layout: RigLayout) -> Iterator[tuple[str, slice]]:
    """Yield the filter's states beside the sensors' parameters, with what the budget calls them."""
    yield "attitude", slice(0, 3)
    if layout.drift:
        yield "gyro drift at the start", layout.at("gyro_drift_x", 3)
        yield "accelerometer drift at the start", layout.at("accel_drift_x", 3)
    if layout.counted:
        for part in layout.left_over:
            yield "counters' remainders", part
    for k in range(layout.cycles):
        yield "start attitude", layout.start(k)
        if layout.wander:
            yield "north", layout.earth_rate(k)
        if layout.angle:
            yield "platform's base", layout.base(k)
        if layout.angle and layout.remount:
            yield "re-mounting", layout.remounted(k)
    if layout.angle:
        yield "mounting", layout.mount


def _groups(layout: RigLayout) -> dict[str, IntArray]:
    """Return the places of each group of states."""
    found: dict[str, list[int]] = {}
    for name, places in _states(layout):
        found.setdefault(name, []).extend(range(layout.size)[places])
    for i, name in enumerate(layout.parameters, layout.unknowns.start):
        found.setdefault(rig_library().parameter(name).family, []).append(i)
    return {group: np.array(places, dtype=np.intp) for group, places in found.items()}
