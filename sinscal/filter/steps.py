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
from errormodel.filter.steps import Steps, joined
from sinscal.filter.data import COUNT, CycleData, Nominal, RigNoise
from sinscal.filter.integrate import (
    LEAST_S,
    FeltRates,
    Intervals,
    SensorColumns,
    attitudes,
    mean_forces,
    sum_columns,
    usable_s,
)
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import left_jacobian, rotation, skew
from sinscal.model.sensors import Motion, SensorModel
from sinscal.recording.run import rate_derivative

TRIAL = 1e-5  # rad/s and rad/s², for slopes: what goes with its square is beyond six digits


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
    return joined(parts)


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


def _measurements(layout: RigLayout) -> int:
    return 6 if layout.angle else 3


def _restart(layout: RigLayout, noise: RigNoise, k: int) -> Steps:
    """Return the step before cycle k; slow drifts go on through it, counters do not."""
    lead = layout.moving
    steps = _empty(1, layout)
    steps.phi[0, :3, layout.start(k)] = np.eye(3)
    steps.phi[0, 3:, 3:lead] = np.eye(lead - 3)
    if layout.counted:
        for rows in layout.left_over:
            steps.phi[0, rows] = 0.0
            steps.q[0, rows] = noise.accel_quantum**2 / COUNT
    return steps


def _empty(count: int, layout: RigLayout) -> Steps:
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
    """Return the derivatives of the six sensors' errors by their unknowns, for `sum_columns`.

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


def _by_unknown(layout: RigLayout, found: Intervals) -> tuple[slice, slice]:
    """Return where the gyros' and the accelerometers' unknowns stand."""
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
    steps = _empty(found.length_s.size, layout)
    h, r, phi, q = steps.h, steps.r, steps.phi, steps.q
    lever = gravity_m_s2 * skew(np.array([0.0, 0.0, 1.0]))
    gyro, accel = _by_unknown(layout, found)
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
        keep = np.exp(-length[:, 0] / noise.instability_tau_s)
        for i, sigma in enumerate((noise.gyro_instability, noise.accel_instability)):
            for j in range(3 + 3 * i, 6 + 3 * i):
                phi[:, j, j] = keep
                q[:, j] = sigma**2 * (1.0 - keep**2)
    if layout.wander:
        turn = np.zeros((found.length_s.size, 3, 2))
        turn[:, 0, 0] = turn[:, 1, 1] = found.length_s
        phi[:, :3, layout.earth_rate(k)] = -turn
        h[:, :3, layout.earth_rate(k)] = -0.5 * lever @ turn
    q[:, :3] = noise.gyro**2 * length
    # what the gyros' noise adds within the interval is below 1e-4 of this and left out
    r[:, :3] = noise.accel**2 / np.maximum(found.weight_s, LEAST_S)[:, None]
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
    gyro, _ = _by_unknown(layout, found)
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
