"""The rig filter: from a recorded run and a nominal to the steps of `errormodel.filtering`.

Each cycle's start attitude is a constant beside the moving one, which begins as its copy: at the
end every start has been smoothed by all that followed, without a backward pass. The nominal
(sensor errors, start attitudes, the platform) is improved by what the filter finds, the data
integrated again, and so on: an iterated filter, that is, Gauss-Newton on all data and the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.filtering import Steps, joined
from sinscal.attitude import rotation, skew
from sinscal.integrate import Intervals, attitudes, interval_rows, sum_intervals
from sinscal.layout import RigLayout
from sinscal.run import AXES, BoolArray, RigRun
from sinscal.sensors import Motion, SensorModel, rate_derivative

# Where north is only sought, steps are put together up to so long and so much of a turn.
THIN_STEP_S = 0.1
THIN_TURN_RAD = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class RigNoise:
    """Noise as the filter takes it: densities (sigma of a mean over 1 s) and slow drifts.

    Attributes
    ----------
    gyro, accel, angle : float
        rad/s/√Hz, m/s²/√Hz, rad/√Hz.
    wobble : float, optional
        How much the rotation axis moves across itself, rad/√Hz; that of the angle if not given.
    gyro_instability, accel_instability, instability_tau_s : float
        Sigma and correlation time of slow drift; zero sigmas: none.
    """

    gyro: float
    accel: float
    angle: float = 0.0
    wobble: float | None = None
    gyro_instability: float = 0.0
    accel_instability: float = 0.0
    instability_tau_s: float = 3600.0

    @property
    def drifts(self) -> bool:
        """Whether there is slow drift."""
        return self.gyro_instability > 0.0 or self.accel_instability > 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CycleData:
    """One cycle as measured, ready to be integrated again and again."""

    measured: Motion
    good: BoolArray
    first: IntArray
    axis: int | None
    angle: FloatArray | None

    def thinned(self, interval_s: float) -> "CycleData":
        """Return the cycle with steps put together as far as little turns within one."""
        m = self.measured
        fastest = float(np.max(np.linalg.norm(m.w, axis=1), initial=1e-9))
        wanted_s = min(THIN_STEP_S, THIN_TURN_RAD / fastest)
        every = int(wanted_s / float(np.median(m.step_s)) + 1e-6)
        if every < 2:
            return self
        edges = np.arange(0, len(m), every)
        last = np.append(edges[1:], len(m)) - 1
        step_s = np.add.reduceat(m.step_s, edges)

        def mean(values: FloatArray) -> FloatArray:
            return np.add.reduceat(values * m.step_s[:, None], edges) / step_s[:, None]

        w = mean(m.w)
        motion = Motion(
            time_s=m.time_s[last], step_s=step_s, w=w, f=mean(m.f), dw=rate_derivative(w, step_s),
            temp_c=None if m.temp_c is None else mean(m.temp_c),
        )  # fmt: skip
        return replace(
            self,
            measured=motion,
            good=np.logical_and.reduceat(self.good, edges),
            first=interval_rows(motion.time_s, motion.step_s, interval_s),
            angle=None if self.angle is None else self.angle[last],
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Nominal:
    """About what the filter linearises.

    Attributes
    ----------
    values : ndarray, shape (p,)
        Of the sensor model.
    c_start : tuple of ndarray, each (3, 3)
        Attitude at the start of each cycle.
    earth : tuple of ndarray, each (3,)
        The earth's rotation in the local axes of each cycle, rad/s.
    base : tuple of ndarray, each (3, 3)
        The platform's attitude at angle zero; empty without angle.
    mount : ndarray, shape (3,)
    remount : tuple of ndarray, each (3,)
    """

    values: FloatArray
    c_start: tuple[FloatArray, ...]
    earth: tuple[FloatArray, ...]
    base: tuple[FloatArray, ...] = ()
    mount: FloatArray
    remount: tuple[FloatArray, ...] = ()

    def improved(self, x: FloatArray, layout: RigLayout) -> "Nominal":
        """Return the nominal with a filter's estimate of its errors put right."""
        cycles = range(layout.cycles)
        starts = [rotation(x[layout.start(k)]) @ self.c_start[k] for k in cycles]
        changed = replace(self, values=self.values + x[layout.unknowns], c_start=tuple(starts))
        if layout.wander:
            more = [np.append(x[layout.earth_rate(k)], 0.0) for k in cycles]
            changed = replace(
                changed, earth=tuple(e + d for e, d in zip(self.earth, more, strict=True))
            )
        if layout.angle:
            bases = [rotation(x[layout.base(k)]) @ self.base[k] for k in cycles]
            changed = replace(changed, base=tuple(bases), mount=self.mount + x[layout.mount])
        if layout.angle and layout.remount:
            more = [self.remount[k] + x[layout.remounted(k)] for k in cycles]
            changed = replace(changed, remount=tuple(more))
        return changed


