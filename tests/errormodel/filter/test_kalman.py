"""The filter core against the textbook algebra and against the batch solution."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from errormodel.filter.kalman import factorise, initial_state, propagate, update


def random_cov(rng: np.random.Generator, n: int) -> np.ndarray:
    a = rng.standard_normal((n, n + 2))
    return a @ a.T


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 9))
def test_factors_give_the_covariance_back(seed: int, n: int) -> None:
    cov = random_cov(np.random.default_rng(seed), n)
    u, d = factorise(cov)
    assert_allclose((u * d) @ u.T, cov, rtol=1e-9, atol=1e-12 * np.abs(cov).max())
    assert_allclose(np.tril(u), np.eye(n))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 8))
def test_update_and_propagation_are_the_textbook_ones(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    x, cov = rng.standard_normal(n), random_cov(rng, n)
    h, r, z = rng.standard_normal(n), 0.3, float(rng.standard_normal())
    phi, g, q = rng.standard_normal((n, n)), rng.standard_normal((n, 2)), np.array([0.2, 0.0])

    state, innovation = update(initial_state(x, cov), h, r, z)
    s = h @ cov @ h + r
    gain = cov @ h / s
    after = cov - np.outer(gain, h @ cov)
    assert innovation.value == pytest.approx(z - h @ x)
    assert innovation.variance == pytest.approx(s)
    assert_allclose(state.x, x + gain * (z - h @ x), rtol=1e-8, atol=1e-9)
    assert_allclose(state.cov, after, rtol=1e-7, atol=1e-9 * np.abs(cov).max())

    moved = propagate(state, phi, g, q)
    expected = phi @ after @ phi.T + (g * q) @ g.T
    assert_allclose(moved.x, phi @ state.x, rtol=1e-9, atol=1e-12)
    assert_allclose(moved.cov, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def test_recursive_estimate_of_constants_is_the_batch_one_to_rounding() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(-65, 45, 400) / 50
    h = np.column_stack([np.ones_like(x), x, x**2, np.sin(np.arange(400))])
    truth, sigma, prior = np.array([1.0, -2.0, 0.5, 3.0]), 1e-3, 1e3
    z = h @ truth + sigma * rng.standard_normal(400)
    state = initial_state(np.zeros(4), np.full(4, prior**2))
    for row, value in zip(h, z, strict=True):
        state, _ = update(state, row, sigma**2, float(value))
    information = h.T @ h / sigma**2 + np.eye(4) / prior**2
    assert_allclose(state.x, np.linalg.solve(information, h.T @ z / sigma**2), rtol=1e-9)
    assert_allclose(state.cov, np.linalg.inv(information), rtol=1e-8, atol=1e-20)


def test_a_prior_a_billion_times_wider_than_the_noise_leaves_the_variance_positive() -> None:
    state = initial_state([0.0, 0.0], [1e18, 1e18])
    for h in ([1.0, 1.0], [1.0, 1.0 + 1e-6], [1.0, -1.0]):
        state, _ = update(state, h, 1e-6, 1.0)
        assert np.all(state.d >= 0)
    assert np.all(state.sigmas < 1.0)


def test_nis_of_a_true_model_is_chi_squared() -> None:
    rng = np.random.default_rng(8)
    total, n = 0.0, 3000
    state, truth = initial_state([0.0], [1.0]), rng.standard_normal()
    for _ in range(n):
        truth = 0.9 * truth + 0.3 * rng.standard_normal()
        state = propagate(state, [[0.9]], [[1.0]], [0.09])
        state, innovation = update(state, [1.0], 0.25, truth + 0.5 * rng.standard_normal())
        total += innovation.nis
    assert abs(total / n - 1.0) < 4 * np.sqrt(2 / n)  # 4 sigma of a mean of n χ²₁


@pytest.mark.parametrize("variance", [0.0, -1.0, np.nan])
def test_a_measurement_without_noise_is_refused(variance: float) -> None:
    with pytest.raises(ValueError, match="variance"):
        update(initial_state([0.0], [1.0]), [1.0], variance, 1.0)


def test_shapes_and_signs_are_checked() -> None:
    with pytest.raises(ValueError, match="does not fit"):
        initial_state([0.0, 1.0], [1.0])
    with pytest.raises(ValueError, match="negative"):
        initial_state([0.0], [-1.0])
