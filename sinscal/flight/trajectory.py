"""Flights for the covariance of navigation: straight, or a snake, with the sensors' exact readings.

A flight keeps its height. It starts at rest with a take-off run that ends at the cruising speed,
or, with a run of no length, in the air. On the snake the heading swings about its mean as a sine,
which a smooth envelope lets in over one period after the take-off. The body's y looks along the
velocity, z up; in a coordinated turn it banks so that the specific force stays in its y-z plane.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from scipy.optimize import brentq
from scipy.special import struve

from errormodel.arrays import FloatArray, freeze, readonly
from sinscal.flight.strapdown import gravities_m_s2
from sinscal.frames.attitude import c_nb_from_angles
from sinscal.frames.earth import A_M, E2, RATE_RAD_S, gravity_m_s2

MAX_SWING_RAD = np.deg2rad(80.0)  # of the heading about its mean
MAX_BANK_RAD = np.deg2rad(65.0)
MOSCOW_RAD = np.deg2rad(55.75)

# Gauss-Legendre nodes and weights on [0, 1], and the integrals from 0 to each node of what takes
# given values at the nodes: the coefficients of the three-stage Gauss method, of sixth order
_R15 = np.sqrt(15.0)
NODES = np.array([0.5 - _R15 / 10.0, 0.5, 0.5 + _R15 / 10.0])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
TO_NODES = np.array(
    [
        [5 / 36, 2 / 9 - _R15 / 15, 5 / 36 - _R15 / 30],
        [5 / 36 + _R15 / 24, 2 / 9, 5 / 36 - _R15 / 24],
        [5 / 36 + _R15 / 30, 2 / 9 + _R15 / 15, 5 / 36],
    ]
)


@dataclass(frozen=True, kw_only=True)
class FlightPlan:
    """A flight at constant height.

    Attributes
    ----------
    speed_m_s : float
        Cruising speed.
    heading_rad : float
        Mean heading, from north clockwise.
    duration_s : float
        From the start of the take-off run.
    latitude_rad, height_m : float
        Of the start; the longitude counts from there.
    amplitude_m, period_s : float
        The snake's: half of its width, and the time from one swing to the next. With an amplitude
        of zero the flight is straight.
    banked : bool
        Whether turns are coordinated; otherwise the wings stay level.
    takeoff_s : float
        Length of the take-off run; 0 starts in the air, with the velocity known.

    Raises
    ------
    ValueError
        If a number is not in its range, or the snake too wide or too steep to be flown.
    """

    speed_m_s: float = 250.0
    heading_rad: float = 0.0
    duration_s: float = 3600.0
    latitude_rad: float = MOSCOW_RAD
    height_m: float = 0.0
    amplitude_m: float = 0.0
    period_s: float = 300.0
    banked: bool = True
    takeoff_s: float = 100.0

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "duration_s", "period_s"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, expected above 0")
        for name in ("amplitude_m", "takeoff_s"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 or more")
        if not abs(self.latitude_rad) < np.deg2rad(85.0):
            raise ValueError("the latitude is beyond 85°, where gyrocompassing and longitude fail")
        if not np.isfinite([self.heading_rad, self.height_m]).all():
            raise ValueError("expected a finite heading and height")
        if self.max_bank_rad > MAX_BANK_RAD:
            raise ValueError(
                f"the snake needs a bank of {np.rad2deg(self.max_bank_rad):.0f}°, expected at most "
                f"{np.rad2deg(MAX_BANK_RAD):.0f}°: a smaller amplitude or a longer period"
            )

    @cached_property
    def swing_rad(self) -> float:
        """Amplitude of the heading: half a swing carries the flight 2·amplitude aside.

        The integral of sin(Ψ sin x) over half a period is π times Struve's H0(Ψ).
        """
        wanted = 4.0 * self.amplitude_m / (self.speed_m_s * self.period_s)
        if wanted == 0.0:
            return 0.0
        most = _half_swing(MAX_SWING_RAD)
        if wanted > most:
            raise ValueError(
                f"the snake's amplitude of {self.amplitude_m:g} m cannot be flown at "
                f"{self.speed_m_s:g} m/s within a period of {self.period_s:g} s, expected at most "
                f"{most * self.speed_m_s * self.period_s / 4.0:.0f} m"
            )

        def short(swing: float) -> float:
            return _half_swing(swing) - wanted

        return float(brentq(short, 0.0, MAX_SWING_RAD, xtol=1e-13))  # type: ignore[arg-type]

    @property
    def max_bank_rad(self) -> float:
        """Steepest bank of the full swing."""
        turn = self.swing_rad * 2.0 * np.pi / self.period_s
        return float(np.arctan(self.speed_m_s * turn / self.gravity_m_s2)) if self.banked else 0.0

    @property
    def gravity_m_s2(self) -> float:
        """Gravity at the start, m/s²."""
        return gravity_m_s2(self.latitude_rad, self.height_m)

    @property
    def start_attitude(self) -> FloatArray:
        """C_nb at rest before the take-off, shape (3, 3): level, along the mean heading."""
        return c_nb_from_angles(np.array(0.0), np.array(0.0), np.array(self.heading_rad))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Flight:
    """A flight flown: what is true at the n + 1 ends of n equal steps, and the means over them.

    Attributes
    ----------
    plan : FlightPlan
    step_s : float
    time_s, lat_rad, lon_rad : ndarray, shape (n + 1,)
    velocity : ndarray, shape (n + 1, 3)
        East, north, up, m/s.
    c_nb : ndarray, shape (n + 1, 3, 3)
    gyro, accel : ndarray, shape (n + 1, 3)
        Rate against inertial space, rad/s, and specific force, m/s², at these times; body axes.
    mean_gyro, mean_accel : ndarray, shape (n, 3)
        Their means over the steps: what perfect sensors give.
    """

    plan: FlightPlan
    step_s: float
    time_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    velocity: FloatArray
    c_nb: FloatArray
    gyro: FloatArray
    accel: FloatArray
    mean_gyro: FloatArray
    mean_accel: FloatArray

    def __post_init__(self) -> None:
        names = ("time_s", "lat_rad", "lon_rad", "velocity", "c_nb", "gyro", "accel")
        means = ("mean_gyro", "mean_accel")
        freeze(self, **{name: readonly(getattr(self, name)) for name in (*names, *means)})


def fly(plan: FlightPlan, step_s: float) -> Flight:
    """Fly a plan; the last step ends at its duration or just before.

    Raises
    ------
    ValueError
        If the step is not positive or longer than the flight.
    """
    n = int(np.floor(plan.duration_s / step_s + 1e-9)) if step_s > 0.0 else 0
    if n < 1:
        raise ValueError(f"a step of {step_s} s does not fit into {plan.duration_s} s")
    edges = step_s * np.arange(n + 1)
    nodes = edges[:-1, None] + step_s * NODES
    lat, lat_nodes, lon = _positions(plan, nodes, step_s)
    gyro, accel, c_nb = _sensors(plan, edges, lat)
    inside = [_sensors(plan, nodes[:, k], lat_nodes[:, k]) for k in range(NODES.size)]
    return Flight(
        plan=plan,
        step_s=step_s,
        time_s=edges,
        lat_rad=lat,
        lon_rad=lon,
        velocity=_velocity(plan, edges),
        c_nb=c_nb,
        gyro=gyro,
        accel=accel,
        mean_gyro=sum(w * one[0] for w, one in zip(WEIGHTS, inside, strict=True)),  # type: ignore[arg-type]
        mean_accel=sum(w * one[1] for w, one in zip(WEIGHTS, inside, strict=True)),  # type: ignore[arg-type]
    )


def _half_swing(swing_rad: float) -> float:
    """Return Struve's H0."""
    return float(cast(float, struve(0, swing_rad)))


