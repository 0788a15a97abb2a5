"""The flight's covariance put to the test: many flights with the full nonlinear navigator.

Each run draws the sensors' residual errors, takes a mean of their readings at rest, levels and
finds north by it, and navigates the whole flight on erroneous readings. Nothing here knows the
linear equations; the covariance it is held against comes from `sinscal.flight.covariance`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, freeze, readonly
from sinscal.flight.covariance import FlightCovariance, FlightNoise
from sinscal.flight.navigation_errors import DLAT, DLON
from sinscal.flight.strapdown import NavState, Track, navigate
from sinscal.flight.trajectory import Flight, FlightPlan, fly
from sinscal.frames.attitude import rotvec_of
from sinscal.frames.earth import A_M, earth_rate_enu
from sinscal.model.motion import Motion
from sinscal.model.residual_errors import Calibration, at_rest, sensor_errors

STEP_S = 0.1  # perfect sensors keep a banked snake to a metre in an hour with it
LEVELS = (0.001, 0.999)  # between which the two tests may lie
HORIZONTAL = (0, 1, 2, 3, 4, 6, 7)  # states that are not zero with a held height


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlownErrors:
    """Navigation errors of many runs, in the states of `sinscal.flight.navigation_errors`.

    Attributes
    ----------
    time_s, lat_rad : ndarray, shape (n,)
    errors : ndarray, shape (runs, n, 9)
    """

    time_s: FloatArray
    lat_rad: FloatArray
    errors: FloatArray

    def __post_init__(self) -> None:
        freeze(self, **{k: readonly(getattr(self, k)) for k in ("time_s", "lat_rad", "errors")})

    @property
    def rho_m(self) -> FloatArray:
        """ρ with mean squares over the runs in place of variances, m, shape (n,)."""
        lat, lon = self.errors[:, :, DLAT], self.errors[:, :, DLON] * np.cos(self.lat_rad)
        return A_M * np.sqrt(np.mean(lat**2 + lon**2, axis=0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Agreement of simulated runs with a covariance at the flight's end.

    Attributes
    ----------
    runs : int
    rho_m, predicted_m : float
        ρ from the runs, and from the covariance.
    rho_interval_m : tuple of float
        Where the runs' ρ lies in 99.8 % of such trials if the covariance is right.
    chi2_per_dof : float
        Of all seven states together, with `dof` degrees of freedom.
    dof : int
    p_value : float
        Probability of a χ² as large as that or larger.
    agrees : bool
        Whether ρ lies in its interval and the p-value between 0.001 and 0.999.
    """

    runs: int
    rho_m: float
    predicted_m: float
    rho_interval_m: tuple[float, float]
    chi2_per_dof: float
    dof: int
    p_value: float

    @property
    def agrees(self) -> bool:
        """True when both tests are passed."""
        low, high = self.rho_interval_m
        return low <= self.rho_m <= high and LEVELS[0] <= self.p_value <= LEVELS[1]


def fly_runs(
    plan: FlightPlan,
    calibration: Calibration,
    runs: int,
    *,
    noise: FlightNoise | None = None,
    seed: int = 0,
    every_s: float = 60.0,
    progress: Callable[[int, int], None] | None = None,
) -> FlownErrors:
    """Fly a plan many times with sensors drawn from a calibration's covariance.

    Parameters
    ----------
    plan : FlightPlan
    calibration : Calibration
    runs : int
    noise : FlightNoise, optional
    seed : int
    every_s : float
        Between output times.
    progress : callable, optional
        Told how many runs of how many are done.

    Raises
    ------
    ValueError
        If there are no runs, or the output interval does not fit the flight.
    """
    noise = noise or FlightNoise()
    every = round(every_s / STEP_S)
    if runs < 1:
        raise ValueError(f"{runs} runs, expected at least 1")
    if not 1 <= every <= plan.duration_s / STEP_S:
        raise ValueError(f"an output every {every_s:g} s does not fit into {plan.duration_s:g} s")
    flight = fly(plan, STEP_S)
    rng = np.random.default_rng(seed)
    root = calibration.root
    errors: list[FloatArray] = []
    for k in range(runs):
        drawn = root @ rng.standard_normal(len(calibration.names))
        values = dict(zip(calibration.names, drawn.tolist(), strict=True))
        errors.append(_errors_of(_fly_once(flight, values, noise, rng, every), flight, every))
        if progress is not None:
            progress(k + 1, runs)
    return FlownErrors(
        time_s=flight.time_s[::every], lat_rad=flight.lat_rad[::every], errors=np.array(errors)
    )


