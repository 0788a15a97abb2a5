"""Without noise the rig filter leaves nothing: what it left would be a bias in every calibration.

Readings that are exact, a filter that expects noise: each estimate must then stand at the truth,
to a small part of its sigma.
"""

from dataclasses import replace

import numpy as np
import pytest

from sinscal.calibration.rig import calibrate
from sinscal.filter.data import cycle_data
from sinscal.filter.integrate import attitudes, mean_forces
from sinscal.library import BASIC
from sinscal.model.sensors import sensor_model
from sinscal.twin.motion import rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig
from tests.sinscal.twin import NOISE

EXACT = 0.02  # of a sigma: its square is nothing in a χ²
# about the rates of gyros with 3′ of misalignment and 1e-3 of scale error, bias and so on
SIZES = {
    "gyro_misalignment": 9e-4,
    "gyro_scale": 1e-3,
    "gyro_bias": 2e-6,
    "accel_misalignment": 9e-4,
    **{f"lever_arm_{a}": 0.05 for a in "xyz"},
}


def exact_run(
    hz: float = 50.0,
    cycle_s: float = 300.0,
    acceleration_deg_s2: float = 20.0,
    more: tuple[str, ...] = (),
):
    programme = there_and_back(
        (10.0, -10.0), cycle_s, "xyz", acceleration_deg_s2=acceleration_deg_s2, azimuth_deg=30.0
    )
    true = rig_motion(programme, hz)
    sensors = sensor_model((*BASIC, *more), gravity_m_s2=true.site.gravity_m_s2)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(sensors.names))
    values = {
        n: s * SIZES.get(n.rpartition("_")[0], 1e-3)
        for n, s in zip(sensors.names, signs, strict=True)
    }
    run = simulate_rig(true, sensors, values, SensorNoise(), np.random.default_rng(2))
    facts = replace(run.facts, gyro_noise=NOISE.gyro, accel_noise=NOISE.accel)
    return true, replace(run, facts=facts), values


@pytest.mark.parametrize("azimuth", [True, False], ids=["azimuth given", "north found"])
def test_a_calibration_of_exact_readings_is_exact(azimuth: bool) -> None:
    """Misaligned gyros must not turn the axis of one cycle against another's, azimuth given."""
    _, run, values = exact_run()
    run = run if azimuth else replace(run, facts=replace(run.facts, azimuth_rad=None))
    found = calibrate(run)
    errors = found.values - np.array([values[n] for n in found.names])
    # the prior pulls by the truth's distance from its mean, over the sigma by which data know more
    pull = found.cov @ np.linalg.solve(found.prior.cov, -np.array([values[n] for n in found.names]))
    assert np.max(np.abs(errors - pull) / found.sigmas) < EXACT


@pytest.mark.parametrize("cycle_s", [300.0, 300.01], ids=["between steps", "within a step"])
def test_a_rate_that_jumps_does_not_move_lever_arms(cycle_s: float) -> None:
    """Turned round within 0.2 ms: the blow of masses off the axis went into the wrong interval."""
    _, run, values = exact_run(100.0, cycle_s, 1e5, ("lever_arm",))
    sensors = sensor_model((*BASIC, "lever_arm"), gravity_m_s2=run.facts.site.gravity_m_s2)
    found = calibrate(run, sensors=sensors)
    errors = found.values - np.array([values[n] for n in found.names])
    pull = found.cov @ np.linalg.solve(found.prior.cov, -np.array([values[n] for n in found.names]))
    assert np.max(np.abs(errors - pull) / found.sigmas) < EXACT


def test_a_reversal_leaves_no_force() -> None:
    """10 °/s turned round at 20 °/s², 50 Hz: half steps leave 1.1e-4 m/s², mean ones a percent."""
    true, run, _ = exact_run(cycle_s=60.0)
    for cycle, data in zip(true.cycles, cycle_data(run, 1.0), strict=True):
        m = cycle.motion
        mean, _ = attitudes(
            np.array(m.w), np.array(m.step_s), np.array(cycle.c_start), true.site.earth_rate
        )
        force = mean_forces(mean, m.w, m.f, m.step_s, data.good, data.first, true.site.gravity_m_s2)
        assert np.max(np.abs(force)) < 2e-6
