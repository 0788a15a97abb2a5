import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.statistics.robust import (
    bisquare_fit,
    longest_increasing,
    robust_sigma,
    running_median,
)


def test_the_sigma_of_a_normal_sample_is_recovered_though_a_tenth_of_it_is_spoiled():
    values = np.random.default_rng(1).standard_normal(20_000)
    values[::10] = 1e6
    # a tenth far away moves the median of |x| from the 50th to the 55.6th percentile: 13 %
    assert robust_sigma(values) == pytest.approx(1.13, abs=0.02)


def test_the_running_median_follows_a_ramp_and_a_step_and_not_a_spike():
    ramp = np.arange(40.0)
    np.testing.assert_array_equal(running_median(ramp, 3)[3:-3], ramp[3:-3])
    step = np.where(np.arange(40) < 20, 0.0, 5.0)
    np.testing.assert_array_equal(running_median(step, 3), step)
    spike = np.zeros(40)
    spike[[0, 20, 21]] = 9.0  # the first reading too: the mirrored ends hold it once
    np.testing.assert_array_equal(running_median(spike, 3), np.zeros(40))


def test_a_robust_fit_gives_the_line_of_the_sound_readings():
    rng = np.random.default_rng(2)
    x = rng.uniform(-1, 1, 500)
    y = 3.0 - 2.0 * x + 1e-3 * rng.standard_normal(500)
    y[rng.choice(500, 100, replace=False)] += rng.uniform(5, 1e6, 100)
    found = bisquare_fit(np.column_stack([np.ones(500), x]), y)
    # 400 sound readings give both to 1e-3 / sqrt(400 · var x); five such sigmas
    np.testing.assert_allclose(found, [3.0, -2.0], atol=5 * 1e-3 / np.sqrt(400 / 3))


@given(st.lists(st.integers(0, 30), max_size=25))
def test_the_longest_increasing_sequence_is_increasing_and_none_is_longer(values):
    keep = longest_increasing(np.array(values, dtype=float))
    kept = np.array(values, dtype=float)[keep]
    assert np.all(np.diff(kept) > 0)
    best = [1] * len(values)  # the textbook's quadratic method
    for j in range(len(values)):
        best[j] = 1 + max((best[i] for i in range(j) if values[i] < values[j]), default=0)
    assert len(kept) == max(best, default=0)


def test_one_wrong_time_costs_one_row_and_what_is_no_number_none():
    time_s = np.arange(20.0)
    time_s[7], time_s[12] = 9e6, np.nan
    assert np.flatnonzero(~longest_increasing(time_s)).tolist() == [7, 12]
