"""How a motor-driven turntable really moves a SINS, at 1 kHz; shares no code with the package.

Frames: n is east, north, up; b the instrument's axes; `c_nb` takes b to n. The rotation axis is
nearly horizontal, at an azimuth clockwise from north; positive rate by its right hand. At platform
angle 0, instrument axis k lies along the axis and the second after it in the order x, y, z, x, y
points up (for k = x: z up, y to the left of the axis).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

STEP_S = 1e-3
EARTH_RATE = 7.292115e-5  # rad/s, WGS 84
AXES = "xyz"


def normal_gravity(latitude_rad: float, height_m: float) -> float:
    """Return WGS 84 normal gravity, m/s² (Somigliana's closed formula, second order in height)."""
    s2 = np.sin(latitude_rad) ** 2
    surface = 9.7803253359 * (1 + 1.931852652458e-3 * s2) / np.sqrt(1 - 6.694379990141e-3 * s2)
    a, f, m = 6378137.0, 1 / 298.257223563, 3.449786506841e-3
    slope = 2 / a * (1 + f + m - 2 * f * s2)
    return float(surface * (1 - slope * height_m + 3 * height_m**2 / a**2))


def skew(v: Sequence[float] | Floats) -> Floats:
    """Return the matrix of v ×."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(v: Sequence[float] | Floats) -> Floats:
    """Return the rotation matrix of a rotation vector (Rodrigues)."""
    v = np.asarray(v, dtype=float)
    angle = float(np.linalg.norm(v))
    k = skew(v / angle) if angle > 0 else np.zeros((3, 3))
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def quat_of(v: Floats) -> Floats:
    """Return unit quaternions, scalar first, of rotation vectors, shape (..., 3)."""
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], axis=-1)


def quat_product(p: Floats, q: Floats) -> Floats:
    """Return p ⊗ q."""
    pw, pv, qw, qv = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    w = pw * qw - np.sum(pv * qv, axis=-1, keepdims=True)
    return np.concatenate([w, pw * qv + qw * pv + np.cross(pv, qv)], axis=-1)


def matrix_of(q: Floats) -> Floats:
    """Return rotation matrices of unit quaternions, shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def integrate(turns: Floats) -> Floats:
    """Return the running products of many small rotations, shape (n + 1, 4), the first the unit.

    One loop steps through all pieces of the record at once, a second joins the pieces.
    """
    n = len(turns)
    width = max(1, int(np.sqrt(n)))
    pieces = -(-n // width)
    small = np.zeros((pieces * width, 3))
    small[:n] = turns
    steps = quat_of(small).reshape(pieces, width, 4)
    local = np.empty_like(steps)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (pieces, 1))
    for k in range(width):
        q = quat_product(q, steps[:, k])
        local[:, k] = q
    start = np.empty((pieces, 4))
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(pieces):
        start[k] = q
        q = quat_product(q, local[k, -1])
    joined = quat_product(start[:, None], local).reshape(-1, 4)[:n]
    joined /= np.linalg.norm(joined, axis=1, keepdims=True)
    return np.concatenate([[[1.0, 0.0, 0.0, 0.0]], joined])


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A real turntable: its place, its axis, and what its motor and bearing do wrong."""

    latitude_deg: float = 55.7
    height_m: float = 150.0
    azimuth_deg: float = 30.0
    tilt_arcmin: float = 3.0  # of the rotation axis, up where positive
    wobble_arcsec: float = 2.0  # of the bearing, twice a turn
    ripple: float = 2e-4  # of the rate, 36 poles
    acceleration_deg_s2: float = 20.0  # at every change of the rate
    phase_deg: float = 0.0  # where a cycle starts


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """One cycle at 1 kHz; arrays are at the middles of the steps, `angle` at their ends."""

    axis: int
    c_nb_start: Floats
    angle: Floats  # of the platform, rad, shape (n + 1)
    omega_ib: Floats  # rad/s, shape (n, 3), in b
    omega_eb: Floats  # the same less the earth's rate
    alpha_eb: Floats  # its derivative, rad/s²
    gravity_b: Floats  # specific force on the axis, m/s², in b


def commanded_rate(
    programme: Sequence[tuple[float, float]], t: Floats, acceleration: float
) -> Floats:
    """Return the rate at times t of a list of (rate °/s, duration s), reached at a finite pace."""
    at, rates, now, begin = [0.0], [0.0], 0.0, 0.0
    for rate, duration in programme:
        at += [begin + 1e-9, begin + 1e-9 + abs(rate - now) / acceleration]
        rates += [now, rate]
        now, begin = rate, begin + duration
    return np.interp(t, at, rates)


def axis_angles(rig: Rig) -> tuple[Floats, Floats]:
    """Return the rotation axis and the upward direction across it, both in n."""
    azimuth, tilt = np.deg2rad(rig.azimuth_deg), np.deg2rad(rig.tilt_arcmin / 60)
    level = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.cos(tilt) * level + np.sin(tilt) * up, np.cos(tilt) * up - np.sin(tilt) * level


def attitude_at_zero(rig: Rig, axis: int) -> Floats:
    """Return c_nb of a perfectly mounted SINS at platform angle 0."""
    along, upward = axis_angles(rig)
    c_nb = np.empty((3, 3))
    c_nb[:, axis], c_nb[:, (axis + 2) % 3] = along, upward
    c_nb[:, (axis + 1) % 3] = np.cross(upward, along)
    return c_nb


def move(rig: Rig, axis: int, programme: Sequence[tuple[float, float]], mount: Floats) -> Motion:
    """Turn a SINS through one cycle.

    `mount` is the rotation vector (rad, instrument axes) by which the SINS stands turned on the
    platform: the rotation axis in b is e − mount × e to first order.
    """
    n = round(sum(duration for _, duration in programme) / STEP_S)
    t = STEP_S * np.arange(n + 1)
    rate = np.deg2rad(commanded_rate(programme, t, rig.acceleration_deg_s2))
    turned = np.concatenate([[0.0], np.cumsum(0.5 * STEP_S * (rate[1:] + rate[:-1]))])
    rate = rate * (1 + rig.ripple * np.sin(36 * turned))
    steps = 0.5 * STEP_S * (rate[1:] + rate[:-1])
    angle = np.deg2rad(rig.phase_deg) + np.concatenate([[0.0], np.cumsum(steps)])
    c_mount = rotation(mount)
    along_b = c_mount.T @ np.eye(3)[axis]
    along, _ = axis_angles(rig)
    start = rotation(along * angle[0]) @ attitude_at_zero(rig, axis) @ c_mount
    ends = integrate(steps[:, None] * along_b)
    middles = quat_product(ends[:-1], quat_of(0.5 * steps[:, None] * along_b))
    c_nb = start @ matrix_of(middles)
    middle_rate = steps / STEP_S
    wobble, wobble_rate = _wobble(rig, 0.5 * (angle[1:] + angle[:-1]), middle_rate)
    c_nb = np.einsum("nij,njk->nik", np.eye(3) + wobble, c_nb)
    omega_eb = middle_rate[:, None] * along_b + np.einsum("nji,nj->ni", c_nb, wobble_rate)
    latitude = np.deg2rad(rig.latitude_deg)
    earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    gravity = np.array([0.0, 0.0, normal_gravity(latitude, rig.height_m)])
    return Motion(
        axis=axis,
        c_nb_start=start,
        angle=angle,
        omega_ib=omega_eb + np.einsum("nji,j->ni", c_nb, earth),
        omega_eb=omega_eb,
        alpha_eb=np.gradient(omega_eb, STEP_S, axis=0),
        gravity_b=np.einsum("nji,j->ni", c_nb, gravity),
    )


def _wobble(rig: Rig, angle: Floats, rate: Floats) -> tuple[Floats, Floats]:
    """Return the bearing's small turns (as v ×, in n) and their rates."""
    along, upward = axis_angles(rig)
    across = np.cross(upward, along)
    size = np.deg2rad(rig.wobble_arcsec / 3600)
    v = size * (np.sin(2 * angle)[:, None] * upward + (np.cos(2 * angle)[:, None] - 1) * across)
    dv = (
        2
        * size
        * rate[:, None]
        * (np.cos(2 * angle)[:, None] * upward - np.sin(2 * angle)[:, None] * across)
    )
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), (0, 1), (-2, -1)), dv
