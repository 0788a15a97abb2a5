"""The rig filter: from a recorded run and a nominal to the steps of `errormodel.filter.steps`.

Each cycle's start attitude is a constant beside the moving one, which begins as its copy: at the
end every start has been smoothed by all that followed, without a backward pass. The nominal
(sensor errors, start attitudes, the platform) is improved by what the filter finds, what is left
of the data is computed again, and so on: an iterated filter, that is, Gauss-Newton on all data and
the prior.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Steps, join_steps
from sinscal.filter.data import COUNT, CycleData, Nominal, RigNoise
from sinscal.filter.force_rows import empty_steps, force_steps, sensor_columns, sensor_states
from sinscal.filter.integrate import (
    LEAST_S,
    Intervals,
    attitudes,
    mean_forces,
    sum_columns,
    usable_s,
)
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import left_jacobian, rotation
from sinscal.model.motion import Motion
from sinscal.model.sensors import SensorModel


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Followed:
    """One cycle by a nominal: the true motion and the attitudes at middles and ends of its steps.

    With the rig's angle also: its true value and rate, the platform's attitude C_np, the
    directions, as rows, along the axis and two across it, and how the mounting turns by its own
    rotation vector.
    """

    k: int
    cycle: CycleData
    true: Motion
    middle: FloatArray
    end: FloatArray
    angle: FloatArray
    turn: FloatArray
    c_np: FloatArray
    frame: FloatArray
    by_mount: FloatArray


def _follow(
    cycle: CycleData, sensors: SensorModel, nominal: Nominal, layout: RigLayout, k: int
) -> _Followed:
    true = sensors.corrected(cycle.measured, nominal.values)
    middle, end = attitudes(true.w, true.step_s, nominal.c_start[k], nominal.earth[k])
    angle = turn = np.zeros(0)
    c_np = frame = np.zeros((0, 3, 3))
    if layout.angle:
        assert cycle.angle is not None
        assert cycle.axis is not None
        unit, base = np.eye(3)[cycle.axis], nominal.base[k]
        speed = true.w @ (platform_mount(nominal, k).T @ unit)
        turn = 0.5 * (speed + np.append(speed[1:], speed[-1]))
        angle = sensors.true_angle(true.time_s, cycle.angle, turn, nominal.values)
        c_np = base @ rotation(angle[:, None] * unit)
        frame = base.T[(cycle.axis + np.arange(3)) % 3]
    return _Followed(
        k=k, cycle=cycle, true=true, middle=middle, end=end, angle=angle, turn=turn, c_np=c_np,
        frame=frame, by_mount=left_jacobian(_mount_vector(nominal, k)),
    )  # fmt: skip


def make_steps(
    cycles: Sequence[CycleData],
    sensors: SensorModel,
    nominal: Nominal,
    layout: RigLayout,
    noise: RigNoise,
    gravity_m_s2: float,
) -> Steps:
    """Linearise all cycles about a nominal.

    Returns
    -------
    Steps
        Before each cycle's intervals one step without measurement, in which the moving attitude
        becomes the copy of that cycle's start.
    """
    parts: list[Steps] = []
    for k, cycle in enumerate(cycles):
        followed = _follow(cycle, sensors, nominal, layout, k)
        columns = sensor_columns(sensors, followed.true, nominal.values, drift=layout.drift)
        found = sum_columns(followed.middle, followed.true.step_s, cycle.good, columns, cycle.first)
        steps = force_steps(found, layout, noise, nominal.earth[k], gravity_m_s2, k)
        steps = _with_counts(steps, followed, found, layout, noise, gravity_m_s2)
        if layout.angle:
            steps = _with_angle(steps, followed, found, sensors, layout, noise)
        steps = replace(steps, z=_measured(followed, nominal, layout, gravity_m_s2))
        parts += [_restart(layout, noise, k), steps]
    return join_steps(parts)


def remeasured(
    steps: Steps,
    cycles: Sequence[CycleData],
    sensors: SensorModel,
    nominal: Nominal,
    layout: RigLayout,
    gravity_m_s2: float,
) -> Steps:
    """Return steps with what was measured computed anew, about a nominal near theirs.

    Their derivatives stay: those of the new nominal differ by as little of themselves as attitudes
    and sensors differ, and an estimate by no more of its sigma.
    """
    parts: list[FloatArray] = []
    for k, cycle in enumerate(cycles):
        followed = _follow(cycle, sensors, nominal, layout, k)
        z = _measured(followed, nominal, layout, gravity_m_s2)
        parts += [np.full((1, z.shape[1]), np.nan), z]
    return replace(steps, z=np.concatenate(parts))


def _measured(
    followed: _Followed, nominal: Nominal, layout: RigLayout, gravity_m_s2: float
) -> FloatArray:
    """Return what the measurements are more than the nominal has them, shape (K, m).

    The mean force, and with the angle the attitude by the rig against the computed one.
    """
    cycle, true = followed.cycle, followed.true
    z = mean_forces(
        followed.middle, true.w, true.f, true.step_s, cycle.good, cycle.first, gravity_m_s2
    )
    if layout.angle:
        mount = platform_mount(nominal, followed.k)
        apart = small_rotvec((followed.c_np @ mount) @ np.swapaxes(followed.end, 1, 2))
        z = np.hstack([z, _mean_over(cycle)(apart) @ followed.frame.T])
    length_s = np.add.reduceat(true.step_s, cycle.first[:-1])
    z[usable_s(true.step_s, cycle.good, cycle.first) <= 0.5 * length_s] = np.nan
    return z


def _restart(layout: RigLayout, noise: RigNoise, k: int) -> Steps:
    """Return the step before cycle k; slow drifts go on through it, counters do not."""
    lead = layout.moving
    steps = empty_steps(1, layout)
    steps.phi[0, :3, layout.start(k)] = np.eye(3)
    steps.phi[0, 3:, 3:lead] = np.eye(lead - 3)
    if layout.counted:
        for rows in layout.left_over:
            steps.phi[0, rows] = 0.0
            steps.q[0, rows] = noise.accel_quantum**2 / COUNT
    return steps


def _with_counts(
    steps: Steps,
    followed: _Followed,
    found: Intervals,
    layout: RigLayout,
    noise: RigNoise,
    gravity_m_s2: float,
) -> Steps:
    """Put in what counters of increments do to the force.

    The velocity gained over an interval is wrong by what the accelerometers' counters had left over
    at its end less that at its start; what was left over in between stays there. The attitude is
    wrong by what the gyros' had at the moment, by itself in every row.
    """
    first, length = followed.cycle.first, found.length_s[:, None, None]
    attitude2 = noise.gyro_quantum**2 / COUNT / np.diff(first)[:, None]
    steps.r[:, :2] += gravity_m_s2**2 * attitude2
    if layout.counted:
        before, after = layout.left_over
        steps.h[:, :3, before] = -followed.middle[first[:-1]] / length
        steps.h[:, :3, after] = followed.middle[first[1:] - 1] / length
        steps.phi[:, before, after] = np.eye(3)
        steps.q[:, after] = noise.accel_quantum**2 / COUNT
    return steps


def platform_mount(nominal: Nominal, k: int) -> FloatArray:
    """Return C_pb of cycle k: v_p = C_pb v_b."""
    return rotation(_mount_vector(nominal, k))


def _mount_vector(nominal: Nominal, k: int) -> FloatArray:
    return nominal.mount + (nominal.remount[k] if nominal.remount else 0.0)


def _with_angle(
    steps: Steps,
    followed: _Followed,
    found: Intervals,
    sensors: SensorModel,
    layout: RigLayout,
    noise: RigNoise,
) -> Steps:
    """Fill three rows: the attitude by the rig against the computed one, along the axis and across.

    The rig's attitude is base · R(e, α) · C_pb, true when base, α and mounting are; the rotation
    that takes the computed attitude into it is φ − η + e_n·(error of α) − C_np·J·δ, with J of the
    mounting's rotation vector.
    """
    frame = followed.frame
    mean = _mean_over(followed.cycle)
    h, r = steps.h, steps.r
    gyro, _ = sensor_states(layout, found)
    n_gyro = gyro.stop - gyro.start
    h[:, 3:, :3] = frame
    h[:, 3:, gyro] = -frame @ found.turned_mean[:, :, :n_gyro]
    if layout.drift:
        h[:, 3:, 3:6] = -frame @ found.turned_mean[:, :, n_gyro:]
    h[:, 3:, layout.base(followed.k)] = -frame
    turned = mean(followed.c_np.reshape(-1, 9)).reshape(-1, 3, 3) @ followed.by_mount
    h[:, 3:, layout.mount] = -frame @ turned
    if layout.remount:
        h[:, 3:, layout.remounted(followed.k)] = -frame @ turned
    columns = mean(sensors.angle_columns(followed.angle, followed.turn))
    h[:, 3, layout.unknowns.stop - columns.shape[1] : layout.unknowns.stop] = columns
    weight = np.maximum(found.weight_s, LEAST_S)
    wobble = noise.angle if noise.wobble is None else noise.wobble
    counted = noise.gyro_quantum**2 / COUNT / np.diff(followed.cycle.first)
    r[:, 3] = noise.angle**2 / weight + counted
    r[:, 4:] = wobble**2 / weight[:, None] + counted[:, None]
    return steps


def _mean_over(cycle: CycleData) -> Callable[[FloatArray], FloatArray]:
    """Return a function that takes (n, c) to means over intervals (K, c), good rows only."""
    use, starts = cycle.good.astype(float), cycle.first[:-1]
    count = np.maximum(np.add.reduceat(use, starts), 1.0)[:, None]

    def mean(values: FloatArray) -> FloatArray:
        if values.shape[1] == 0:
            return np.zeros((count.size, 0))
        return np.add.reduceat(values * use[:, None], starts, axis=0) / count

    return mean


def small_rotvec(c: FloatArray) -> FloatArray:
    """Return the rotation vectors of matrices turned by less than half a turn, shape (n, 3)."""
    twice = np.stack(
        [c[:, 2, 1] - c[:, 1, 2], c[:, 0, 2] - c[:, 2, 0], c[:, 1, 0] - c[:, 0, 1]], axis=1
    )
    cosine = np.clip(0.5 * (np.trace(c, axis1=1, axis2=2) - 1.0), -1.0, 1.0)
    sine = 0.5 * np.linalg.norm(twice, axis=1)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-9, 0.5 * angle / np.where(sine > 1e-9, sine, 1.0), 0.5)
    return twice * factor[:, None]
