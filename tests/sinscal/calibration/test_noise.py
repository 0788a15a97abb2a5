"""White noise from a run's own readings, on a turntable with ripple and changes of rate."""

from pathlib import Path

import numpy as np

from benchmarks.blind.rig.setup import ARCSEC, DEG_H, Setup, multirate
from benchmarks.blind.rig.truth import write_rig_run
from sinscal.calibration.noise import Density, accel_density, angle_density, gyro_density
from sinscal.recording.files import read_rig_run

SETUP = Setup(programme=tuple(multirate(3.0)), period_s=0.05, angles=True)


def test_densities_are_found_beside_the_motion(tmp_path: Path) -> None:
    truth = {
        gyro_density: SETUP.gyro_noise_deg_h * DEG_H,
        accel_density: SETUP.accel_noise,
        angle_density: SETUP.angle_noise_arcsec * ARCSEC,
    }
    found: dict[object, list[Density]] = {measure: [] for measure in truth}
    for seed in range(4):
        write_rig_run(tmp_path / "run.csv", seed=seed, setup=SETUP)
        run = read_rig_run(tmp_path / "run.csv")
        for measure in truth:
            found[measure].append(measure(run))
    for measure, true in truth.items():
        # all of one sigma: their mean is known to half of it
        mean = np.mean([one.value for one in found[measure]])
        assert abs(mean - true) < 4.0 * found[measure][0].sigma / 2.0, measure
