"""Calibration of a SINS from what it puts out while it navigates on the rig.

The SINS stands still (its centre does), so that its velocity is its velocity error and its position
its position error. Its own attitude, turned back by the error the filter finds, tells how each
sensor's error acts. State: attitude error φ, velocity and position errors, the unknowns of the
sensors. The heights of such systems are held by another sensor, so that the vertical channel
carries nothing; when the recorded height runs free it is used as well.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.errors import InputError
from errormodel.filtering import NO_GATE, Filtered, Steps, joined, run_filter
from errormodel.kalman import State, initial_state
from sinscal.attitude import rotation, rotvec_of, skew
from sinscal.earth import radii_m
from sinscal.integrate import sum_columns
from sinscal.navigation_errors import hold_height, navigation_dynamics
from sinscal.priors import RigPrior, make_prior
from sinscal.rigfilter import sensor_columns
from sinscal.run import NavRun
from sinscal.sensors import Motion, SensorModel, rate_derivative, sensor_model

MOVING = (
    *(f"attitude_{a}" for a in "enu"),
    *(f"velocity_{a}" for a in "enu"),
    *(f"position_{a}" for a in "enu"),
)
MAX_TURN_RAD = 0.01  # between outputs the attitude is followed in steps no larger than this
FREE_HEIGHT_M = 1.0  # a height that stays within this of the site's is held
PASSES = 2
# Outputs of unlimited resolution are taken to be as good as this: linear equations of errors that
# have grown to 15 km leave out a thousandth of a velocity's change in a second.
VELOCITY_FLOOR_M_S = 1e-5
POSITION_FLOOR_M = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class NavNoise:
    """Noise of the sensors behind the outputs, and of the outputs themselves.

    Attributes
    ----------
    gyro, accel : float
        Densities, rad/s/√Hz and m/s²/√Hz.
    velocity_m_s, position_m : float
        Sigma of an output about the navigator's own value: rounding, and what linear equations of
        the errors leave out.
    tilt_sigma_rad, azimuth_sigma_rad : float
        Of the attitude a cycle starts with.
    """

    gyro: float
    accel: float
    velocity_m_s: float = VELOCITY_FLOOR_M_S
    position_m: float = POSITION_FLOOR_M
    tilt_sigma_rad: float = 0.01
    azimuth_sigma_rad: float = 0.1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavCalibration:
    """What the outputs of navigation tell of the sensors.

    Attributes
    ----------
    sensors : SensorModel
    names, values, cov
        The sensors' unknowns, SI.
    states : tuple of str
        Of the filter.
    start, steps, filtered
        The filter's.
    cycle_of_step : ndarray of int, shape (K,)
        −1 for the steps that begin a cycle.
    time_s : ndarray, shape (K,)
    free_height : bool
    prior : RigPrior
    noise : NavNoise
    warnings : tuple of str
    """

    sensors: SensorModel
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    states: tuple[str, ...]
    start: State
    steps: Steps
    filtered: Filtered
    cycle_of_step: IntArray
    time_s: FloatArray
    free_height: bool
    prior: RigPrior
    noise: NavNoise
    warnings: tuple[str, ...] = ()
    mode: str = "navigation"

    @property
    def judged(self) -> tuple[int, ...]:
        """The measurements whose innovations are white: velocities.

        The positions are their integrals, so that their noise is a bound.
        """
        return (0, 1, 2) if self.free_height else (0, 1)

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, in the order of `names`."""
        return np.sqrt(np.diag(self.cov))


def nav_noise_of(run: NavRun) -> NavNoise:
    """Return the noise that a run's facts state.

    Raises
    ------
    InputError
        If a density is not stated.
    """
    facts = run.facts
    if not facts.gyro_noise or not facts.accel_noise:
        raise InputError(run.source, "gyro and accelerometer noise", "missing; densities, > 0")
    m, _ = radii_m(facts.site.lat_rad)
    return NavNoise(
        gyro=facts.gyro_noise,
        accel=facts.accel_noise,
        velocity_m_s=max(resolution(run.velocity[:, :2]) / np.sqrt(12.0), VELOCITY_FLOOR_M_S),
        position_m=max(resolution(run.lat_rad) * m / np.sqrt(12.0), POSITION_FLOOR_M),
    )


