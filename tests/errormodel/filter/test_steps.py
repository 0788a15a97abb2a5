"""The filter of many steps against dense algebra, and what goes through its gains."""

import numpy as np
import pytest

from errormodel.filter.gains import covariance_share, signatures
from errormodel.filter.kalman import initial_state
from errormodel.filter.steps import Steps, run_filter

N, LEAD, M, K = 9, 4, 3, 40


def example(seed: int = 1) -> tuple[Steps, np.ndarray]:
    rng = np.random.default_rng(seed)
    phi = 0.2 * rng.standard_normal((K, LEAD, N))
    phi[:, :, :LEAD] += np.eye(LEAD)
    phi[7, :, :LEAD] = 0.0  # a step that forgets where it was, as at the start of a cycle
    root = rng.standard_normal((N, N))
    steps = Steps(
        h=rng.standard_normal((K, M, N)),
        z=rng.standard_normal((K, M)),
        r=rng.uniform(0.5, 2.0, (K, M)),
        phi=phi,
        q=rng.uniform(0.0, 0.1, (K, LEAD)),
    )
    return steps, root @ root.T / N


def dense(steps: Steps, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean, covariance and innovations of the textbook filter."""
    x, p, nus = np.zeros(N), cov.copy(), []
    for k in range(K):
        for j in range(M):
            h = steps.h[k, j]
            s = h @ p @ h + steps.r[k, j]
            gain = p @ h / s
            nus.append(steps.z[k, j] - h @ x)
            x = x + gain * nus[-1]
            keep = np.eye(N) - np.outer(gain, h)
            p = keep @ p @ keep.T + np.outer(gain, gain) * steps.r[k, j]
        full = np.eye(N)
        full[:LEAD] = steps.phi[k]
        x, p = full @ x, full @ p @ full.T
        p[:LEAD, :LEAD] += np.diag(steps.q[k])
    return x, p, np.array(nus).reshape(K, M)


def test_it_is_the_textbook_filter() -> None:
    steps, cov = example()
    found = run_filter(initial_state(np.zeros(N), cov), steps, every=10)
    x, p, nus = dense(steps, cov)
    np.testing.assert_allclose(found.state.x, x, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(found.state.cov, p, atol=1e-9 * np.abs(p).max())
    np.testing.assert_allclose(found.innovation, nus, atol=1e-8)
    np.testing.assert_allclose(found.sigmas[-1], np.sqrt(np.diag(p)), rtol=1e-8)


def test_a_missing_measurement_changes_nothing_and_a_wild_one_is_refused() -> None:
    steps, cov = example()
    z = steps.z.copy()
    z[5, 1], z[6, 0] = np.nan, 1e4
    wild = Steps(h=steps.h, z=z, r=steps.r, phi=steps.phi, q=steps.q)
    z2 = z.copy()
    z2[6, 0] = np.nan
    without = Steps(h=steps.h, z=z2, r=steps.r, phi=steps.phi, q=steps.q)
    start = initial_state(np.zeros(N), cov)
    found, expected = run_filter(start, wild, gate=6.0), run_filter(start, without)
    np.testing.assert_array_equal(found.state.x, expected.state.x)
    assert not found.used[6, 0]
    assert found.innovation[6, 0] > 1e3
    assert np.isnan(found.innovation[5, 1])
    assert found.normalised.size == K * M - 2


def test_signatures_are_what_a_planted_effect_adds_to_the_innovations() -> None:
    steps, cov = example()
    rng = np.random.default_rng(3)
    in_h, in_phi = rng.standard_normal((K, M, 2)), rng.standard_normal((K, LEAD, 2))
    start = initial_state(np.zeros(N), cov)
    plain = run_filter(start, steps, with_gains=True)
    size = np.array([0.7, -1.3])
    # the moving states are pushed by the effect: the measurements contain what they became
    full, pushed, extra = np.zeros(N), [], []
    for k in range(K):
        extra.append(steps.h[k] @ full + in_h[k] @ size)
        full = np.concatenate([steps.phi[k] @ full + in_phi[k] @ size, full[LEAD:]])
        pushed.append(full)
    planted = Steps(h=steps.h, z=steps.z + np.array(extra), r=steps.r, phi=steps.phi, q=steps.q)
    with_effect = run_filter(start, planted)
    found = signatures(steps, plain.gains, in_h, in_phi) @ size
    difference = with_effect.innovation - plain.innovation
    np.testing.assert_allclose(found, difference, atol=1e-9 * np.abs(difference).max())


def test_shares_of_all_sources_add_up_to_the_covariance() -> None:
    steps, cov = example()
    found = run_filter(initial_state(np.zeros(N), cov), steps, with_gains=True)
    no_r, no_q, no_p = np.zeros((K, M)), np.zeros((K, LEAD)), np.zeros((N, N))
    shares = [
        covariance_share(steps, found.gains, cov, no_r, no_q),
        covariance_share(steps, found.gains, no_p, steps.r, no_q),
        covariance_share(steps, found.gains, no_p, no_r, steps.q),
    ]
    total = found.state.cov
    np.testing.assert_allclose(sum(shares), total, atol=1e-9 * np.abs(total).max())
    assert all(np.trace(s) > 0 for s in shares)


def test_shapes_that_do_not_fit_are_refused() -> None:
    steps, cov = example()
    with pytest.raises(ValueError, match="do not fit"):
        run_filter(initial_state(np.zeros(N - 1), cov[1:, 1:]), steps)
