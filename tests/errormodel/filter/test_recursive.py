"""The filter during a ramp equals the batch estimate of the same readings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.filter.recursive import start_recursive
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from tests.errormodel.noise.sampled import sampled

NOISE = NoiseModel(white=5e-6, drift=3e-6, drift_tau_s=3600.0)


def test_filter_and_batch_agree_to_rounding_across_runs() -> None:
    rng = np.random.default_rng(4)
    n = 500
    record = Record(
        time_s=np.tile(np.cumsum(rng.uniform(5, 15, n)), 2), run=np.repeat([0, 1], n), signals={}
    )
    x = np.tile(np.linspace(-1.3, 0.9, n), 2)
    columns = np.column_stack([rng.choice([-1, 0, 1], 2 * n), np.ones(2 * n), x, x**2])
    prior_sigma = np.array([0.1, 0.05, 0.05, 0.05])
    y = columns @ [1.01, 4e-4, 2e-4, -1e-4] + sampled(NOISE, record, rng)

    state = start_recursive(NOISE, np.zeros(4), prior_sigma)
    for k in range(2 * n):
        if k == n:
            state = state.new_run()
        state, _ = state.step(float(record.time_s[k]), columns[k], float(y[k]))

    whitened = NOISE.whiten(record, np.column_stack([columns, y]))
    a, b = whitened[:, :-1], whitened[:, -1]
    information = a.T @ a + np.diag(prior_sigma**-2.0)
    batch = np.linalg.solve(information, a.T @ b)
    sigmas = np.sqrt(np.diag(np.linalg.inv(information)))
    # rounding: the normal equations of the comparison itself keep six digits of a sigma
    assert np.max(np.abs(state.values - batch) / sigmas) < 1e-6
    assert_allclose(np.sqrt(np.diag(state.cov)), sigmas, rtol=1e-6)


def test_time_cannot_run_backwards() -> None:
    state, _ = start_recursive(NOISE, [0.0], [1.0]).step(5.0, [1.0], 0.1)
    with pytest.raises(ValueError, match="does not follow"):
        state.step(5.0, [1.0], 0.1)
