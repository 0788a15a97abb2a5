"""Covariance of autonomous navigation after a calibration.

As nothing is measured in flight, what a parameter p does to the errors x of the navigator (φ, δv,
δlat, δlon, δh, see `sinscal.flight.navigation_errors`) is a sensitivity Ψ = ∂x/∂p that starts with
the
alignment, follows Ψ' = F Ψ + G, and gives the covariance Ψ P Ψᵀ of any calibration P. White noise
of the sensors adds its own.

The alignment at rest levels by the accelerometers and finds north by the gyros, so its errors are
those of the same parameters and correlated with them:

    φ_E = −δf_N/g,   φ_N = δf_E/g,   φ_U = φ_N·tan(lat) − δω_E/(Ω·cos(lat)).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from sinscal.flight.navigation_errors import (
    DLAT,
    DLON,
    N_STATES,
    PHI,
    hold_height,
    navigation_dynamics,
)
from sinscal.flight.trajectory import Flight, FlightPlan, fly
from sinscal.frames.earth import A_M, earth_rate_enu
from sinscal.model.motion import Motion
from sinscal.model.noise import InertialNoise
from sinscal.model.residual_errors import Calibration, at_rest, error_columns

ErrorColumns = Callable[[Motion], FloatArray]
STEP_S = 1.0  # of the Runge-Kutta integration: the snake's periods are of minutes
NOISE = "sensor noise"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightNoise(InertialNoise):
    """White noise of the sensors in flight and in the alignment before it.

    Attributes
    ----------
    alignment_s : float
        How long the alignment takes the mean of the readings; 0: so long that only the
        parameters' errors are left.
    """

    gyro: float = 0.0
    accel: float = 0.0
    alignment_s: float = 0.0

    def __post_init__(self) -> None:
        if not (min(self.gyro, self.accel, self.alignment_s) >= 0.0):
            raise ValueError("expected noise densities and an alignment time of 0 or more")

    @property
    def mean_at_rest(self) -> tuple[float, float]:
        """Standard deviations of gyro and accelerometer means in the alignment."""
        if self.alignment_s == 0.0:
            return 0.0, 0.0
        return self.gyro / np.sqrt(self.alignment_s), self.accel / np.sqrt(self.alignment_s)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sensitivity:
    """Effect of parameters and noise on a flight's navigation, at n times.

    Attributes
    ----------
    flight : FlightPlan
    names : tuple of str
        The m parameters.
    time_s, lat_rad : ndarray, shape (n,)
    psi : ndarray, shape (n, 9, m)
        ∂(navigation errors)/∂(parameters).
    noise_cov : ndarray, shape (n, 9, 9)
    """

    flight: FlightPlan
    names: tuple[str, ...]
    time_s: FloatArray
    lat_rad: FloatArray
    psi: FloatArray
    noise_cov: FloatArray

    def __post_init__(self) -> None:
        names = ("time_s", "lat_rad", "psi", "noise_cov")
        freeze(self, **{name: readonly(getattr(self, name)) for name in names})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlightCovariance:
    """Errors of autonomous navigation that a calibration leaves, at n times.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    rho_m : ndarray, shape (n,)
        a·√(σ²(δlat) + cos²(lat)·σ²(δlon)).
    sigma : ndarray, shape (n, 9)
        Of attitude (rad), velocity (m/s), latitude, longitude (rad) and height (m).
    cov : ndarray, shape (n, 9, 9)
    share : mapping of str to ndarray, shape (n,)
        What each group of parameters, and the noise, has of ρ²: they add up to 1. Where errors of
        groups are correlated and cancel, a share can be negative or above 1.
    """

    time_s: FloatArray
    rho_m: FloatArray
    sigma: FloatArray
    cov: FloatArray
    share: dict[str, FloatArray]

    @property
    def rho_end_m(self) -> float:
        """ρ at the end of the flight, m."""
        return float(self.rho_m[-1])


def flight_sensitivity(
    plan: FlightPlan,
    names: tuple[str, ...],
    *,
    columns: ErrorColumns | None = None,
    noise: FlightNoise | None = None,
    every_s: float = 10.0,
) -> Sensitivity:
    """Propagate the sensitivity to each parameter along a flight, with the height held.

    Parameters
    ----------
    plan : FlightPlan
    names : tuple of str
        Parameters, see `sinscal.model.residual_errors`.
    columns : callable, optional
        From a motion to ∂(δω, δf)/∂(parameters), (n, 6, m), for parameters of other sensors than
        those.
    noise : FlightNoise, optional
        None when not given.
    every_s : float
        Between output times.

    Raises
    ------
    ValueError
        If the output interval does not fit the flight.
    """
    noise = noise or FlightNoise()
    steps = int(np.floor(plan.duration_s / STEP_S + 1e-9))
    every = round(every_s / STEP_S)
    if every < 1 or steps < every:
        raise ValueError(f"an output every {every_s:g} s does not fit into {plan.duration_s:g} s")
    flight = fly(plan, STEP_S / 2.0)
    source = columns or partial(error_columns, names)
    block = source(_motion(flight))
    psi, noise_cov = _propagate(
        flight.lat_rad,
        flight.velocity,
        np.einsum("kij,kj->ki", flight.c_nb, flight.accel),
        plan.height_m,
        np.concatenate([-flight.c_nb @ block[:, :3], flight.c_nb @ block[:, 3:]], axis=1),
        alignment_map(plan, source),
        alignment_noise_cov(plan, noise),
        np.array([noise.gyro**2] * 3 + [noise.accel**2] * 2 + [0.0] * 4),
        STEP_S,
        every,
    )
    rows = slice(0, 2 * steps + 1, 2 * every)
    return Sensitivity(
        flight=plan,
        names=names,
        time_s=flight.time_s[rows],
        lat_rad=flight.lat_rad[rows],
        psi=psi,
        noise_cov=noise_cov,
    )


def assess(sensitivity: Sensitivity, calibration: Calibration) -> FlightCovariance:
    """Return what a calibration leaves of navigation errors.

    Raises
    ------
    ValueError
        If the sensitivity was not made for the calibration's parameters.
    """
    if calibration.names != sensitivity.names:
        raise ValueError("the sensitivity has other parameters than the calibration")
    psi, p = sensitivity.psi, calibration.cov
    cov = psi @ p @ np.swapaxes(psi, 1, 2) + sensitivity.noise_cov
    to_m = A_M * np.stack([np.ones_like(sensitivity.lat_rad), np.cos(sensitivity.lat_rad)], axis=1)
    of_position = to_m[:, :, None] * psi[:, [DLAT, DLON]]
    by_parameter = np.einsum("kij,kij->kj", of_position, of_position @ p)
    by_noise = np.sum(
        to_m**2 * np.diagonal(sensitivity.noise_cov, axis1=1, axis2=2)[:, [DLAT, DLON]], axis=1
    )
    rho2 = by_parameter.sum(axis=1) + by_noise
    safe = np.where(rho2 > 0.0, rho2, 1.0)
    groups = np.array(calibration.groups)
    share = {
        group: by_parameter[:, groups == group].sum(axis=1) / safe
        for group in dict.fromkeys(calibration.groups)
    }
    return FlightCovariance(
        time_s=sensitivity.time_s,
        rho_m=np.sqrt(np.maximum(rho2, 0.0)),
        sigma=np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 0.0)),
        cov=cov,
        share={**share, NOISE: by_noise / safe},
    )


def alignment_map(plan: FlightPlan, columns: ErrorColumns) -> FloatArray:
    """Return the start's errors for each parameter, shape (9, m): those of the alignment at rest.

    Position and velocity are known at the start.
    """
    c_nb = plan.start_attitude
    rate = c_nb.T @ earth_rate_enu(plan.latitude_rad)
    force = c_nb.T @ np.array([0.0, 0.0, plan.gravity_m_s2])
    block = columns(at_rest(rate, force))[0]
    out = np.zeros((N_STATES, block.shape[1]))
    out[PHI] = _align_jacobian(plan) @ np.concatenate([c_nb @ block[:3], c_nb @ block[3:]])
    return out


def alignment_noise_cov(plan: FlightPlan, noise: FlightNoise) -> FloatArray:
    """Return the covariance of the start's errors from the noise in the alignment, shape (9, 9)."""
    by_gyro, by_accel = noise.mean_at_rest
    root = _align_jacobian(plan) * np.array([by_gyro] * 3 + [by_accel] * 3)
    out = np.zeros((N_STATES, N_STATES))
    out[PHI, PHI] = root @ root.T
    return out


