"""The tests by which calibrations are judged have the false-alarm rates they claim."""

import numpy as np
from scipy.signal import lfilter
from scipy.stats import kstest

from sinscal.calibration.consistency import ljung_box, nis_of, slow_drift
from sinscal.calibration.hold_out import shift_test
from sinscal.calibration.observability import observability


def test_nis_s_interval_holds_its_share() -> None:
    rng = np.random.default_rng(1)
    passed = [nis_of(rng.standard_normal(500)).passed for _ in range(2000)]
    # 0.1 % should fail: of 2000 more than 8 do in one of 10⁴ such tests
    assert sum(passed) >= 2000 - 8
    assert not nis_of(1.2 * rng.standard_normal(500)).passed


def test_p_values_of_white_noise_are_uniform() -> None:
    rng = np.random.default_rng(2)
    white, slow = [], []
    for _ in range(400):
        series = [rng.standard_normal(600) for _ in range(3)]
        series[1][100:140] = np.nan
        white.append(ljung_box(series))
        slow.append(slow_drift(series))
    assert kstest(white, "uniform").pvalue > 0.001
    assert kstest(slow, "uniform").pvalue > 0.001


def test_coloured_noise_is_not_white_and_drift_is_slow() -> None:
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(1000)
    coloured = lfilter([1.0], [1.0, -0.3], noise)
    drift = noise + 0.5 * np.sin(np.arange(1000) / 150.0)
    assert ljung_box([coloured]) < 1e-6
    assert slow_drift([drift]) < 1e-3


def test_the_shift_of_nested_data_is_chi_square() -> None:
    """Least squares of 20 and of 30 of the same readings: their shift is all theirs."""
    rng = np.random.default_rng(4)
    a = rng.standard_normal((30, 4))
    full, part = np.linalg.inv(a.T @ a), np.linalg.inv(a[:20].T @ a[:20])
    p_values = []
    for _ in range(400):
        y = rng.standard_normal(30)
        shift = shift_test(full @ a.T @ y, full, part @ a[:20].T @ y[:20], part)
        assert shift.dof == 4
        p_values.append(shift.p_value)
    assert kstest(p_values, "uniform").pvalue > 0.001


def test_observability_names_what_is_not_shown_and_what_cannot_be_told_apart() -> None:
    prior = np.array([1.0, 2.0, 3.0, 4.0])
    information = np.zeros((4, 4))
    row = np.array([0.0, 1.0, 1.0, 0.0])  # only the sum, in sigmas, of the second and third
    information += 1e6 * np.outer(row / prior, row / prior)
    information[3, 3] = 1e6
    cov = np.linalg.inv(information + np.diag(prior**-2))
    found = observability(("a", "b", "c", "d"), cov, prior)
    assert found.not_observed == ("a",)
    (combination,) = found.combinations
    assert {*combination} == {"b", "c"}
    np.testing.assert_allclose(sum(combination.values()), 0.0, atol=1e-6)
    (pair,) = found.correlated
    assert pair.names == ("b", "c")
    assert pair.correlation < -0.9
    assert (found.singular_values > 100).sum() == 2