def cycle_data(run: RigRun, interval_s: float) -> tuple[CycleData, ...]:
    """Cut a run into its cycles and these into intervals."""
    out: list[CycleData] = []
    begins_s = run.begin_of_cycle_s
    for k, rows in enumerate(run.cycles):
        step_s = run.step_s[rows]
        time_s = run.time_s[rows] - run.time_s[rows][0] + step_s[0]
        axes = run.facts.axis_of_cycle
        angle = None if run.rig_angle_rad is None else np.unwrap(run.rig_angle_rad[rows])
        out.append(
            CycleData(
                measured=Motion(
                    time_s=time_s,
                    step_s=step_s,
                    w=run.gyro[rows],
                    f=run.accel[rows],
                    dw=rate_derivative(run.gyro[rows], step_s),
                    temp_c=None if run.temp_c is None else run.temp_c[rows],
                    begin_s=begins_s[k],
                ),
                good=~np.asarray(run.flag, dtype=np.bool_)[rows],
                first=interval_rows(time_s, step_s, interval_s),
                axis=AXES.index(axes[k]) if axes else None,
                angle=angle,
            )
        )
    return tuple(out)


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
        parts.append(_restart(layout, k))
        parts.append(_cycle_steps(cycle, sensors, nominal, layout, noise, gravity_m_s2, k))
    return joined(parts)


def _measurements(layout: RigLayout) -> int:
    return 6 if layout.angle else 3


def _restart(layout: RigLayout, k: int) -> Steps:
    """Return the step before cycle k; slow drifts go on through it."""
    m, n, lead = _measurements(layout), layout.size, layout.moving
    phi = np.zeros((1, lead, n))
    phi[0, :3, layout.start(k)] = np.eye(3)
    phi[0, 3:, 3:lead] = np.eye(lead - 3)
    return Steps(
        h=np.zeros((1, m, n)),
        z=np.full((1, m), np.nan),
        r=np.ones((1, m)),
        phi=phi,
        q=np.zeros((1, lead)),
    )


def _cycle_steps(
    cycle: CycleData,
    sensors: SensorModel,
    nominal: Nominal,
    layout: RigLayout,
    noise: RigNoise,
    gravity_m_s2: float,
    k: int,
) -> Steps:
    true = sensors.corrected(cycle.measured, nominal.values)
    columns, axis, n_gyro = joint_columns(sensors, true, nominal.values)
    middle, end = attitudes(
        np.array(true.w), np.array(true.step_s), np.array(nominal.c_start[k]),
        np.array(nominal.earth[k]),
    )  # fmt: skip
    found = sum_intervals(
        middle, end, true.w, true.f, true.step_s, cycle.good, columns, axis, n_gyro + 3,
        cycle.first, gravity_m_s2,
    )  # fmt: skip
    steps = _force_steps(found, layout, noise, nominal.earth[k], gravity_m_s2, n_gyro, k)
    if layout.angle:
        steps = _with_angle(steps, cycle, true, found, sensors, nominal, layout, noise, n_gyro, k)
    return steps


def joint_columns(
    sensors: SensorModel, true: Motion, values: FloatArray
) -> tuple[FloatArray, IntArray, int]:
    """Return what `sum_intervals` sums, the axes it acts along, and the gyros' unknowns' number.

    After the gyros' unknowns stand three columns of ones, their slow drifts, and three more after
    the accelerometers'.
    """
    owner = np.array([i for i in sensors.owner if i < 6], dtype=np.intp)
    n_gyro = int(np.sum(owner < 3))
    columns, ones = sensors.columns(true, values), np.ones((len(true), 3))
    joint = np.hstack([columns[:, :n_gyro], ones, columns[:, n_gyro:], ones])
    axis = np.concatenate([owner[:n_gyro], np.arange(3), owner[n_gyro:] - 3, np.arange(3)])
    return joint, axis, n_gyro


