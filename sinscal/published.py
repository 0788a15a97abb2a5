"""The source article's figures for calibration and flight.

References
----------
The article on calibration of a SINS on coarse and precise rigs of the control and navigation
laboratory of Moscow State University: tables 1 and 2, and the flight of one hour after them.
"""

import numpy as np

from sinscal.earth import ARCMIN, DEG_PER_H
from sinscal.residual_errors import GROUPS, Calibration

COARSE_M, PRECISE_M = 1900.0, 1100.0  # ρ after an hour of flight
GYRO_NOISE = 0.1 * DEG_PER_H  # rad/s/√Hz, "0.1 °/h at 1 Hz"
ACCEL_NOISE = 0.001  # m/s²/√Hz

# sigmas of each parameter by its group, SI: table 1 (coarse rig), table 2 (precise rig)
_COARSE = {
    "gyro bias": 0.01 * DEG_PER_H,
    "gyro scale": 5.1e-7,
    "gyro misalignment": 0.1 * ARCMIN,
    "accelerometer bias": 9e-5,
    "accelerometer scale": 1.36e-5,
    "accelerometer misalignment": 0.1 * ARCMIN,
}
_PRECISE = {
    "gyro bias": 0.003 * DEG_PER_H,
    "gyro scale": 9.7e-8,
    "gyro misalignment": 0.05 * ARCMIN,
    "accelerometer bias": 7.7e-5,
    "accelerometer scale": 1.36e-5,
    "accelerometer misalignment": 0.05 * ARCMIN,
}
UPPER = ("accel_misalignment_xy", "accel_misalignment_xz", "accel_misalignment_yz")  # zero: Γ is lower


def published_calibrations() -> tuple[Calibration, Calibration]:
    """Return the article's coarse and precise calibration: its sigmas, taken as uncorrelated.

    The article prints no correlations, so these are not the covariances it flew with.
    """
    names = tuple(n for group in _COARSE for n in GROUPS[group] if n not in UPPER)
    coarse, precise = (
        Calibration(names=names, cov=np.diag([_sigma(table, n) ** 2 for n in names]))
        for table in (_COARSE, _PRECISE)
    )
    return coarse, precise


def _sigma(table: dict[str, float], name: str) -> float:
    return next(sigma for group, sigma in table.items() if name in GROUPS[group])
