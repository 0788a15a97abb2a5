"""A rig run made for tests: cycles about the instrument's axes, perfect but for what is asked.

The attitude is exact at the middle of each step; earth's rotation and gravity are of Moscow.
"""

import numpy as np

from sinscal.frames.attitude import rotation
from sinscal.frames.earth import Site
from sinscal.recording.run import RigFacts, RigRun

SITE = Site(lat_rad=float(np.deg2rad(55.75)), height_m=150.0)
# instrument axes (columns: the axis that lies along the rig's, and the one up at angle 0)
MOUNTS = {
    "x": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "y": np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]),
    "z": np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]),
}


def angle_of(time_s: np.ndarray, rate: float, cycle_s: float, turn_s: float) -> np.ndarray:
    """Up to +rate in turn_s, to −rate at the half, to rest at the end; at rest the first 10 s."""
    knots = [0, 10, 10 + turn_s, cycle_s / 2 - turn_s, cycle_s / 2 + turn_s, cycle_s - turn_s]
    knot, rates = np.array([*knots, cycle_s]), np.array([0, 0, rate, rate, -rate, -rate, 0])
    angle = np.concatenate([[0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(knot))])
    k = np.clip(np.searchsorted(knot, time_s, side="right") - 1, 0, knot.size - 2)
    slope = np.diff(rates) / np.diff(knot)
    since = time_s - knot[k]
    return angle[k] + rates[k] * since + 0.5 * slope[k] * since**2


def rig_run(
    *,
    rate_deg_s: float = 10.0,
    cycle_s: float = 120.0,
    step_s: float = 0.01,
    turn_s: float = 2.0,
    axes: str = "xyz",
    azimuth_deg: float = 30.0,
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gyro_noise: float = 5e-7,
    accel_noise: float = 1e-3,
    lever_m: float = 0.0,
    quantum: float = 0.0,
    seed: int = 1,
) -> RigRun:
    """Return a run; noises are densities; the lever is along the next axis."""
    rng = np.random.default_rng(seed)
    n = round(cycle_s / step_s)
    end = step_s * np.arange(1, n + 1)
    east = np.deg2rad(90.0 - azimuth_deg)  # of the rig's axis from east to north
    rig = np.array([[np.cos(east), -np.sin(east), 0], [np.sin(east), np.cos(east), 0], [0, 0, 1.0]])
    gyros, accels, angles = [], [], []
    for axis in axes:
        angle = angle_of(end, np.deg2rad(rate_deg_s), cycle_s, turn_s)
        before = angle_of(end - step_s, np.deg2rad(rate_deg_s), cycle_s, turn_s)
        rate = (angle - before) / step_s
        middle = 0.5 * (angle + before)
        c_nb = rig @ rotation(middle[:, None] * np.array([1.0, 0, 0])) @ MOUNTS[axis]
        spin = MOUNTS[axis].T @ np.array([1.0, 0, 0])
        up = SITE.gravity_m_s2 * c_nb[:, 2, :]
        gyro = rate[:, None] * spin + np.einsum("nij,i->nj", c_nb, SITE.earth_rate)
        change = np.gradient(rate, step_s)
        arm = lever_m * np.roll(spin, 1)
        accel = up + change[:, None] * np.cross(spin, arm) - rate[:, None] ** 2 * arm
        gyros.append(gyro + np.array(gyro_bias))
        accels.append(accel + np.array(accel_bias))
        angles.append(angle)
    gyro, accel = np.concatenate(gyros), np.concatenate(accels)
    gyro = gyro + gyro_noise / np.sqrt(step_s) * rng.standard_normal(gyro.shape)
    accel = accel + accel_noise / np.sqrt(step_s) * rng.standard_normal(accel.shape)
    if quantum:
        accel = quantum * np.round(accel / quantum)
    k = np.arange(len(axes))
    return RigRun(
        time_s=np.concatenate([end + c * (cycle_s + 60.0) for c in k]),
        step_s=np.full(n * len(axes), step_s),
        cycle=np.repeat(k, n),
        gyro=gyro,
        accel=accel,
        rig_angle_rad=np.concatenate(angles),
        facts=RigFacts(site=SITE, axis_of_cycle=tuple(axes)),
    )
