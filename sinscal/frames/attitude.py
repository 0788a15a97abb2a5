"""Rotations as arrays: small, exact, vectorised.

`c_nb` takes a vector from body to east-north-up axes. Roll, pitch and heading turn the
east-north-up axes to the body's by heading (about −up, from north clockwise), pitch (about the
body's x, nose up) and roll (about the body's y): with all three zero the body's x points east, y
north (ahead) and z up.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from errormodel.arrays import FloatArray


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices of v × …, shape (…, 3, 3)."""
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2] = -z, y
    out[..., 1, 0], out[..., 1, 2] = z, -x
    out[..., 2, 0], out[..., 2, 1] = -y, x
    return out


def rotation(rotvec: FloatArray) -> FloatArray:
    """Return exp(v ×) by Rodrigues' formula, shape (…, 3, 3)."""
    v = np.asarray(rotvec, dtype=float)
    angle2 = np.sum(v * v, axis=-1)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle2 < 1e-8
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    k = skew(v)
    return np.eye(3) + first * k + second * (k @ k)


def rotvec_of(c: FloatArray) -> FloatArray:
    """Return the rotation vector of matrices, shape (…, 3); its length is at most π."""
    c = np.asarray(c, dtype=float)
    flat = Rotation.from_matrix(c.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat, dtype=float).reshape(*c.shape[:-2], 3)


def left_jacobian(rotvec: FloatArray) -> FloatArray:
    """Return J with exp((φ + dφ)×) = exp((J·dφ)×)·exp(φ×) for small dφ, shape (3, 3).

    Parameters
    ----------
    rotvec : ndarray, shape (3,)
        φ, rad, of a turn at most.

    References
    ----------
    Barfoot, T. D. (2017), State Estimation for Robotics, equation 7.77: the series Σ (φ×)ᵏ/(k+1)!,
    here summed until nothing is added.
    """
    total = term = np.eye(3)
    for k in range(1, 40):
        term = term @ skew(rotvec) / (k + 1)
        total = total + term
    return total


def c_nb_from_angles(roll: FloatArray, pitch: FloatArray, heading: FloatArray) -> FloatArray:
    """Return C_nb of roll, pitch and heading, rad, shape (…, 3, 3)."""
    sr, cr = np.sin(roll), np.cos(roll)
    sp, cp = np.sin(pitch), np.cos(pitch)
    sh, ch = np.sin(heading), np.cos(heading)
    rows = [
        [cr * ch + sr * sp * sh, cp * sh, sr * ch - cr * sp * sh],
        [-cr * sh + sr * sp * ch, cp * ch, -sr * sh - cr * sp * ch],
        [-sr * cp, sp, cr * cp],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def angles_from_c_nb(c_nb: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return roll, pitch and heading of C_nb, rad; heading from 0 to 2π.

    Where the nose points straight up or down only roll and heading together are determined: roll
    is zero then.
    """
    level = np.hypot(c_nb[..., 2, 0], c_nb[..., 2, 2])
    pitch = np.arctan2(c_nb[..., 2, 1], level)
    upright = level < 1e-9  # rounding alone turns roll there
    roll = np.where(upright, 0.0, np.arctan2(-c_nb[..., 2, 0], c_nb[..., 2, 2]))
    east = np.where(upright, -c_nb[..., 1, 0], c_nb[..., 0, 1])
    north = np.where(upright, c_nb[..., 0, 0], c_nb[..., 1, 1])
    heading = np.mod(np.arctan2(east, north), 2.0 * np.pi)
    return roll, pitch, heading
