"""The linear equations of a navigator's errors, in local east-north-up axes.

The state is

    φ (3)        attitude error, rad: C_true = exp(φ×)·C_computed
    δv (3)       computed less true velocity, m/s
    δlat, δlon   computed less true latitude and longitude, rad
    δh           computed less true height, m

and it follows d(state)/dt = F·state + (−C_nb·δω, C_nb·δf, 0), where δω and δf are measured less
true rate and specific force in body axes. With a held height the vertical velocity and the height
have no error: their rows and columns of F are zero.

References
----------
Titterton, D. H. and Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed., ch. 12: the
same equations, with north-east-down axes. Those here are derived in docs/explanation/flight.md.
"""

import numba
import numpy as np

from errormodel.arrays import FloatArray
from sinscal.flight.strapdown import compiled_gravity_m_s2, compiled_radii_m, local_rates
from sinscal.frames.earth import A_M, E2, RATE_RAD_S
from sinscal.frames.quaternions import Vector, plus, times

PHI, DV, DP = slice(0, 3), slice(3, 6), slice(6, 9)
DV_UP, DLAT, DLON, DH = 5, 6, 7, 8
N_STATES = 9


@numba.njit(cache=True)
def navigation_dynamics(lat: float, v: FloatArray, f_n: FloatArray, height: float) -> FloatArray:
    """Return F, shape (9, 9), of a free vertical channel.

    Parameters
    ----------
    lat : float
        Latitude, rad.
    v : ndarray, shape (3,)
        Velocity east, north, up, m/s.
    f_n : ndarray, shape (3,)
        Specific force in east-north-up, m/s².
    height : float
        m.
    """
    m, n = compiled_radii_m(lat)
    s, c = np.sin(lat), np.cos(lat)
    t = s / c
    w2 = 1.0 - E2 * s * s
    dm = 3.0 * A_M * (1.0 - E2) * E2 * s * c / w2**2.5  # how the radii change with latitude
    dn = A_M * E2 * s * c / w2**1.5
    r_m, r_n = m + height, n + height
    earth, craft = local_rates(lat, (v[0], v[1], v[2]), r_m, r_n)

    # how the two rates change with velocity, latitude and height
    by_v = np.zeros((3, 3))
    by_v[0, 1], by_v[1, 0], by_v[2, 0] = -1.0 / r_m, 1.0 / r_n, t / r_n
    craft_by_lat = np.array(
        [v[1] * dm / r_m**2, -v[0] * dn / r_n**2, v[0] * (1.0 / c**2 - t * dn / r_n) / r_n]
    )
    craft_by_h = np.array([v[1] / r_m**2, -v[0] / r_n**2, -v[0] * t / r_n**2])
    earth_by_lat = RATE_RAD_S * np.array([0.0, -s, c])

    across = _cross_matrix((v[0], v[1], v[2]))
    f = np.zeros((9, 9))
    f[:3, :3] = -_cross_matrix(plus(earth, craft))
    f[:3, 3:6] = by_v
    f[:3, 6] = earth_by_lat + craft_by_lat
    f[:3, 8] = craft_by_h
    f[3:6, :3] = _cross_matrix((f_n[0], f_n[1], f_n[2]))
    f[3:6, 3:6] = across @ by_v - _cross_matrix(plus(times(2.0, earth), craft))
    f[3:6, 6] = across @ (2.0 * earth_by_lat + craft_by_lat)
    f[3:6, 8] = across @ craft_by_h
    # gravity is a square in the height and nearly straight over 2e-3 rad of latitude
    f[5, 6] -= 500.0 * (
        compiled_gravity_m_s2(lat + 1e-3, height) - compiled_gravity_m_s2(lat - 1e-3, height)
    )
    f[5, 8] -= 5e-3 * (
        compiled_gravity_m_s2(lat, height + 100.0) - compiled_gravity_m_s2(lat, height - 100.0)
    )
    f[6, 4], f[6, 6], f[6, 8] = 1.0 / r_m, -v[1] * dm / r_m**2, -v[1] / r_m**2
    f[7, 3] = 1.0 / (r_n * c)
    f[7, 6], f[7, 8] = v[0] * (t - dn / r_n) / (r_n * c), -v[0] / (r_n**2 * c)
    f[8, 5] = 1.0
    return f


@numba.njit(cache=True)
def hold_height(f: FloatArray) -> None:
    """Take the vertical channel out of F, in place."""
    for k in (5, 8):
        f[k, :] = 0.0
        f[:, k] = 0.0


@numba.njit(cache=True)
def _cross_matrix(a: Vector) -> FloatArray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
