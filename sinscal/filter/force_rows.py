"""Filter rows of the mean force, and the step of the attitude, with their derivatives.

Both filters use them, that of the rig's raw sensors and that of navigation outputs.
"""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Steps
from sinscal.filter.data import RigNoise
from sinscal.filter.integrate import LEAST_S, FeltRates, Intervals, SensorColumns
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import rotation, skew
from sinscal.model.motion import Motion
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import rate_derivative

TRIAL = 1e-5  # rad/s and rad/s², for slopes: what goes with its square is beyond six digits


def _measurements(layout: RigLayout) -> int:
    return 6 if layout.angle else 3


def empty_steps(count: int, layout: RigLayout) -> Steps:
    """Return steps that measure nothing and forget the moving states."""
    m, n, lead = _measurements(layout), layout.size, layout.moving
    return Steps(
        h=np.zeros((count, m, n)),
        z=np.full((count, m), np.nan),
        r=np.ones((count, m)),
        phi=np.zeros((count, lead, n)),
        q=np.zeros((count, lead)),
    )


def sensor_columns(
    sensors: SensorModel, true: Motion, values: FloatArray, *, drift: bool = False
) -> SensorColumns:
    """Return the derivatives of the six sensors' errors by their parameters, for `sum_columns`.

    With `drift` three more of the gyros and of the accelerometers, their slow drifts.
    """
    owner = np.array([i for i in sensors.owner if i < 6], dtype=np.intp)
    n_gyro = int(np.sum(owner < 3))
    rows = sensors.columns(true, values).T
    gyro, accel = rows[:n_gyro], rows[n_gyro:]
    gyro_axis, accel_axis = owner[:n_gyro], owner[n_gyro:] - 3
    if drift:
        ones, three = np.ones((3, len(true))), np.arange(3)
        gyro, accel = np.vstack([gyro, ones]), np.vstack([accel, ones])
        gyro_axis, accel_axis = np.append(gyro_axis, three), np.append(accel_axis, three)
    inverse, _ = sensors.at_rest(true, values)
    gyro_frame = inverse[:3, :3]
    return SensorColumns(
        gyro=gyro, gyro_axis=gyro_axis, accel=accel, accel_axis=accel_axis, gyro_frame=gyro_frame,
        accel_frame=inverse[3:, 3:], felt=_felt_rates(sensors, true, values, gyro, gyro_frame),
    )  # fmt: skip


def _felt_rates(
    sensors: SensorModel, true: Motion, values: FloatArray, gyro: FloatArray, frame: FloatArray
) -> FeltRates | None:
    """Return how errors of the rate come into the corrected force; None where they do not."""
    errors = sensors.errors(true, values)[:, 3:]
    by_rate, by_derivative = (np.zeros((len(true), 3, 3)) for _ in range(2))
    for axis in range(3):
        by = TRIAL * frame[:, axis]
        turned, sped = replace(true, w=true.w + by), replace(true, dw=true.dw + by)
        by_rate[:, :, axis] = (errors - sensors.errors(turned, values)[:, 3:]) / TRIAL
        by_derivative[:, :, axis] = (errors - sensors.errors(sped, values)[:, 3:]) / TRIAL
    if not (by_rate.any() or by_derivative.any()):
        return None
    derivative = rate_derivative(gyro.T, true.step_s).T
    return FeltRates(by_rate=by_rate, by_derivative=by_derivative, derivative=derivative)


def sensor_states(layout: RigLayout, found: Intervals) -> tuple[slice, slice]:
    """Return the states of the gyros' and of the accelerometers' parameters."""
    more = 3 if layout.drift else 0
    n_gyro, n_accel = found.turned.shape[2] - more, found.forced.shape[2] - more
    gyro = slice(layout.unknowns.start, layout.unknowns.start + n_gyro)
    return gyro, slice(gyro.stop, gyro.stop + n_accel)


def force_steps(
    found: Intervals,
    layout: RigLayout,
    noise: RigNoise,
    earth: FloatArray,
    gravity_m_s2: float,
    k: int,
) -> Steps:
    """Return a cycle's steps with derivatives of the force and the attitude, nothing measured yet.

    The rows of the force are those of its mean over an interval, in local axes.
    """
    steps = empty_steps(found.length_s.size, layout)
    h, r, phi, q = steps.h, steps.r, steps.phi, steps.q
    lever = gravity_m_s2 * skew(np.array([0.0, 0.0, 1.0]))
    gyro, accel = sensor_states(layout, found)
    n_gyro, n_accel = gyro.stop - gyro.start, accel.stop - accel.start
    length = found.length_s[:, None]
    h[:, :3, :3] = lever
    h[:, :3, gyro] = found.felt[:, :, :n_gyro] - lever @ found.turned_mean[:, :, :n_gyro]
    h[:, :3, accel] = found.forced[:, :, :n_accel]
    phi[:, :3, :3] = rotation(-length * earth)
    phi[:, :3, gyro] = -found.turned[:, :, :n_gyro]
    if layout.drift:
        h[:, :3, 3:6] = found.felt[:, :, n_gyro:] - lever @ found.turned_mean[:, :, n_gyro:]
        h[:, :3, 6:9] = found.forced[:, :, n_accel:]
        phi[:, :3, 3:6] = -found.turned[:, :, n_gyro:]
        for i, sensor in enumerate((noise.of_gyro, noise.of_accel)):
            keep, sigma = sensor.drift_step(length[:, 0])
            for j in range(3 + 3 * i, 6 + 3 * i):
                phi[:, j, j] = keep
                q[:, j] = sigma**2
    if layout.wander:
        turn = np.zeros((found.length_s.size, 3, 2))
        turn[:, 0, 0] = turn[:, 1, 1] = found.length_s
        phi[:, :3, layout.earth_rate(k)] = -turn
        h[:, :3, layout.earth_rate(k)] = -0.5 * lever @ turn
    q[:, :3] = noise.gyro**2 * length
    # what the gyros' noise adds within the interval is below 1e-4 of this and left out
    r[:, :3] = noise.accel**2 / np.maximum(found.weight_s, LEAST_S)[:, None]
    return steps
