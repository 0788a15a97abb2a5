"""Scatter between runs, its limits, charts and Allan deviations."""

import allantools
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from errormodel.noise.allan import allan_deviation
from errormodel.statistics.chart import individuals_chart
from errormodel.statistics.scatter import (
    holm,
    range_bounds,
    range_quantile,
    scatter_between,
    sigma_bounds,
)


def test_exact_values_give_the_chi_square_limits_of_a_sample() -> None:
    values = np.array([3.0, 5.0, 4.0, 9.0, 1.0])
    found = scatter_between(values, np.zeros(5))
    s = np.std(values, ddof=1)
    assert found.sigma_run == pytest.approx(s, rel=1e-6)
    expected = s * np.sqrt(4 / stats.chi2.ppf([0.975, 0.025], 4))
    assert_allclose(found.ci95, expected, rtol=1e-6)
    assert found.max_minus_min_ci95 == (8.0, 8.0)
    assert found.mean == pytest.approx(values.mean())


def test_equal_sigmas_are_taken_out_in_quadrature() -> None:
    values = np.array([3.0, 5.0, 4.0, 9.0, 1.0])
    found = scatter_between(values, np.full(5, 2.0))
    assert found.sigma_run == pytest.approx(np.sqrt(np.var(values, ddof=1) - 4.0), rel=1e-6)
    assert found.sigma_estimation == pytest.approx(2.0)


def test_runs_that_agree_better_than_their_sigmas_have_an_upper_limit_all_the_same() -> None:
    found = scatter_between([1.0, 1.1, 0.9], [10.0, 10.0, 10.0])
    assert found.sigma_run == 0.0
    assert found.ci95[0] == 0.0
    # that of the scatter itself, 0.1·√(2/0.0506)
    assert found.ci95[1] == pytest.approx(0.1 * np.sqrt(2 / stats.chi2.ppf(0.025, 2)))
    assert scatter_between([2.0, 2.0], [0.0, 0.0]).ci95 == (0.0, 0.0)


@pytest.mark.parametrize("n", [5, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 10))])
def test_limits_of_sigma_hold_it_in_95_percent(n: int) -> None:
    rng = np.random.default_rng(n)
    sets, tau = 600, 2.0
    held = 0
    for _ in range(sets):
        s = rng.uniform(0.5, 1.5, n)
        c = tau * rng.standard_normal(n) + s * rng.standard_normal(n)
        lo, hi = scatter_between(c, s).ci95
        held += lo <= tau <= hi
    assert 0.92 <= held / sets <= 0.98  # 95 % ± 0.9 % by chance


def test_steady_runs_are_rarely_called_unsteady() -> None:
    # τ = 0: the lower bound exceeds 0 in 5 % of cases; 1000 sets give 50 ± 7
    rng = np.random.default_rng(1)
    lower = [sigma_bounds(rng.standard_normal(4), np.ones(4), 0.05)[0] for _ in range(1000)]
    assert 25 <= np.count_nonzero(lower) <= 78


def test_range_of_the_true_values_is_held() -> None:
    assert range_quantile(2, 0.95) == pytest.approx(np.sqrt(2) * stats.norm.ppf(0.975), abs=1e-4)
    assert range_quantile(5, 0.95) == pytest.approx(
        stats.studentized_range.ppf(0.95, 5, np.inf), abs=1e-3
    )
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(500):
        true = 3.0 * rng.standard_normal(4)
        lo, hi = range_bounds(true + rng.standard_normal(4), np.ones(4), 0.05)
        held += lo <= np.ptp(true) <= hi
    assert held >= 475 - 20  # 95 % at least; 4 sigma of 500 draws are 20


def test_trend_is_that_of_a_straight_line() -> None:
    values = np.array([1.0, 2.5, 2.0, 4.0, 4.2])
    expected = stats.linregress(np.arange(5), values)
    found = scatter_between(values, np.full(5, 0.1))
    assert found.trend_per_run == pytest.approx(expected.slope)
    assert found.trend_p == pytest.approx(expected.pvalue)
    assert scatter_between([1.0, 2.0], [0.1, 0.1]).trend_p is None


def test_trend_p_is_uniform_without_a_trend() -> None:
    rng = np.random.default_rng(5)
    p = [scatter_between(rng.standard_normal(3), np.zeros(3)).trend_p for _ in range(800)]
    assert stats.kstest(np.array(p, dtype=float), "uniform").pvalue > 0.001


def test_holm_names_what_stands_out_among_many() -> None:
    assert holm({"a": 0.001, "b": 0.02, "c": 0.3}, 0.05) == ("a", "b")
    assert holm({"a": 0.02, "b": 0.03, "c": 0.04}, 0.05) == ()


@pytest.mark.parametrize("values", [[1.0], [1.0, 2.0]])
def test_wrong_shapes_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="two values or more"):
        scatter_between(values, [1.0])


def test_chart_has_no_limits_below_eight_values() -> None:
    few = individuals_chart(np.arange(7.0))
    assert (few.limits, few.range_limit, few.outside, few.false_alarm) == (None, None, (), None)
    assert_allclose(few.ranges, 1.0)


def test_chart_has_the_textbook_limits_and_finds_the_step() -> None:
    values = np.array([0.1, -0.1, 0.2, 0.0, -0.2, 0.1, 0.0, -0.1, 3.0])
    chart = individuals_chart(values)
    mean_range = np.mean(np.abs(np.diff(values)))
    assert chart.limits is not None
    assert chart.limits[1] - chart.centre == pytest.approx(2.66 * mean_range, rel=1e-3)
    assert chart.range_limit == pytest.approx(3.267 * mean_range)
    assert chart.outside == (8,)


def test_chart_s_false_alarms_are_as_often_as_stated() -> None:
    rng = np.random.default_rng(9)
    charts = [individuals_chart(rng.standard_normal(10)) for _ in range(1500)]
    share = np.mean([bool(c.outside) for c in charts])
    stated = charts[0].false_alarm
    assert stated is not None
    assert share == pytest.approx(stated, abs=4 * np.sqrt(stated / 1500) + 0.004)


def test_allan_deviation_is_that_of_allantools() -> None:
    y = np.cumsum(np.random.default_rng(0).standard_normal(700))
    found = allan_deviation([y], 2.5)
    _, expected, _, terms = allantools.oadev(y, rate=0.4, data_type="freq", taus=found.tau_s)
    assert_allclose(found.deviation, expected, rtol=1e-10)
    assert_allclose(found.terms, terms)
    assert found.tau_s[-1] <= 2.5 * 700 / 3


def test_allan_deviations_of_several_holds_are_pooled() -> None:
    rng = np.random.default_rng(1)
    pieces = [rng.standard_normal(n) for n in (40, 400, 90)]
    found = allan_deviation(pieces, 1.0)
    alone = [allan_deviation([p], 1.0) for p in pieces]
    squares = sum(a.deviation[0] ** 2 * a.terms[0] for a in alone)
    assert found.deviation[0] == pytest.approx(np.sqrt(squares / sum(a.terms[0] for a in alone)))
    assert allan_deviation([[1.0, 2.0]], 1.0).tau_s.size == 0
