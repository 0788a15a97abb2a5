"""Strapdown navigation in local east-north-up axes: from gyros and accelerometers to position.

One step takes the mean rate and the mean specific force over it. Within the step both are taken
to change linearly, with the slope seen since the step before; that gives the coning and the
sculling term. The rotation of the body over the step is otherwise exact, that of the navigation
axes (7e-7 rad in 10 ms) is of second order, and so are the Coriolis terms and the position.

References
----------
Savage, P. G. (1998), Strapdown inertial navigation integration algorithm design, parts 1 and 2,
J. Guidance, Control, and Dynamics 21: two-speed structure, coning and sculling. The factors for
steps of unequal length are derived in docs/explanation/flight.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from errormodel.arrays import FloatArray, freeze, readonly
from sinscal.frames.earth import RATE_RAD_S, gravity_m_s2, radii_m
from sinscal.frames.quaternions import (
    Quaternion,
    Vector,
    cross,
    dot,
    normalised,
    plus,
    product,
    quaternion_of,
    row_of,
    times,
    turned,
    unit_quaternion,
    vector_of,
)

ORTHONORMAL = 1e-9  # how far a starting attitude may be from a rotation

compiled_radii_m = cast(Callable[[float], tuple[float, float]], numba.njit(cache=True)(radii_m))
compiled_gravity_m_s2 = cast(Callable[[float, float], float], numba.njit(cache=True)(gravity_m_s2))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavState:
    """Position, velocity and attitude of a body.

    Attributes
    ----------
    lat_rad, lon_rad, height_m : float
        Geodetic, on the ellipsoid of `sinscal.frames.earth`.
    velocity : ndarray, shape (3,)
        East, north, up, m/s.
    c_nb : ndarray, shape (3, 3)
        Takes body to east-north-up.
    """

    lat_rad: float
    lon_rad: float = 0.0
    height_m: float = 0.0
    velocity: FloatArray
    c_nb: FloatArray

    def __post_init__(self) -> None:
        freeze(self, velocity=readonly(self.velocity), c_nb=readonly(self.c_nb))
        if self.velocity.shape != (3,) or self.c_nb.shape != (3, 3):
            raise ValueError("expected a velocity of shape (3,) and an attitude of shape (3, 3)")
        off = np.abs(self.c_nb @ self.c_nb.T - np.eye(3)).max()
        if not (off < ORTHONORMAL and np.linalg.det(self.c_nb) > 0.0):
            raise ValueError("c_nb is not a rotation: its rows are not orthonormal")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Track:
    """Output of a navigator, n rows, the first of them its start.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        From the start.
    lat_rad, lon_rad, height_m : ndarray, shape (n,)
    velocity : ndarray, shape (n, 3)
        East, north, up, m/s.
    c_nb : ndarray, shape (n, 3, 3)
    """

    time_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    velocity: FloatArray
    c_nb: FloatArray

    def __post_init__(self) -> None:
        names = ("time_s", "lat_rad", "lon_rad", "height_m", "velocity", "c_nb")
        freeze(self, **{name: readonly(getattr(self, name)) for name in names})

    def __len__(self) -> int:
        return self.time_s.size


def navigate(
    step_s: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    start: NavState,
    *,
    every: int = 1,
    height_held: bool = True,
) -> Track:
    """Navigate from a start with nothing but the sensors.

    Parameters
    ----------
    step_s : ndarray, shape (n,)
        Length of each step; they may differ.
    gyro : ndarray, shape (n, 3)
        Mean rate of the body against inertial space over the step, rad/s.
    accel : ndarray, shape (n, 3)
        Mean specific force over the step, m/s².
    start : NavState
    every : int
        An output row after so many steps.
    height_held : bool
        Whether height stays that of the start and the vertical velocity zero, as with an outer
        aid; otherwise the vertical channel runs free and, as it must, away.

    Returns
    -------
    Track
        1 + n // every rows.

    Raises
    ------
    ValueError
        If shapes do not fit, a reading is not finite or a step not positive.
    """
    step, w, f = (np.ascontiguousarray(a, dtype=float) for a in (step_s, gyro, accel))
    if w.shape != (step.size, 3) or f.shape != (step.size, 3):
        raise ValueError(f"gyro {w.shape} and accel {f.shape}, expected ({step.size}, 3)")
    if every < 1:
        raise ValueError(f"every is {every}, expected at least 1")
    if not (np.isfinite(w).all() and np.isfinite(f).all() and (step > 0.0).all()):
        raise ValueError("expected finite readings and positive steps")
    place, velocity, quaternion = mechanise(
        step,
        w,
        f,
        (float(start.lat_rad), float(start.lon_rad), float(start.height_m)),
        vector_of(start.velocity),
        quaternion_of(start.c_nb),
        every,
        height_held,
    )
    time_s = np.concatenate([[0.0], np.cumsum(step)])[::every]
    return Track(
        time_s=time_s,
        lat_rad=place[:, 0],
        lon_rad=place[:, 1],
        height_m=place[:, 2],
        velocity=velocity,
        c_nb=Rotation.from_quat(quaternion, scalar_first=True).as_matrix(),
    )


@numba.njit(cache=True)
def mechanise(
    step: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    position: Vector,
    velocity: Vector,
    attitude: Quaternion,
    every: int,
    height_held: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Run all steps; return position, velocity and attitude quaternion of each output row."""
    n = step.size
    rows = 1 + n // every
    places, velocities = np.empty((rows, 3)), np.empty((rows, 3))
    quaternions = np.empty((rows, 4))
    p, v, q = position, velocity, attitude
    w0, f0, step0 = row_of(gyro, 0), row_of(accel, 0), step[0]
    for k in range(n + 1):
        if k % every == 0:
            at = k // every
            places[at], velocities[at], quaternions[at] = p, v, q
        if k < n:
            w, f = row_of(gyro, k), row_of(accel, k)
            # within the step the readings change as they did since the step before
            bend = step[k] ** 3 / (6.0 * (step[k] + step0))
            turn, push = body_increments(step[k], w, f, bend, w0, f0)
            p, v, q = advance(step[k], turn, push, p, v, q, height_held)
            w0, f0, step0 = w, f, step[k]
    return places, velocities, quaternions