def _force_steps(
    found: Intervals,
    layout: RigLayout,
    noise: RigNoise,
    earth: FloatArray,
    gravity_m_s2: float,
    n_gyro: int,
    k: int,
) -> Steps:
    count = found.length_s.size
    m, n, lead = _measurements(layout), layout.size, layout.moving
    h, z = np.zeros((count, m, n)), np.full((count, m), np.nan)
    r, phi, q = np.ones((count, m)), np.zeros((count, lead, n)), np.zeros((count, lead))
    lever = gravity_m_s2 * skew(np.array([0.0, 0.0, 1.0]))
    unknown = layout.unknowns.start
    n_accel = found.forced.shape[2] - 3
    gyro = slice(unknown, unknown + n_gyro)
    accel = slice(gyro.stop, gyro.stop + n_accel)
    length = found.length_s[:, None]
    h[:, :3, :3] = lever
    h[:, :3, gyro] = -lever @ found.turned_mean[:, :, :n_gyro]
    h[:, :3, accel] = found.forced[:, :, :n_accel]
    phi[:, :3, :3] = rotation(-length * earth)
    phi[:, :3, gyro] = -found.turned[:, :, :n_gyro]
    if layout.drift:
        h[:, :3, 3:6] = -lever @ found.turned_mean[:, :, n_gyro:]
        h[:, :3, 6:9] = found.forced[:, :, n_accel:]
        phi[:, :3, 3:6] = -found.turned[:, :, n_gyro:]
        keep = np.exp(-length[:, 0] / noise.instability_tau_s)
        for i, sigma in enumerate((noise.gyro_instability, noise.accel_instability)):
            for j in range(3 + 3 * i, 6 + 3 * i):
                phi[:, j, j] = keep
                q[:, j] = sigma**2 * (1.0 - keep**2)
    if layout.wander:
        turn = np.zeros((count, 3, 2))
        turn[:, 0, 0] = turn[:, 1, 1] = found.length_s
        phi[:, :3, layout.earth_rate(k)] = -turn
        h[:, :3, layout.earth_rate(k)] = -0.5 * lever @ turn
    q[:, :3] = noise.gyro**2 * length
    usable = found.weight_s > 0.5 * found.length_s
    z[usable, :3] = found.force[usable]
    # what the gyros' noise adds within the interval is below 1e-4 of this and left out
    r[:, :3] = noise.accel**2 / np.maximum(found.weight_s, 1e-9)[:, None]
    return Steps(h=h, z=z, r=r, phi=phi, q=q)


def platform_mount(nominal: Nominal, k: int) -> FloatArray:
    """Return C_pb of cycle k: v_p = C_pb v_b."""
    more = nominal.remount[k] if nominal.remount else 0.0
    return rotation(nominal.mount + more)


def _with_angle(
    steps: Steps,
    cycle: CycleData,
    true: Motion,
    found: Intervals,
    sensors: SensorModel,
    nominal: Nominal,
    layout: RigLayout,
    noise: RigNoise,
    n_gyro: int,
    k: int,
) -> Steps:
    """Add three rows: the attitude by the rig against the computed one, along the axis and across.

    The rig's attitude is base · R(e, α) · C_pb, true when base, α and mounting are; the rotation
    that takes the computed attitude into it is φ − η + e_n·(error of α) − C_np·δ.
    """
    assert cycle.angle is not None
    assert cycle.axis is not None
    unit = np.eye(3)[cycle.axis]
    mount = platform_mount(nominal, k)
    speed = true.w @ (mount.T @ unit)
    turn = 0.5 * (speed + np.append(speed[1:], speed[-1]))
    angle = sensors.true_angle(true.time_s, cycle.angle, turn, nominal.values)
    c_np = nominal.base[k] @ rotation(angle[:, None] * unit)
    apart = small_rotvec((c_np @ mount) @ np.swapaxes(found.c_end, 1, 2))
    along = nominal.base[k] @ unit
    across = np.linalg.svd(along[None, :])[2][1:]
    frame = np.vstack([along, across])  # rows: along the axis, and two across it
    mean = _mean_over(found.first, cycle.good)
    h, z, r = (a.copy() for a in (steps.h, steps.z, steps.r))
    h[:, 3:, :3] = frame
    unknown = layout.unknowns
    gyro = slice(unknown.start, unknown.start + n_gyro)
    h[:, 3:, gyro] = -frame @ found.turned_mean[:, :, :n_gyro]
    if layout.drift:
        h[:, 3:, 3:6] = -frame @ found.turned_mean[:, :, n_gyro:]
    h[:, 3:, layout.base(k)] = -frame
    turned = mean(c_np.reshape(-1, 9)).reshape(-1, 3, 3)
    h[:, 3:, layout.mount] = -frame @ turned
    if layout.remount:
        h[:, 3:, layout.remounted(k)] = -frame @ turned
    columns = mean(sensors.angle_columns(angle, turn))
    h[:, 3, unknown.stop - columns.shape[1] : unknown.stop] = columns
    z[:, 3:] = mean(apart) @ frame.T
    weight = np.maximum(found.weight_s, 1e-9)
    wobble = noise.angle if noise.wobble is None else noise.wobble
    r[:, 3] = noise.angle**2 / weight
    r[:, 4:] = wobble**2 / weight[:, None]
    z[found.weight_s <= 0.5 * found.length_s, 3:] = np.nan
    return replace(steps, h=h, z=z, r=r)


def _mean_over(first: IntArray, good: BoolArray):
    """Return a function that takes (n, c) to means over intervals (K, c), good rows only."""
    use = good.astype(float)
    count = np.maximum(np.add.reduceat(use, first[:-1]), 1.0)[:, None]

    def mean(values: FloatArray) -> FloatArray:
        if values.shape[1] == 0:
            return np.zeros((count.size, 0))
        return np.add.reduceat(values * use[:, None], first[:-1], axis=0) / count

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