def resolution(values: FloatArray) -> float:
    """Return the step in which values are recorded: the smallest difference between two."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if steps.size else 0.0


def calibrate_navigation(
    run: NavRun,
    *,
    sensors: SensorModel | None = None,
    prior: RigPrior | None = None,
    noise: NavNoise | None = None,
    gate: float = NO_GATE,
) -> NavCalibration:
    """Calibrate a SINS from its navigation outputs.

    Parameters
    ----------
    run : NavRun
        With a row at the start of each cycle and at each output.
    sensors : SensorModel, optional
        What to estimate; by default biases, scale errors and misalignments.
    prior : RigPrior, optional
    noise : NavNoise, optional
    gate : float
        Innovations beyond so many sigmas are refused.

    Returns
    -------
    NavCalibration

    Raises
    ------
    InputError
        If the run has too few outputs or does not state its noise.
    """
    if len(run) < 10:
        raise InputError(run.source, "", f"{len(run)} outputs; expected at least 10")
    sensors = sensors or sensor_model(gravity_m_s2=run.facts.site.gravity_m_s2)
    prior = prior or make_prior(sensors)
    noise = noise or nav_noise_of(run)
    free = free_height(run)
    start = _start(sensors, prior, noise, free)
    turned: tuple[FloatArray, ...] = tuple(np.zeros((s.stop - s.start, 3)) for s in run.cycles)
    values = prior.values
    steps, cycle_of_step, times = nav_steps(run, sensors, noise, free, values, turned)
    for _ in range(PASSES):
        x = run_filter(start, steps, gate=gate).state.x[len(MOVING) :]
        turned = _followed(steps, run, x, start)
        values = prior.values + x
        steps, cycle_of_step, times = nav_steps(run, sensors, noise, free, values, turned)
    filtered = run_filter(start, steps, gate=gate)
    values = prior.values + filtered.state.x[len(MOVING) :]
    return NavCalibration(
        sensors=sensors,
        names=sensors.names,
        values=values,
        cov=filtered.state.cov[len(MOVING) :, len(MOVING) :],
        states=(*MOVING, *sensors.names),
        start=start,
        steps=steps,
        filtered=filtered,
        cycle_of_step=cycle_of_step,
        time_s=times,
        free_height=free,
        prior=prior,
        noise=noise,
        warnings=run.warnings,
    )


def free_height(run: NavRun) -> bool:
    """Tell whether the vertical channel runs free: its height leaves the site's."""
    off = float(np.max(np.abs(run.height_m - run.height_m[0])))
    return off > FREE_HEIGHT_M


def _start(sensors: SensorModel, prior: RigPrior, noise: NavNoise, free: bool) -> State:
    n = len(MOVING)
    cov = np.zeros((n + len(sensors.names),) * 2)
    cov[n:, n:] = prior.cov
    cov[:n, :n] = _fresh(noise, free)
    return initial_state(np.zeros(cov.shape[0]), cov)


def _fresh(noise: NavNoise, free: bool) -> FloatArray:
    """Return the covariance of the moving states at the start of a cycle, (9, 9)."""
    up = 1.0 if free else 0.0
    return np.diag(
        np.concatenate(
            [
                [noise.tilt_sigma_rad**2, noise.tilt_sigma_rad**2, noise.azimuth_sigma_rad**2],
                np.array([1.0, 1.0, up]) * noise.velocity_m_s**2,
                np.array([1.0, 1.0, up]) * noise.position_m**2,
            ]
        )
    )


def nav_steps(
    run: NavRun,
    sensors: SensorModel,
    noise: NavNoise,
    free: bool,
    values: FloatArray,
    turned: tuple[FloatArray, ...],
) -> tuple[Steps, IntArray, FloatArray]:
    """Linearise all cycles about the outputs turned back by attitude errors.

    Parameters
    ----------
    turned : tuple of ndarray, each (n, 3)
        Attitude errors at each cycle's outputs.

    Returns
    -------
    Steps, ndarray of int, ndarray
        And of each step its cycle (−1: it begins one) and time.
    """
    parts: list[Steps] = []
    cycle_of_step: list[int] = []
    times: list[FloatArray] = []
    for k, rows in enumerate(run.cycles):
        part = _cycle(run, rows, sensors, noise, free, values, turned[k])
        parts += [_restart(part, noise, free), part]
        count = rows.stop - rows.start
        cycle_of_step += [-1] + [k] * (count)
        times.append(np.concatenate([run.time_s[rows][:1], run.time_s[rows]]))
    steps = joined(parts)
    return steps, np.array(cycle_of_step), np.concatenate(times)


