"""The earth: its shape, its rotation and its gravity, in local east-north-up axes.

References
----------
NIMA TR8350.2 (2000), Department of Defense World Geodetic System 1984, tables 3.1 and 3.4 and
eq. 4-1 (Somigliana) with the height series of eq. 4-3.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.constants import STANDARD_GRAVITY_M_S2

A_M = 6378137.0  # semi-major axis
FLATTENING = 1.0 / 298.257223563
E2 = FLATTENING * (2.0 - FLATTENING)  # first eccentricity squared
RATE_RAD_S = 7.292115e-5
GAMMA_E_M_S2 = 9.7803253359  # normal gravity on the equator
SOMIGLIANA_K = 0.00193185265241
M_RATIO = 0.00344978650684  # ω²a²b/GM

STANDARD_G = STANDARD_GRAVITY_M_S2  # m/s², what a g stands for in units
DEG_PER_H = np.pi / 180.0 / 3600.0  # rad/s
ARCMIN = np.pi / 180.0 / 60.0  # rad
ARCSEC = ARCMIN / 60.0  # rad


def radii_m(lat_rad: float) -> tuple[float, float]:
    """Return the radii of curvature (meridian, prime vertical), m."""
    w2 = 1.0 - E2 * np.sin(lat_rad) ** 2
    return float(A_M * (1.0 - E2) / w2**1.5), float(A_M / np.sqrt(w2))


def gravity_m_s2(lat_rad: float, height_m: float) -> float:
    """Return normal gravity, m/s²: the magnitude of the specific force of a body at rest."""
    s2 = np.sin(lat_rad) ** 2
    surface = GAMMA_E_M_S2 * (1.0 + SOMIGLIANA_K * s2) / np.sqrt(1.0 - E2 * s2)
    h = height_m / A_M
    lapse = 1.0 - 2.0 * h * (1.0 + FLATTENING + M_RATIO - 2.0 * FLATTENING * s2) + 3.0 * h * h
    return float(surface * lapse)


def earth_rate_enu(lat_rad: float) -> FloatArray:
    """Return the earth's rotation in east-north-up axes, rad/s, shape (3,)."""
    return RATE_RAD_S * np.array([0.0, np.cos(lat_rad), np.sin(lat_rad)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Site of a rig: geodetic latitude, rad, and height above the ellipsoid, m."""

    lat_rad: float
    height_m: float = 0.0

    @property
    def gravity_m_s2(self) -> float:
        """Gravity, m/s²."""
        return gravity_m_s2(self.lat_rad, self.height_m)

    @property
    def earth_rate(self) -> FloatArray:
        """The earth's rotation in east-north-up axes, rad/s, shape (3,)."""
        return earth_rate_enu(self.lat_rad)
