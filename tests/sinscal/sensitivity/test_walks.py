"""Walks of gyros and accelerometers are given the sizes that a run leaves likely."""

import numpy as np
import pytest

from sinscal.calibration.rig import calibrate
from sinscal.filter.data import cycle_data
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.walks import SIZES, likely_walks, walks_likelihood
from sinscal.twin.simulate import SensorNoise
from tests.sinscal.twin import NOISE, SIX_RATES, make_twin

TAU_S = 300.0


def rates_of(gyro: float, accel: float) -> tuple[float, float]:
    """Return σ²/τ of the walks found where those of these sigmas are there for five minutes."""
    noise = SensorNoise(
        gyro=NOISE.gyro, accel=NOISE.accel, gyro_instability=gyro, accel_instability=accel,
        instability_tau_s=TAU_S,
    )  # fmt: skip
    run = make_twin(3, rates=SIX_RATES, cycle_s=400.0, hz=20.0, noise=noise).run
    walks = likely_walks(FilterProblem(run, calibrate(run), cycle_data(run, 1.0), ()), 1.0)
    return walks.gyro**2 / walks.tau_s, walks.accel**2 / walks.tau_s


def test_walks_that_show_have_their_size_and_one_that_does_not_is_bounded() -> None:
    # σ²/τ is what a run tells of a walk, by some forty waves of three axes: to a third of itself
    gyro, accel = 3e-6**2 / TAU_S, 2e-3**2 / TAU_S
    both = rates_of(3e-6, 2e-3)
    assert both[0] == pytest.approx(gyro, rel=0.7)
    assert both[1] == pytest.approx(accel, rel=0.7)
    alone = rates_of(0.0, 2e-3)
    assert 0.0 < alone[0] < 0.2 * both[0]
    assert alone[1] == pytest.approx(accel, rel=0.7)


def test_the_likelihood_is_that_of_waves_of_both_kinds_together() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((60, 12))
    seen, shape = rng.standard_normal(60), rng.uniform(0.2, 1.0, 6)
    got = walks_likelihood(columns.T @ columns, columns.T @ seen, shape)
    for i, j in ((0, 0), (20, 30), (40, 10)):
        sigma = np.concatenate([SIZES[i] * shape, SIZES[j] * shape])
        cov = np.eye(60) + (columns * sigma**2) @ columns.T
        whole = -0.5 * (seen @ np.linalg.solve(cov, seen) + np.linalg.slogdet(cov)[1])
        assert got[i, j] == pytest.approx(whole + 0.5 * seen @ seen, rel=1e-9)
