"""Vectors and quaternions as tuples: numba keeps them in registers, arrays it would allocate."""

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from errormodel.arrays import FloatArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # scalar first


def vector_of(v: FloatArray) -> Vector:
    """Return an array of three as a vector."""
    return float(v[0]), float(v[1]), float(v[2])


def quaternion_of(c: FloatArray) -> Quaternion:
    """Return the quaternion of a rotation matrix, shape (3, 3)."""
    w, x, y, z = Rotation.from_matrix(c).as_quat(scalar_first=True).tolist()
    return w, x, y, z


@numba.njit(cache=True)
def row_of(a: FloatArray, k: int) -> Vector:
    """Return row k of an array (n, 3)."""
    return a[k, 0], a[k, 1], a[k, 2]


@numba.njit(cache=True)
def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@numba.njit(cache=True)
def times(k: float, a: Vector) -> Vector:
    """Return k·a."""
    return k * a[0], k * a[1], k * a[2]


@numba.njit(cache=True)
def dot(a: Vector, b: Vector) -> float:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@numba.njit(cache=True)
def unit_quaternion(v: Vector) -> Quaternion:
    """Return the quaternion (scalar first) of a rotation vector."""
    angle2 = dot(v, v)
    if angle2 < 1e-8:
        whole = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
        part = 0.5 - angle2 / 48.0
    else:
        angle = np.sqrt(angle2)
        whole, part = np.cos(0.5 * angle), np.sin(0.5 * angle) / angle
    return whole, part * v[0], part * v[1], part * v[2]


@numba.njit(cache=True)
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion product: b's rotation, then a's."""
    u, v = (a[1], a[2], a[3]), (b[1], b[2], b[3])
    x, y, z = plus(plus(times(a[0], v), times(b[0], u)), cross(u, v))
    return a[0] * b[0] - dot(u, v), x, y, z


@numba.njit(cache=True)
def turned(q: Quaternion, a: Vector) -> Vector:
    """Return a vector turned by a unit quaternion."""
    u = (q[1], q[2], q[3])
    once = times(2.0, cross(u, a))
    return plus(a, plus(times(q[0], once), cross(u, once)))


@numba.njit(cache=True)
def normalised(q: Quaternion) -> Quaternion:
    """Return a quaternion of length one."""
    k = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return k * q[0], k * q[1], k * q[2], k * q[3]


@numba.njit(cache=True)
def write_matrix(q: Quaternion, out: FloatArray) -> None:
    """Write the rotation matrix of a unit quaternion into `out`, shape (3, 3)."""
    w, x, y, z = q
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    out[0, 1], out[1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    out[0, 2], out[2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    out[1, 2], out[2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