def _restart(like: Steps, noise: NavNoise, free: bool) -> Steps:
    """Return the step before a cycle: the moving states are forgotten and drawn anew."""
    _, m, n = like.h.shape
    lead = like.phi.shape[1]
    return Steps(
        h=np.zeros((1, m, n)),
        z=np.full((1, m), np.nan),
        r=np.ones((1, m)),
        phi=np.zeros((1, lead, n)),
        q=np.diag(_fresh(noise, free))[None, :],
    )


def _cycle(
    run: NavRun,
    rows: slice,
    sensors: SensorModel,
    noise: NavNoise,
    free: bool,
    values: FloatArray,
    turned: FloatArray,
) -> Steps:
    """Return a cycle's steps: at each output a measurement, then the motion to the next."""
    c_nb = rotation(turned) @ run.c_nb[rows]
    time_s = run.time_s[rows]
    count = time_s.size
    motion, middle, first = _between(run, rows, c_nb, time_s)
    columns = sensor_columns(sensors, motion, values)
    g = run.facts.site.gravity_m_s2
    found = sum_columns(middle, motion.step_s, np.ones(len(motion)), columns, first)
    n, lead = len(MOVING) + len(sensors.names), len(MOVING)
    phi, q = np.zeros((count, lead, n)), np.zeros((count, lead))
    lever = g * skew(np.array([0.0, 0.0, 1.0]))
    n_gyro = found.turned.shape[2]
    gyro, accel = slice(lead, lead + n_gyro), slice(lead + n_gyro, n)
    t = found.length_s[:, None, None]
    by_gyro = -found.turned
    pushed = t * found.forced
    phi[:-1, :, :lead] = _transitions(run, rows, found.length_s, free)
    phi[:-1, :3, gyro] = by_gyro
    phi[:-1, 3:6, gyro] = -t * (lever @ found.turned_mean)
    phi[:-1, 3:6, accel] = pushed
    phi[:-1, 6:9, gyro] = 0.5 * t * phi[:-1, 3:6, gyro]
    phi[:-1, 6:9, accel] = 0.5 * t * pushed
    phi[-1, :, :lead] = np.eye(lead)
    q[:-1, :3] = noise.gyro**2 * found.length_s[:, None]
    q[:-1, 3:6] = noise.accel**2 * found.length_s[:, None]
    used = [3, 4, 5, 6, 7, 8] if free else [3, 4, 6, 7]
    if not free:
        phi[:, [5, 8]] = 0.0
        q[:, 5] = 0.0
    h = np.zeros((count, len(used), n))
    h[:, np.arange(len(used)), used] = 1.0
    errors = np.hstack([run.velocity[rows], position_errors(run, rows)])
    sigmas = np.array([noise.velocity_m_s] * 3 + [noise.position_m] * 3)
    picked = [i - 3 for i in used]
    return Steps(
        h=h,
        z=errors[:, picked],
        r=np.tile(sigmas[picked] ** 2, (count, 1)),
        phi=phi,
        q=q,
    )


