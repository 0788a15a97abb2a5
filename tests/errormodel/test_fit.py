"""The batch fit: closed forms, recovery judged by its own covariance, refusals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from benchmarks.fit_many import fit_many
from errormodel.covariance import expected_covariance
from errormodel.errors import NotSeparableError
from errormodel.fit import fit
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from tests.errormodel.examples import decay_term, linear_term
from tests.errormodel.noise.sampled import sampled

WHITE = NoiseModel(white=5e-6)
DRIFT = NoiseModel(white=5e-6, drift=3e-6, drift_tau_s=3600.0)


def measured(record: Record, output: np.ndarray) -> Record:
    return Record(time_s=record.time_s, run=record.run, signals=record.signals, output=output)


def test_noise_free_data_give_the_coefficients_back_to_rounding(model, record, truth) -> None:
    result = fit(model, measured(record, model.simulate(record, truth)), noise=WHITE)
    for name, value in truth.items():
        assert result.value(name) == pytest.approx(value, rel=1e-9, abs=1e-15)
    assert result.rms < 1e-14


def test_a_model_linear_in_its_unknowns_is_plain_least_squares(record) -> None:
    line = ErrorModel((linear_term("a", "input", "x", 0), linear_term("b", "input", "x")), "u")
    y = record["u"] + 0.3 + 0.02 * record["x"] + np.random.default_rng(0).standard_normal(1440)
    result = fit(line, measured(record, y), noise=NoiseModel(white=1.0))
    columns = np.column_stack([np.ones(1440), record["x"]])
    expected = np.linalg.lstsq(columns, y - record["u"], rcond=None)[0]
    assert_allclose(result.values, expected, rtol=1e-10)
    assert_allclose(result.cov, np.linalg.inv(columns.T @ columns), rtol=1e-9)


@pytest.mark.parametrize("seeds", [15, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize("weighting", ["equal", "noise"])
@pytest.mark.parametrize("noise", [WHITE, DRIFT], ids=["white", "drift"])
def test_truth_lies_within_the_stated_sigmas(model, record, truth, noise, weighting, seeds) -> None:
    clean = model.simulate(record, truth)
    expected = np.array([truth[c.name] for c in model.coefficients])
    total = 0.0
    for seed in range(seeds):
        y = clean + sampled(noise, record, np.random.default_rng(seed))
        result = fit(model, measured(record, y), weighting=weighting)
        error = result.values - expected
        total += float(error @ np.linalg.solve(result.cov, error))
    p = stats.chi2.sf(total, seeds * expected.size)
    assert 0.001 < p < 0.999


def test_white_sigmas_would_have_been_wrong_under_drift(model, record, truth) -> None:
    """The same data judged by sigmas of white noise of the same rms: far outside."""
    clean, expected = model.simulate(record, truth), [truth[c.name] for c in model.coefficients]
    total = 0.0
    for seed in range(20):
        y = clean + sampled(DRIFT, record, np.random.default_rng(seed))
        result = fit(
            model, measured(record, y), noise=NoiseModel(white=float(np.hypot(5e-6, 3e-6)))
        )
        error = result.values - np.array(expected)
        total += float(error @ np.linalg.solve(result.cov, error))
    assert stats.chi2.sf(total, 20 * 5) < 1e-6


def test_a_nonlinear_parameter_is_fitted_between_any_grid(model, record, truth) -> None:
    larger = model.with_terms(decay_term())
    values = {**truth, "decay": 2e-4, "tau": 437.0}
    y = larger.simulate(record, values) + sampled(WHITE, record, np.random.default_rng(3))
    result = fit(larger, measured(record, y))
    error = result.values - np.array([values[n] for n in larger.names])
    assert stats.chi2.sf(float(error @ np.linalg.solve(result.cov, error)), error.size) > 0.001
    assert result.sigma("tau") < 20.0


def test_many_channels_in_one_call_are_each_the_single_fit(model, record, truth) -> None:
    clean = model.simulate(record, truth)
    y = np.column_stack(
        [clean + sampled(WHITE, record, np.random.default_rng(k)) for k in range(6)]
    )
    many = fit_many(model, measured(record, y))
    for k, one in enumerate(many):
        alone = fit(model, measured(record, y[:, k]), noise=one.noise)
        assert_allclose(one.values, alone.values, rtol=1e-9, atol=1e-15)
        assert_allclose(one.sigmas, alone.sigmas, rtol=1e-6)
        assert one.rms == pytest.approx(alone.rms, rel=1e-9)
        assert one.noise.white == pytest.approx(5e-6, rel=0.1)  # 1440 readings: 2 % sigma


def test_the_covariance_foretold_is_the_one_found(model, record, truth) -> None:
    foretold = expected_covariance(model, record, truth, DRIFT)
    y = model.simulate(record, truth) + sampled(DRIFT, record, np.random.default_rng(0))
    assert_allclose(fit(model, measured(record, y), noise=DRIFT).cov, foretold, rtol=1e-3)


def test_confounded_coefficients_are_refused_by_name(record) -> None:
    cube = linear_term("cube", "input", "u", 3)
    three = Record(
        time_s=record.time_s,
        run=record.run,
        signals={"x": record["x"], "u": np.sign(record["u"])},  # −1, 0, 1: a cube is a line
        output=np.sign(record["u"]),
    )
    model = ErrorModel(
        (linear_term("gain", "gain", "x", 0), linear_term("bias", "input", "x", 0), cube), "u"
    )
    with pytest.raises(NotSeparableError, match="gain ~ cube") as refused:
        fit(model, three)
    assert refused.value.groups == (("gain", "cube"),)


def test_a_coefficient_without_effect_is_refused_by_name(record) -> None:
    still = record.with_signals(x=np.zeros(len(record)))
    model = ErrorModel((linear_term("bias_t", "input", "x"),), "u")
    with pytest.raises(NotSeparableError, match=r"bias_t \(it has no effect there\)"):
        fit(model, measured(still, record["u"]))


def test_misuse_is_refused(model, record, truth) -> None:
    with pytest.raises(ValueError, match="one measured output"):
        fit(model, record)
    with pytest.raises(ValueError, match="cannot determine"):
        fit(model, measured(record, model.simulate(record, truth)).take(np.arange(4)))
    with pytest.raises(ValueError, match="outputs of shape"):
        fit_many(model, record)
    with pytest.raises(ValueError, match="without nonlinear"):
        fit_many(model.with_terms(decay_term()), record)


def test_conditioning_is_reported_on_scaled_columns(model, record, truth) -> None:
    result = fit(model, measured(record, model.simulate(record, truth)), noise=WHITE)
    assert 1.0 <= result.condition < 20.0  # the unscaled columns would give 1e5
