"""Covariance analysis: shares of the sources, what it must not depend on, and the real filter."""

import numpy as np
import pytest

from sinscal.article.tables import NOISE
from sinscal.calibration.rig import calibrate
from sinscal.filter.data import RigNoise
from sinscal.library import BASIC
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.priors import make_prior
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.planning.budget import error_budget
from sinscal.planning.covariance import RigCovariance, rig_covariance
from sinscal.twin.motion import rig_motion
from sinscal.twin.programme import Programme, there_and_back
from sinscal.twin.simulate import SensorNoise, self_heating, simulate_rig

SHORT = there_and_back((10.0, -10.0), 120.0)
DRIFTING = RigNoise(
    gyro=NOISE.gyro, accel=NOISE.accel, angle=NOISE.angle, gyro_instability=1e-8,
    accel_instability=1e-5, instability_tau_s=600.0,
)  # fmt: skip


def sensors_of(*, angle: bool) -> SensorModel:
    return sensor_model((*BASIC, TIME_OFFSET) if angle else BASIC)


def found(
    *, angle: bool, noise: RigNoise = NOISE, programme: Programme = SHORT, **rest: float
) -> RigCovariance:
    sensors = sensors_of(angle=angle)
    return rig_covariance(programme, sensors, make_prior(sensors), noise, angle=angle, **rest)


@pytest.mark.parametrize("angle", [False, True])
def test_the_shares_of_all_sources_add_up(angle: bool) -> None:
    one = found(angle=angle, noise=DRIFTING)
    shares = error_budget(one)
    total = np.sum([*shares.values()], axis=0)
    np.testing.assert_allclose(total, np.diag(one.cov), rtol=1e-6)  # rounding over 360 steps
    assert all(np.all(part >= 0.0) for part in shares.values())
    noises = {"accelerometer noise", "gyro noise", "gyro drift", "accelerometer drift"}
    assert noises <= set(shares)
    assert {f"prior: {group}" for group in BASIC} <= set(shares)
    assert ("rig angle noise" in shares) == angle


def test_priors_correlated_across_groups_have_a_share_of_their_own() -> None:
    sensors = sensors_of(angle=False)
    prior = make_prior(sensors)
    cov = np.array(prior.cov)
    i, j = sensors.names.index("accel_bias_x"), sensors.names.index("accel_scale_x")
    cov[i, j] = cov[j, i] = 0.9 * np.sqrt(cov[i, i] * cov[j, j])
    joined = type(prior)(values=prior.values, cov=cov)
    one = rig_covariance(SHORT, sensors, joined, NOISE, angle=False)
    shares = error_budget(one)
    assert "correlation of priors" in shares
    np.testing.assert_allclose(np.sum([*shares.values()], axis=0), np.diag(one.cov), rtol=1e-6)


def test_more_knowledge_never_makes_a_sigma_larger() -> None:
    plain = found(angle=False).sigmas
    for better in (
        found(angle=False, azimuth_sigma_rad=1e-3).sigmas,
        found(angle=False, carry=True).sigmas,
        found(angle=True).sigmas[: plain.size],
    ):
        assert np.all(better <= plain * (1.0 + 1e-9))


def test_it_is_what_the_calibration_itself_states() -> None:
    """The calibration's own covariance of a simulated run: apart by the errors times themselves."""
    sensors = sensors_of(angle=False)
    noise = SensorNoise(gyro=NOISE.gyro, accel=NOISE.accel)
    true = rig_motion(SHORT, 50.0)
    rng = np.random.default_rng(1)
    run = simulate_rig(true, sensors, {"gyro_scale_x": 5e-4, "accel_bias_z": 0.01}, noise, rng)
    done = calibrate(run, "coarse")
    foreseen = found(angle=False, azimuth_sigma_rad=run.facts.azimuth_sigma_rad)
    assert done.names == foreseen.names
    np.testing.assert_allclose(done.sigmas, foreseen.sigmas, rtol=0.02)


def test_terms_of_temperature_are_estimated_when_the_run_has_temperatures() -> None:
    sensors = sensor_model((*BASIC, "accel_temperature_bias"))
    prior = make_prior(sensors)
    one = rig_covariance(
        SHORT, sensors, prior, NOISE, angle=False, warming=self_heating(tau_s=100.0)
    )
    name = "accel_temperature_bias_x"
    assert one.sigma(name) < one.prior_sigmas[one.names.index(name)]


def test_a_fast_programme_is_stepped_finely() -> None:
    """At 90 °/s five times finer steps change no digit that is told."""
    fast = there_and_back((90.0, -90.0), 30.0)
    usual = found(angle=True, programme=fast).sigmas
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sinscal.planning.covariance.STEP_DEG", 0.1)
        finer = found(angle=True, programme=fast).sigmas
    np.testing.assert_allclose(usual, finer, rtol=5e-4)
