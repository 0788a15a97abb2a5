"""The noise floor: what does not repeat."""

import numpy as np

from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import drifting
from tests.errormodel.discrepancy.examples import time_base, waves

BASE = time_base(runs=4, n=250)


def test_white_noise_is_found_beside_an_effect_that_repeats() -> None:
    rng = np.random.default_rng(1)
    wave = waves(BASE, 3.0)
    sigmas = []
    for _ in range(6):
        residual = 2.0 * rng.standard_normal(len(BASE)) + 10.0 * wave
        mean = np.column_stack([np.ones(len(BASE)), wave])
        floor = estimate_floor(BASE, residual, mean)
        slow = floor.noise.slow_share(BASE.span_s)
        sigmas.append(floor.noise.white * np.sqrt(1.0 + slow))
    # rms of six estimates from 998 degrees each: 2·sqrt(1/(2·998·6)) = 0.018; four of these
    assert abs(np.sqrt(np.mean(np.square(sigmas))) - 2.0) < 0.075


def test_drift_is_found_with_its_size_and_correlation_time() -> None:
    truth = drifting(2.0, 1800.0)
    white = np.random.default_rng(2).standard_normal((len(BASE), 8))
    found = []
    for column in truth.whitener(BASE).colour(white).T:
        floor = estimate_floor(BASE, column, np.ones((len(BASE), 1)))
        assert floor.noise.family != "white"
        slow = floor.noise.drift**2 * len(floor.noise.slow_tau_s)
        found.append((slow, floor.noise.slow_tau_s[0], floor.noise.white))
    slow, tau_s, sigma = np.median(np.array(found), axis=0)
    # sixteen hours hold some 16 correlation times: 35 % in variance for each draw
    assert 1.3 < slow < 3.0
    assert 900.0 < tau_s < 3600.0
    assert abs(sigma - 1.0) < 0.06
