"""The source article's figures for calibration and flight.

References
----------
The article on calibration of a SINS on coarse and precise rigs of the control and navigation
laboratory of Moscow State University: tables 1 and 2, and the flight of one hour after them.
"""

import numpy as np

from sinscal.frames.earth import ARCMIN, DEG_PER_H
from sinscal.library import rig_library
from sinscal.model.residual_errors import Calibration
from sinscal.model.sensors import sensor_model

COARSE_M, PRECISE_M = 1900.0, 1100.0  # ρ after an hour of flight
GYRO_NOISE = 0.1 * DEG_PER_H  # rad/s/√Hz, "0.1 °/h at 1 Hz"
ACCEL_NOISE = 0.001  # m/s²/√Hz

# sigmas of each parameter by its group, SI: table 1 (coarse rig), table 2 (precise rig)
_COARSE = {
    "gyro_bias": 0.01 * DEG_PER_H,
    "gyro_scale": 5.1e-7,
    "gyro_misalignment": 0.1 * ARCMIN,
    "accel_bias": 9e-5,
    "accel_scale": 1.36e-5,
    "accel_misalignment": 0.1 * ARCMIN,
}
_PRECISE = {
    "gyro_bias": 0.003 * DEG_PER_H,
    "gyro_scale": 9.7e-8,
    "gyro_misalignment": 0.05 * ARCMIN,
    "accel_bias": 7.7e-5,
    "accel_scale": 1.36e-5,
    "accel_misalignment": 0.05 * ARCMIN,
}


def published_calibrations() -> tuple[Calibration, Calibration]:
    """Return the article's coarse and precise calibration: its sigmas, taken as uncorrelated.

    The article prints no correlations, so these are not the covariances it flew with.
    """
    names = sensor_model().names
    coarse, precise = (
        Calibration(
            names=names,
            cov=np.diag([sigmas[rig_library().parameter(name).family] ** 2 for name in names]),
        )
        for sigmas in (_COARSE, _PRECISE)
    )
    return coarse, precise