def agreement(flown: FlownErrors, predicted: FlightCovariance) -> Agreement:
    """Hold runs against a covariance, at the end of the flight.

    ρ² of N runs is a weighted sum of χ² variables; its interval takes the two weights as they
    are, by Satterthwaite's equivalent number of degrees of freedom.

    Raises
    ------
    ValueError
        If the two do not end at the same time.
    """
    if flown.time_s[-1] != predicted.time_s[-1]:
        raise ValueError("the runs and the covariance do not end at the same time")
    runs = flown.errors.shape[0]
    e = flown.errors[:, -1, HORIZONTAL]
    cov = predicted.cov[-1][np.ix_(HORIZONTAL, HORIZONTAL)]
    scale = np.sqrt(np.diag(cov))
    correlation: FloatArray = cov / np.outer(scale, scale)
    scaled = e / scale
    information = np.asarray(np.linalg.inv(correlation), dtype=float)
    chi2 = float(np.einsum("ki,ij,kj", scaled, information, scaled))
    to_m = A_M * np.array([1.0, np.cos(flown.lat_rad[-1])])
    position = predicted.cov[-1][np.ix_([DLAT, DLON], [DLAT, DLON])] * np.outer(to_m, to_m)
    dof = runs * float(np.trace(position) ** 2 / np.sum(position**2))
    low, high = np.sqrt(stats.chi2.ppf(LEVELS, dof) / dof) * predicted.rho_end_m
    return Agreement(
        runs=runs,
        rho_m=float(flown.rho_m[-1]),
        predicted_m=predicted.rho_end_m,
        rho_interval_m=(float(low), float(high)),
        chi2_per_dof=chi2 / e.size,
        dof=e.size,
        p_value=float(stats.chi2.sf(chi2, e.size)),
    )


def align(gyro: FloatArray, accel: FloatArray) -> FloatArray:
    """Return the attitude C_nb that mean readings at rest tell, shape (3, 3).

    Up is where the specific force points; east is at right angles to it and the earth's rate.
    """
    up = accel / np.linalg.norm(accel)
    east = np.cross(gyro, up)
    east = east / np.linalg.norm(east)
    return np.array([east, np.cross(up, east), up])


def _fly_once(
    flight: Flight,
    values: dict[str, float],
    noise: FlightNoise,
    rng: np.random.Generator,
    every: int,
) -> Track:
    plan, n, h = flight.plan, len(flight.mean_gyro), flight.step_s
    c_nb = plan.start_attitude
    rest_gyro = c_nb.T @ earth_rate_enu(plan.latitude_rad)
    rest_accel = c_nb.T @ np.array([0.0, 0.0, plan.gravity_m_s2])
    rest = sensor_errors(values, at_rest(rest_gyro, rest_accel))[0]
    by_gyro, by_accel = noise.mean_at_rest
    aligned = align(
        rest_gyro + rest[:3] + by_gyro * rng.standard_normal(3),
        rest_accel + rest[3:] + by_accel * rng.standard_normal(3),
    )
    motion = Motion(
        time_s=flight.time_s[1:],
        step_s=np.full(n, h),
        w=flight.mean_gyro,
        f=flight.mean_accel,
        dw=np.diff(flight.gyro, axis=0) / h,
    )
    errors = sensor_errors(values, motion)
    if noise.gyro > 0.0:
        errors[:, :3] += noise.gyro / np.sqrt(h) * rng.standard_normal((n, 3))
    if noise.accel > 0.0:
        errors[:, 3:] += noise.accel / np.sqrt(h) * rng.standard_normal((n, 3))
    start = NavState(
        lat_rad=plan.latitude_rad,
        height_m=plan.height_m,
        velocity=flight.velocity[0],
        c_nb=aligned,
    )
    gyro, accel = motion.w + errors[:, :3], motion.f + errors[:, 3:]
    return navigate(motion.step_s, gyro, accel, start, every=every)


def _errors_of(track: Track, flight: Flight, every: int) -> FloatArray:
    out = np.zeros((len(track), 9))
    out[:, :3] = rotvec_of(flight.c_nb[::every] @ np.swapaxes(track.c_nb, 1, 2))
    out[:, 3:6] = track.velocity - flight.velocity[::every]
    out[:, DLAT] = track.lat_rad - flight.lat_rad[::every]
    out[:, DLON] = track.lon_rad - flight.lon_rad[::every]
    return out
