"""Calibration from navigation outputs, and the article's experiment on the twin."""

import numpy as np
import pytest
from scipy.stats import chi2

from sinscal.experiment import NOISE, Experiment, navigation_experiment
from sinscal.programme import there_and_back

# 12-minute cycles at the experiment's rates: the same physics in a third of the time
SHORT = there_and_back((2.0, -2.0, 5.0, -5.0), 720.0, acceleration_deg_s2=10.0)


def error_chi2(done: Experiment) -> float:
    found = done.calibration
    error = found.values - done.true_values
    return float(error @ np.linalg.solve(found.cov, error))


def nis(done: Experiment) -> float:
    found = done.calibration.filtered
    judged = list(done.calibration.judged)
    return float(np.nanmean(found.innovation[:, judged] ** 2 / found.variance[:, judged]))


def check_many(seeds: range, programme=None) -> None:
    done = [navigation_experiment(seed, programme) for seed in seeds]
    total = sum(error_chi2(d) for d in done)
    dof = sum(d.calibration.values.size for d in done)
    assert 0.001 < chi2.sf(total, dof) < 0.999
    mean = float(np.mean([nis(d) for d in done]))
    count = sum(int(np.isfinite(d.calibration.filtered.innovation[:, 0]).sum()) * 2 for d in done)
    # the outputs are taken to be good to 1e-5 m/s beside 1e-4 m/s of noise a second: 1 % too much
    assert abs(mean - 0.99) < 3.3 * np.sqrt(2.0 / count) + 0.01


def test_errors_are_those_of_the_covariance() -> None:
    check_many(range(4), SHORT)


@pytest.mark.slow
def test_errors_are_those_of_the_covariance_over_many_seeds() -> None:
    check_many(range(50))


def test_the_second_run_is_ten_times_better_compensated() -> None:
    done = [navigation_experiment(seed) for seed in range(3)]
    assert NOISE.gyro > 0
    assert all(5e3 < d.largest_m[1] < 5e4 for d in done)  # of the article's size: 12 and 15 km
    assert float(np.median([d.ratio for d in done])) > 10.0
