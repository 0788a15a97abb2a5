"""The simulator's noise, quanta, clock and temperature are what was asked for."""

import allantools
import numpy as np
import pytest

from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.library import BASIC
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigRun
from sinscal.twin.motion import Harmonic, RigFaults, RigMotion, rig_motion
from sinscal.twin.programme import angle_law, there_and_back
from sinscal.twin.simulate import SensorNoise, self_heating, simulate_rig

SENSORS = sensor_model()
RATE_HZ = 50.0


def motion(seconds: float = 60.0) -> RigMotion:
    return rig_motion(
        there_and_back((10.0, -10.0), seconds, axes=("x", "z"), acceleration_deg_s2=20.0), RATE_HZ
    )


def simulated(true: RigMotion, noise: SensorNoise | None = None, **rest: object) -> RigRun:
    rng = np.random.default_rng(5)
    return simulate_rig(true, SENSORS, {}, noise or SensorNoise(), rng, **rest)  # type: ignore[arg-type]


def of_gyro(true: RigMotion) -> np.ndarray:
    return np.concatenate([c.motion.w for c in true.cycles])


def test_errors_are_those_of_the_sensors() -> None:
    true = motion()
    values = {"gyro_scale_x": 1e-3, "gyro_misalignment_yx": 2e-3, "accel_bias_z": 0.1}
    rng = np.random.default_rng(0)
    run = simulate_rig(true, SENSORS, values, SensorNoise(), rng)
    w, f = of_gyro(true), np.concatenate([c.motion.f for c in true.cycles])
    np.testing.assert_allclose(run.gyro[:, 0], 1.001 * w[:, 0], rtol=1e-13)
    np.testing.assert_allclose(run.gyro[:, 1], w[:, 1] + 2e-3 * w[:, 0], atol=1e-15)
    np.testing.assert_allclose(run.accel - f, np.tile([0, 0, 0.1], (len(run), 1)), atol=1e-12)


def test_allan_deviation_at_one_second_is_the_density() -> None:
    true = motion(600.0)
    noise = SensorNoise(gyro=0.1 * DEG_PER_H, accel=1e-3)
    run = simulated(true, noise)
    rows = run.cycles[0]
    left = run.gyro[rows, 0] - of_gyro(true)[rows, 0]
    taus, found, _, n = allantools.oadev(left, rate=RATE_HZ, data_type="freq", taus=[1.0, 10.0])
    # 600 s hold 600/τ independent means: a sigma is known to about 1/√(2·600/τ); four of these
    for tau, value in zip(taus, found, strict=True):
        assert value * np.sqrt(tau) == pytest.approx(noise.gyro, rel=4 / np.sqrt(1200 / tau))
    assert n[0] > 100


def test_instability_has_its_sigma_and_goes_on_from_cycle_to_cycle() -> None:
    tau_s, sigma = 1.0, 1e-6
    true = motion(2000.0)
    run = simulated(true, SensorNoise(gyro_instability=sigma, instability_tau_s=tau_s))
    left = run.gyro - of_gyro(true)
    # 4000 s of 2τ each give 2000 independent values an axis: 1.6 % of a sigma; four of these
    np.testing.assert_allclose(np.std(left, axis=0), sigma, rtol=0.065)
    lagged = np.mean(left[50:] * left[:-50]) / np.mean(left**2)
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.1)
    first = run.cycles[1].start
    step = 1.0 / RATE_HZ
    kick = sigma * np.sqrt(1.0 - np.exp(-2.0 * step / tau_s))
    assert np.all(np.abs(left[first] - left[first - 1]) < 5.0 * kick)


def test_quanta_keep_the_sum() -> None:
    true = motion()
    quantum = 1.0 * ARCSEC
    plain, cut = simulated(true), simulated(true, SensorNoise(gyro_quantum=quantum))
    for rows in cut.cycles:
        counts = cut.gyro[rows] / RATE_HZ / quantum
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
        apart = np.cumsum(cut.gyro[rows] - plain.gyro[rows], axis=0) / RATE_HZ
        assert np.all(apart > -quantum * (1 + 1e-6))
        assert np.all(apart < 1e-6 * quantum)
    assert np.any(cut.gyro != plain.gyro)


@pytest.mark.parametrize("offset_s", [0.05, -0.05])
def test_the_row_of_time_t_holds_the_angle_of_t_plus_offset(offset_s: float) -> None:
    true = motion()
    run = simulated(true, faults=RigFaults(clock_offset_s=offset_s), with_angle=True)
    programme = there_and_back((10.0, -10.0), 60.0, axes=("x",), acceleration_deg_s2=20.0)
    law = angle_law(programme.cycles[0], 20.0)
    rows = run.cycles[0]
    assert run.rig_angle_rad is not None
    expected = law.at(run.time_s[rows] + offset_s)[0]
    np.testing.assert_allclose(run.rig_angle_rad[rows], expected, atol=1e-13)
    turning = np.argmin(np.abs(run.time_s[rows] - 10.0))
    ahead = run.rig_angle_rad[rows][turning] - true.cycles[0].angle[turning]
    assert ahead == pytest.approx(offset_s * np.deg2rad(10.0), rel=1e-9)


def test_harmonics_are_added_to_the_angle() -> None:
    true = motion()
    wrong = RigFaults(harmonics=(Harmonic(order=2, sine=1e-4, cosine=-2e-4),))
    run = simulated(true, faults=wrong, with_angle=True)
    angle = np.concatenate([c.angle for c in true.cycles])
    assert run.rig_angle_rad is not None
    error = 1e-4 * np.sin(2 * angle) - 2e-4 * np.cos(2 * angle)
    np.testing.assert_allclose(run.rig_angle_rad - angle, error, atol=1e-14)


def test_a_warming_sins_drifts_as_its_terms_say() -> None:
    true = motion()
    sensors = sensor_model((*BASIC, "accel_temperature_bias"))
    warming = self_heating(20.0, (30.0, 20.0, 10.0), 50.0)
    rng = np.random.default_rng(0)
    values = {"accel_temperature_bias_y": 1e-3}
    run = simulate_rig(true, sensors, values, SensorNoise(), rng, warming=warming)
    assert run.temp_c is not None
    np.testing.assert_allclose(run.temp_c, warming(run.time_s), rtol=1e-12)
    f = np.concatenate([c.motion.f for c in true.cycles])
    np.testing.assert_allclose(
        run.accel[:, 1] - f[:, 1], 1e-3 * (run.temp_c[:, 1] - sensors.t_ref_c), atol=1e-13
    )