def position_errors(run: NavRun, rows: slice) -> FloatArray:
    """Return computed less true position, east, north, up, m, shape (n, 3).

    Differences of longitude count at the computed latitude: then the sum is the integral of the
    computed velocity, however far the position has gone.
    """
    lat, lon, height = run.lat_rad[rows], run.lon_rad[rows], run.height_m[rows]
    radii = [radii_m(float(x)) for x in 0.5 * (lat[1:] + lat[:-1])]
    m, n = np.array([r[0] for r in radii]), np.array([r[1] for r in radii])
    east = np.diff(lon) * (n + height[1:]) * np.cos(0.5 * (lat[1:] + lat[:-1]))
    north = np.diff(lat) * (m + height[1:])
    steps = np.column_stack([east, north, np.diff(height)])
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def _transitions(run: NavRun, rows: slice, length_s: FloatArray, free: bool) -> FloatArray:
    """Return the transition of the moving states over each interval, (K, 9, 9), positions in m."""
    site = run.facts.site
    f = navigation_dynamics(
        site.lat_rad, np.zeros(3), np.array([0.0, 0.0, site.gravity_m_s2]), site.height_m
    )
    if not free:
        hold_height(f)
    m, n = radii_m(site.lat_rad)
    # latitude, longitude, height to metres north, east, up
    to_m = np.zeros((9, 9))
    to_m[:6, :6] = np.eye(6)
    to_m[6, 7] = (n + site.height_m) * np.cos(site.lat_rad)
    to_m[7, 6] = m + site.height_m
    to_m[8, 8] = 1.0
    in_m = to_m @ f @ np.linalg.inv(to_m)
    t = length_s[:, None, None]
    first = t * in_m
    second = 0.5 * t * (first @ in_m)
    return np.eye(9) + first + second + t / 3.0 * (second @ in_m)


def _between(
    run: NavRun, rows: slice, c_nb: FloatArray, time_s: FloatArray
) -> tuple[Motion, FloatArray, IntArray]:
    """Follow the attitude between outputs at a uniform rate, in small steps."""
    site = run.facts.site
    turn = rotvec_of(np.swapaxes(c_nb[:-1], 1, 2) @ c_nb[1:])
    parts = max(1, int(np.ceil(float(np.max(np.linalg.norm(turn, axis=1))) / MAX_TURN_RAD)))
    length = np.diff(time_s)
    share = (np.arange(parts) + 0.5) / parts
    middle = c_nb[:-1, None] @ rotation(share[None, :, None] * turn[:, None])
    middle = middle.reshape(-1, 3, 3)
    step_s = np.repeat(length / parts, parts)
    back = np.swapaxes(middle, 1, 2)
    w = np.repeat(turn / length[:, None], parts, axis=0) + back @ site.earth_rate
    f = back @ np.array([0.0, 0.0, site.gravity_m_s2])
    temp = None
    if run.temp_c is not None:
        temp = np.repeat(0.5 * (run.temp_c[rows][:-1] + run.temp_c[rows][1:]), parts, axis=0)
    motion = Motion(
        time_s=np.cumsum(step_s),
        step_s=step_s,
        w=w,
        f=f,
        dw=rate_derivative(w, step_s),
        temp_c=temp,
    )
    first = np.arange(0, step_s.size + 1, parts)
    return motion, middle, first


def _followed(steps: Steps, run: NavRun, x: FloatArray, start: State) -> tuple[FloatArray, ...]:
    """Return the attitude errors over each cycle that the estimated unknowns explain.

    What the attitude was wrong at the start of a cycle is fitted to the velocities by the same
    dynamics; noise between is left out, it is small beside what turns the columns.
    """
    out: list[FloatArray] = []
    at = 0
    lead = steps.phi.shape[1]
    for rows in run.cycles:
        count = rows.stop - rows.start
        block = range(at + 1, at + 1 + count)
        free, forced = np.zeros((count, lead, 3)), np.zeros((count, lead))
        by_start, by_x = np.eye(lead, 3), np.zeros(lead)
        for i, k in enumerate(block):
            free[i], forced[i] = by_start, by_x
            by_start = steps.phi[k][:, :lead] @ by_start
            by_x = steps.phi[k][:, :lead] @ by_x + steps.phi[k][:, lead:] @ x
        use = slice(at + 1, at + 1 + count)
        h = steps.h[use][:, :, :lead]
        design = (h @ free).reshape(-1, 3)
        left = (steps.z[use] - (h @ forced[:, :, None])[:, :, 0]).reshape(-1)
        weight = 1.0 / np.sqrt(steps.r[use].reshape(-1))
        prior = np.diag(1.0 / np.sqrt(np.diag(start.cov)[:3]))
        joint = np.vstack([design * weight[:, None], prior])
        target = np.concatenate([left * weight, np.zeros(3)])
        begun = np.linalg.lstsq(joint, target, rcond=None)[0]
        out.append(forced[:, :3] + free[:, :3] @ begun)
        at += 1 + count
    return tuple(out)