def _smooth(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a step from 0 to 1 within 0 … 1, and its two derivatives; the second is continuous."""
    x = np.clip(x, 0.0, 1.0)
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        30.0 * x**2 * (1.0 - x) ** 2,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
    )


def _speed(plan: FlightPlan, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return speed and its derivative."""
    if plan.takeoff_s == 0.0:
        return np.full(t.shape, plan.speed_m_s), np.zeros(t.shape)
    value, first, _ = _smooth(t / plan.takeoff_s)
    return plan.speed_m_s * value, plan.speed_m_s / plan.takeoff_s * first


def _heading(plan: FlightPlan, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heading and its first two derivatives."""
    w = 2.0 * np.pi / plan.period_s
    u = t - plan.takeoff_s
    e, e1, e2 = _smooth(u / plan.period_s)
    e1, e2 = e1 / plan.period_s, e2 / plan.period_s**2
    s, c = np.sin(w * u), np.cos(w * u)
    swing = plan.swing_rad
    return (
        plan.heading_rad + swing * e * s,
        swing * (e1 * s + e * w * c),
        swing * (e2 * s + 2.0 * e1 * w * c - e * w**2 * s),
    )


def _velocity(plan: FlightPlan, t: FloatArray) -> FloatArray:
    speed, _ = _speed(plan, t)
    heading, _, _ = _heading(plan, t)
    return np.stack([speed * np.sin(heading), speed * np.cos(heading), np.zeros_like(t)], axis=-1)


def _radii_m(lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    w2 = 1.0 - E2 * np.sin(lat) ** 2
    return A_M * (1.0 - E2) / w2**1.5, A_M / np.sqrt(w2)


def _positions(
    plan: FlightPlan, nodes: FloatArray, step_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitude at ends and nodes, and longitude at the ends.

    The latitude's rate depends on it by the ellipsoid's e² only: each round of inserting the last
    result gains three digits.
    """
    velocity = _velocity(plan, nodes)
    at_nodes = np.full(nodes.shape, plan.latitude_rad)
    ends = np.full(nodes.shape[0] + 1, plan.latitude_rad)
    for _ in range(6):
        rate = velocity[..., 1] / (_radii_m(at_nodes)[0] + plan.height_m)
        ends = plan.latitude_rad + np.concatenate([[0.0], np.cumsum(step_s * (rate @ WEIGHTS))])
        at_nodes = ends[:-1, None] + step_s * (rate @ TO_NODES.T)
    rate = velocity[..., 0] / ((_radii_m(at_nodes)[1] + plan.height_m) * np.cos(at_nodes))
    return ends, at_nodes, np.concatenate([[0.0], np.cumsum(step_s * (rate @ WEIGHTS))])


def _sensors(
    plan: FlightPlan, t: FloatArray, lat: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rate, specific force (body axes) and attitude at given times and latitudes."""
    speed, speed_rate = _speed(plan, t)
    heading, turn, turn_rate = _heading(plan, t)
    tangent = speed * turn / plan.gravity_m_s2 if plan.banked else np.zeros_like(t)
    tangent_rate = (speed_rate * turn + speed * turn_rate) / plan.gravity_m_s2
    roll_rate = tangent_rate / (1.0 + tangent**2) if plan.banked else np.zeros_like(t)
    c_nb = c_nb_from_angles(np.arctan(tangent), np.zeros_like(t), heading)

    velocity = _velocity(plan, t)
    r_m, r_n = _radii_m(lat)
    craft = np.stack(
        [
            -velocity[:, 1] / (r_m + plan.height_m),
            velocity[:, 0] / (r_n + plan.height_m),
            velocity[:, 0] * np.tan(lat) / (r_n + plan.height_m),
        ],
        axis=-1,
    )
    earth = RATE_RAD_S * np.stack([np.zeros_like(lat), np.cos(lat), np.sin(lat)], axis=-1)
    along = np.stack([np.sin(heading), np.cos(heading), np.zeros_like(t)], axis=-1)
    right = np.stack([np.cos(heading), -np.sin(heading), np.zeros_like(t)], axis=-1)
    force = speed_rate[:, None] * along + (speed * turn)[:, None] * right
    force = force + np.cross(2.0 * earth + craft, velocity)
    force[:, 2] += gravities_m_s2(lat, plan.height_m)
    about_n = earth + craft - turn[:, None] * np.array([0.0, 0.0, 1.0])
    gyro = np.einsum("kji,kj->ki", c_nb, about_n) + roll_rate[:, None] * np.array([0.0, 1.0, 0.0])
    return gyro, np.einsum("kji,kj->ki", c_nb, force), c_nb
