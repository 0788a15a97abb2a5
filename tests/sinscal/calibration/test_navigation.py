"""Calibration from navigation outputs, and the article's experiment on the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from errormodel.errors import InputError
from sinscal.article.experiment import GROUP_SIGMAS, NOISE, ArticleExperiment, navigation_experiment
from sinscal.calibration.nav_filter import NavFilter, NavNoise
from sinscal.calibration.nav_outputs import nav_cycle
from sinscal.calibration.navigation import NavCalibration, calibrate_navigation
from sinscal.library import rig_library
from sinscal.model.priors import PriorFile, make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import NavRun
from sinscal.twin.motion import rig_motion
from sinscal.twin.navigate import navigate_rig
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig

# 12-minute cycles at the experiment's rates: the same physics in a third of the time
SHORT = there_and_back((2.0, -2.0, 5.0, -5.0), 720.0, acceleration_deg_s2=10.0)
ARTICLE_SIGMAS = {group: rig_library().groups[group].prior_sigma for group in GROUP_SIGMAS}


def error_chi2(found: NavCalibration, true_values: np.ndarray) -> float:
    error = found.values - true_values
    return float(error @ np.linalg.solve(found.cov, error))


def squares(found: NavCalibration) -> np.ndarray:
    """Normalised innovations squared of the velocities, shape (n,)."""
    judged = list(found.judged)
    all_of_them = found.filtered.innovation[:, judged] ** 2 / found.filtered.variance[:, judged]
    return all_of_them[np.isfinite(all_of_them)]


def check_chi2(found: Sequence[tuple[NavCalibration, np.ndarray]]) -> None:
    assert all(one.converged for one, _ in found)
    total = sum(error_chi2(one, true) for one, true in found)
    assert 0.001 < chi2.sf(total, sum(true.size for _, true in found)) < 0.999


def check_many(done: Sequence[ArticleExperiment]) -> None:
    check_chi2([(d.calibration, d.true_values) for d in done])
    nis = np.concatenate([squares(d.calibration) for d in done])
    assert abs(float(np.mean(nis)) - 1.0) < 3.3 * np.sqrt(2.0 / nis.size)


def test_errors_are_those_of_the_covariance() -> None:
    check_many([navigation_experiment(seed, SHORT) for seed in range(4)])


@pytest.mark.slow
def test_errors_are_those_of_the_covariance_over_many_seeds() -> None:
    check_many([navigation_experiment(seed) for seed in range(50)])


def test_a_free_height_tells_more_and_its_errors_are_those_of_the_covariance() -> None:
    held = [navigation_experiment(seed) for seed in range(2)]
    free = [navigation_experiment(seed, height_held=False) for seed in range(2)]
    assert max(float(np.max(np.abs(d.first.height_m - 150.0))) for d in free) > 1e3
    check_many(free)
    # what a held height hides: a scale error common to the three accelerometers
    scale = held[0].calibration.names.index("accel_scale_x")
    sigmas = [d[0].calibration.sigmas[scale] for d in (held, free)]
    assert sigmas[1] < 0.01 * sigmas[0]


@pytest.mark.slow
def test_a_free_height_over_many_seeds() -> None:
    check_many([navigation_experiment(seed, height_held=False) for seed in range(50)])


def check_article_sigmas(seeds: range) -> None:
    """Check starting errors as large as the a priori sigmas of an uncalibrated SINS.

    They let the position run away by hundreds of kilometres.
    """
    done = [navigation_experiment(seed, sigmas=ARTICLE_SIGMAS) for seed in seeds]
    assert max(d.largest_m[0] for d in done) > 1e5
    check_many(done)


def test_errors_as_large_as_those_of_an_uncalibrated_sins_are_found() -> None:
    check_article_sigmas(range(2))


@pytest.mark.slow
def test_errors_as_large_as_those_of_an_uncalibrated_sins_over_many_seeds() -> None:
    check_article_sigmas(range(50))


def test_rounded_outputs_are_taken_for_what_they_are() -> None:
    found: list[tuple[NavCalibration, np.ndarray]] = []
    for seed in range(4):
        done = navigation_experiment(seed, SHORT)
        prior = make_prior(done.calibration.sensors, PriorFile(sigma=GROUP_SIGMAS))
        run = rounded(done.first, velocity_m_s=1e-3, angle_deg=1e-7)
        found.append((calibrate_navigation(run, prior=prior), done.true_values))
        assert found[-1][0].noise.velocity_m_s == pytest.approx(1e-3 / np.sqrt(12.0))
    check_chi2(found)


def rounded(run: NavRun, *, velocity_m_s: float, angle_deg: float) -> NavRun:
    step = np.deg2rad(angle_deg)
    return replace(
        run,
        velocity=velocity_m_s * np.round(run.velocity / velocity_m_s),
        lat_rad=step * np.round(run.lat_rad / step),
        lon_rad=step * np.round(run.lon_rad / step),
    )


@pytest.mark.parametrize("held", [True, False])
def test_the_true_errors_predict_the_outputs(held: bool) -> None:
    """Without noise the filter's prediction is what the navigator puts out, however far it went.

    Linear equations of the errors leave out 0.3 m/s of it where the position is 38 km off.
    """
    motion = rig_motion(there_and_back((5.0, -5.0), 2400.0, acceleration_deg_s2=10.0), 20.0)
    site = motion.site
    sensors = sensor_model(gravity_m_s2=site.gravity_m_s2)
    values = {"gyro_scale_x": 1e-4, "gyro_misalignment_xz": 1e-4, "accel_bias_y": 1e-3}
    raw = simulate_rig(motion, sensors, values, SensorNoise(), np.random.default_rng(0))
    starts = [c.c_start for c in motion.cycles]
    run = navigate_rig(raw, starts, output_step_s=1.0, height_held=held)
    own = NavFilter(
        cycles=[nav_cycle(run, rows) for rows in run.cycles],
        sensors=sensors,
        prior=make_prior(sensors),
        noise=NavNoise(gyro=NOISE.gyro, accel=NOISE.accel),
        site=site,
        free=not held,
    )
    true = replace(own.first_nominal(), values=vector(values, sensors.names), c_start=tuple(starts))
    assert np.abs(run.velocity).max() > 10.0
    for k, cycle in enumerate(own.cycles):
        seen = own.predict(true, k)
        left = cycle.velocity - seen.velocity
        # what changes of rate leave open in the seconds in which they fall
        open_m_s = float(np.sum(cycle.bend * np.linalg.norm(seen.pushed, axis=1)))
        # and by that tilt's share of gravity that the gyros' errors, turned likewise, leave: less
        # than a tenth of what noise of 1e-4 m/s/√s adds in the same time
        noise = NOISE.accel * np.sqrt(cycle.time_s - cycle.time_s[0])
        assert (np.abs(left[:, : len(own.axes)]).max(axis=1) < open_m_s + 0.1 * noise).all()


def vector(values: Mapping[str, float], names: Sequence[str]) -> np.ndarray:
    return np.array([values.get(name, 0.0) for name in names])


def test_too_few_outputs_are_refused() -> None:
    run = navigation_experiment(0, SHORT).first
    one = replace(run, cycle=np.append(run.cycle[:-1], 3))
    with pytest.raises(InputError, match="cycle 4: one output"):
        calibrate_navigation(one)


def test_the_second_run_is_ten_times_better_compensated() -> None:
    done = [navigation_experiment(seed) for seed in range(3)]
    assert all(5e3 < d.largest_m[1] < 5e4 for d in done)  # of the article's size: 12 and 15 km
    assert float(np.median([d.ratio for d in done])) > 10.0
