"""The azimuth of the rotation axis as known beforehand, while gyros are misaligned."""

from dataclasses import replace

import numpy as np
import pytest

from sinscal.calibration.rig import RigCalibration, calibrate
from sinscal.filter.alignment import found_azimuth
from sinscal.filter.data import cycle_data
from sinscal.frames.earth import ARCMIN
from sinscal.library import BASIC
from sinscal.model.sensors import as_vector, sensor_model
from sinscal.recording.run import RigRun
from sinscal.twin.motion import RigMotion, rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig
from tests.sinscal.twin import NOISE, SIX_RATES

SENSORS = sensor_model((*BASIC, "gyro_g_sensitivity"))
MISALIGNED = {
    "gyro_misalignment_xz": 3 * ARCMIN,
    "gyro_misalignment_yx": -3 * ARCMIN,
    "gyro_misalignment_zy": 2 * ARCMIN,
}


def noiseless(cycle_s: float = 240.0) -> tuple[RigMotion, RigRun]:
    """Return what misaligned gyros read without noise, told as if a tenth of the usual one."""
    programme = there_and_back(SIX_RATES, cycle_s, acceleration_deg_s2=10.0, azimuth_deg=35.0)
    true = rig_motion(programme, 200.0)
    run = simulate_rig(true, SENSORS, MISALIGNED, SensorNoise(), np.random.default_rng(0))
    told = replace(run.facts, gyro_noise=0.1 * NOISE.gyro, accel_noise=0.1 * NOISE.accel)
    return true, replace(run, facts=told)


def pull_chi2(found: RigCalibration, truth: np.ndarray) -> float:
    """Return χ² of the errors less what the prior alone pulls the estimates by."""
    scale = found.sigmas
    pull = found.cov @ ((found.prior.values - truth) / np.diag(found.prior.cov))
    left = (found.values - truth - pull) / scale
    return float(left @ np.linalg.solve(found.cov / np.outer(scale, scale), left))


def test_without_noise_only_the_prior_moves_the_estimates() -> None:
    _, run = noiseless()
    found = calibrate(run, sensors=SENSORS)
    # Readings of 5 ms leave 0.01 at the reversals (256 times as much at 20 ms). A rotation axis
    # taken from gyros not yet calibrated makes the cycles contradict one another, and this 28.
    assert pull_chi2(found, as_vector(SENSORS, MISALIGNED)) < 0.1


def test_the_axis_is_where_it_is_and_moves_with_the_gyros() -> None:
    true, run = noiseless(60.0)
    values = as_vector(SENSORS, MISALIGNED)
    cycle, start = cycle_data(run, 1.0)[1], true.cycles[1].c_start
    here, slope = found_azimuth(cycle, SENSORS, values, start)
    # the earth turns by 15 °/h while the rig does by 6 to 20 °/s, to and fro
    assert np.rad2deg(here) == pytest.approx(35.0, abs=0.02)
    for name in ("gyro_misalignment_xy", "gyro_misalignment_zy", "gyro_scale_y"):
        step = 1e-4 * (np.array(SENSORS.names) == name)
        moved = found_azimuth(cycle, SENSORS, values + step, start)[0] - here
        # of 1e-4 the square is 1e-8
        assert moved == pytest.approx(float(slope @ step), abs=3e-7)
