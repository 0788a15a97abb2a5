"""White noise plus drift: whitening, and what REML finds of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.blocks import Kept
from errormodel.noise.drift_or_white import estimate_noise
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import drift_product
from errormodel.record import Record
from tests.errormodel.noise.sampled import sampled


def uneven_record(n: int = 60) -> Record:
    rng = np.random.default_rng(2)
    time_s = np.concatenate([np.cumsum(rng.uniform(5, 60, n)), np.cumsum(rng.uniform(5, 60, n))])
    return Record(time_s=time_s, run=np.repeat([0, 1], n), signals={})


def covariance(record: Record, noise: NoiseModel) -> np.ndarray:
    apart = np.abs(record.time_s[:, None] - record.time_s)
    same = record.run[:, None] == record.run
    drift = noise.drift**2 * np.exp(-apart / noise.drift_tau_s) * same
    return noise.white**2 * np.eye(len(record)) + drift


NOISE = NoiseModel(white=2.0, drift=3.0, drift_tau_s=400.0)


def test_whitening_is_the_inverse_cholesky_factor() -> None:
    record = uneven_record()
    columns = np.random.default_rng(0).standard_normal((len(record), 3))
    expected = np.linalg.solve(np.linalg.cholesky(covariance(record, NOISE)), columns)
    assert_allclose(NOISE.whiten(record, columns), expected, rtol=1e-9, atol=1e-12)


def test_covariance_product_in_linear_time_is_the_dense_one() -> None:
    record = uneven_record()
    columns = np.random.default_rng(0).standard_normal((len(record), 3))
    expected = columns.T @ covariance(record, NOISE) @ columns
    drift = NOISE.drift**2 * drift_product(record, NOISE.drift_tau_s, Kept(columns))
    assert_allclose(NOISE.white**2 * columns.T @ columns + drift, expected, rtol=1e-10)


def test_samples_have_the_covariance_they_claim() -> None:
    record = uneven_record(20)
    rng = np.random.default_rng(5)
    whitened = [NOISE.whiten(record, sampled(NOISE, record, rng)[:, None]) for _ in range(400)]
    total = float(np.sum(np.square(whitened)))
    dof = 400 * len(record)
    assert abs(total - dof) < 4 * np.sqrt(2 * dof)  # 4 sigma of a χ²


def long_record() -> Record:
    n = 1400
    return Record(
        time_s=np.tile(np.arange(n) * 10.0, 4), run=np.repeat(np.arange(4), n), signals={}
    )


def test_drift_is_found_where_there_is_drift() -> None:
    record = long_record()
    noise = NoiseModel(white=5.0, drift=3.0, drift_tau_s=3600.0)
    x = np.ones((len(record), 1))
    drifts, whites = [], []
    for seed in range(8):
        residual = sampled(noise, record, np.random.default_rng(seed))
        found = estimate_noise(record, residual, x).noise
        drifts.append(found.drift)
        whites.append(found.white)
    # white: 5600 readings leave 1 % each; drift: some 16 independent stretches leave 20 % each
    assert np.mean(whites) == pytest.approx(5.0, rel=0.02)
    assert np.mean(drifts) == pytest.approx(3.0, rel=0.3)


def test_white_noise_is_called_white_or_nearly() -> None:
    record = long_record()
    for seed in range(4):
        residual = 5.0 * np.random.default_rng(seed).standard_normal(len(record))
        found = estimate_noise(record, residual, np.ones((len(record), 1))).noise
        assert found.drift < 0.6  # what 5600 white readings can pose as: 5/√(5600/80) at most
        assert found.white == pytest.approx(5.0, rel=0.04)


def test_the_scale_of_the_data_does_not_matter() -> None:
    record = long_record()
    residual = sampled(NOISE, record, np.random.default_rng(1))
    x = np.column_stack([np.ones(len(record)), record.time_s])
    large, small = (estimate_noise(record, f * residual, x).noise for f in (1.0, 1e-9))
    assert small.white == pytest.approx(1e-9 * large.white, rel=1e-3)
    assert small.drift == pytest.approx(1e-9 * large.drift, rel=1e-2)


def test_the_likelihood_shares_add_up() -> None:
    record = long_record()
    found = estimate_noise(
        record, sampled(NOISE, record, np.random.default_rng(1)), np.ones((len(record), 1))
    )
    # shares below 1e-3 are dropped: 49 grid points can lose 5 % at most
    assert 0.95 < sum(share for share, _ in found.support) <= 1.0 + 1e-9


def test_a_perfect_fit_and_a_few_readings_do_not_break_it() -> None:
    record = Record(time_s=np.arange(5.0), signals={})
    assert estimate_noise(record, np.zeros(5), np.ones((5, 1))).noise.drift == 0.0
    assert estimate_noise(record, np.arange(5.0), np.ones((5, 1))).noise.white > 0