@numba.njit(cache=True)
def body_increments(
    step: float, w: Vector, f: Vector, bend: float, w0: Vector, f0: Vector
) -> tuple[Vector, Vector]:
    """Return the body's rotation vector and velocity gain over a step, in its axes at the start.

    The gain is ∫ C(t) f dt with C the body's turn since the start: exact for constant w and f,
    plus the sculling term; the rotation vector has the coning term.
    """
    theta, gain = times(step, w), times(step, f)
    turn = plus(theta, times(bend, cross(w0, w)))
    angle2 = dot(theta, theta)
    if angle2 < 1e-8:
        first, second = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = np.sqrt(angle2)
        first = (1.0 - np.cos(angle)) / angle2
        second = (1.0 - np.sin(angle) / angle) / angle2
    once = cross(theta, gain)
    rotated = plus(times(first, once), times(second, cross(theta, once)))
    scull = times(bend, plus(cross(w0, f), cross(f0, w)))
    return turn, plus(gain, plus(rotated, scull))


@numba.njit(cache=True)
def advance(
    step: float, turn: Vector, push: Vector, p: Vector, v: Vector, q: Quaternion, height_held: bool
) -> tuple[Vector, Vector, Quaternion]:
    """Return position (latitude, longitude, height), velocity and attitude after a step."""
    pushed = turned(q, push)
    middle, gained, spin = v, v, v
    lat, height, r_m, r_n = p[0], p[2], 0.0, 0.0
    for _ in range(2):  # predict with the start's values, then repeat with those of the middle
        r_m, r_n = compiled_radii_m(lat)
        earth, craft = local_rates(lat, middle, r_m + height, r_n + height)
        spin = times(step, plus(earth, craft))
        gained = plus(plus(v, pushed), times(-0.5, cross(spin, pushed)))
        gained = plus(gained, times(-step, cross(plus(times(2.0, earth), craft), middle)))
        climb = 0.0 if height_held else gained[2] - step * compiled_gravity_m_s2(lat, height)
        gained = (gained[0], gained[1], climb)
        middle = times(0.5, plus(v, gained))
        lat = p[0] + 0.5 * step * middle[1] / (r_m + height)
        height = p[2] + 0.5 * step * middle[2]
    place = (
        p[0] + step * middle[1] / (r_m + height),
        p[1] + step * middle[0] / ((r_n + height) * np.cos(lat)),
        p[2] + step * middle[2],
    )
    q = product(product(unit_quaternion(times(-1.0, spin)), q), unit_quaternion(turn))
    return place, gained, normalised(q)


@numba.njit(cache=True)
def local_rates(lat: float, v: Vector, r_m: float, r_n: float) -> tuple[Vector, Vector]:
    """Return the earth's rate and that of the local axes against the earth, ENU, rad/s.

    `r_m` and `r_n` are the radii of curvature with the height added.
    """
    earth = (0.0, RATE_RAD_S * np.cos(lat), RATE_RAD_S * np.sin(lat))
    return earth, (-v[1] / r_m, v[0] / r_n, v[0] * np.tan(lat) / r_n)


@numba.njit(cache=True)
def gravities_m_s2(lat_rad: FloatArray, height_m: float) -> FloatArray:
    """Return gravity at many latitudes, m/s², shape (n,)."""
    out = np.empty(lat_rad.size)
    for k in range(lat_rad.size):
        out[k] = compiled_gravity_m_s2(lat_rad[k], height_m)
    return out