def _align_jacobian(plan: FlightPlan) -> FloatArray:
    """Return ∂φ/∂(δω, δf), all in east-north-up, shape (3, 6)."""
    g, lat = plan.gravity_m_s2, plan.latitude_rad
    out = np.zeros((3, 6))
    out[0, 4] = -1.0 / g
    out[1, 3] = 1.0 / g
    out[2, 3] = np.tan(lat) / g
    out[2, 0] = -1.0 / earth_rate_enu(lat)[1]
    return out


def _motion(flight: Flight) -> Motion:
    return Motion(
        time_s=flight.time_s,
        step_s=np.full(flight.time_s.size, flight.step_s),
        w=flight.gyro,
        f=flight.accel,
        dw=np.gradient(flight.gyro, flight.step_s, axis=0),
    )


@numba.njit(cache=True)
def _propagate(
    lat: FloatArray,
    v: FloatArray,
    f_n: FloatArray,
    height: float,
    g: FloatArray,
    start: FloatArray,
    start_cov: FloatArray,
    q: FloatArray,
    step: float,
    every: int,
) -> tuple[FloatArray, FloatArray]:
    """Integrate Ψ' = F Ψ + G and N' = F N + N Fᵀ + Q by Runge-Kutta; inputs are at half steps."""
    n, m = (lat.size - 1) // 2, start.shape[1]
    psi, cov = start.copy(), start_cov.copy()
    psis, covs = np.empty((1 + n // every, 9, m)), np.empty((1 + n // every, 9, 9))
    psis[0], covs[0] = psi, cov
    for k in range(n):
        dpsi, dcov = np.zeros((9, m)), np.zeros((9, 9))
        psi_stage, cov_stage = psi, cov
        for stage in range(4):
            row = 2 * k + (stage + 1) // 2
            f = navigation_dynamics(lat[row], v[row], f_n[row], height)
            hold_height(f)
            slope = f @ psi_stage
            slope[:6] += g[row]
            slope[5] = 0.0
            half = f @ cov_stage
            cov_slope = half + half.T + np.diag(q)
            weight = step / 6.0 if stage in (0, 3) else step / 3.0
            dpsi += weight * slope
            dcov += weight * cov_slope
            ahead = step if stage == 2 else 0.5 * step
            psi_stage, cov_stage = psi + ahead * slope, cov + ahead * cov_slope
        psi, cov = psi + dpsi, cov + dcov
        if (k + 1) % every == 0:
            psis[(k + 1) // every], covs[(k + 1) // every] = psi, cov
    return psis, covs
