import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.planning.legs import Leg
from thermo.planning.plan import make_plan
from thermo.planning.sequence import SelfHeating, Uniformity, load_sequence
from thermo.station.checks.uniformity import judge_ramp, judge_test, local_slopes, self_heating_rate

ROOT = Path(__file__).parents[4]
LEG = Leg(index=1, start_s=0, end_s=6600, start_c=-40, end_c=70, step_c=0, positions=None)
TIME_S = np.arange(0, 6600, 10.0)
RULE = Uniformity(transient_min=15.0, window_min=5.0, band_fraction=0.1)


def judge(temp_c, rule=RULE, leg=LEG):
    return judge_ramp(TIME_S, temp_c, leg, rule, serial="A", run=1)


def test_an_exact_ramp_is_uniform():
    verdict = judge(-40 + TIME_S / 60)
    assert verdict.passed
    assert verdict.measured == pytest.approx(1.0, abs=1e-9)
    assert verdict.share_inside == 1.0
    assert verdict.readings == 660 - 90  # 15 min of transient at 10 s
    assert "uniform: +1.000" in verdict.sentence


def test_a_lagging_case_is_uniform_after_the_transient_only():
    temp_c = -40 + (TIME_S - 240 * (1 - np.exp(-TIME_S / 240))) / 60
    assert judge(temp_c).passed
    # without it the first 2.3 time constants (exp(-t/τ) > 0.1) are outside
    inclusive = judge(temp_c, Uniformity(transient_min=0.0, band_fraction=0.1))
    assert inclusive.share_inside == pytest.approx(1 - 2.3 * 240 / 6600, abs=0.02)


def test_a_wavy_ramp_is_not():
    temp_c = -40 + TIME_S / 60 + 1.0 * np.sin(2 * np.pi * TIME_S / 1200)
    verdict = judge(temp_c)
    # the rate swings by ±2π/20 min = 0.31 °C/min, filtered by the window to 0.28: it is inside
    # ±0.1 for 2/π·asin(0.1/0.28)
    assert not verdict.passed
    assert verdict.share_inside == pytest.approx(2 / np.pi * np.arcsin(0.1 / 0.285), abs=0.03)
    assert "not uniform" in verdict.sentence


def test_sigma_of_the_slope_is_the_scatter_of_the_slope():
    rng = np.random.default_rng(4)
    noise_c = 0.01
    slopes, sigmas = local_slopes(
        TIME_S, -40 + TIME_S / 60 + rng.normal(0, noise_c, TIME_S.size), 300.0
    )
    middle = slice(15, -15)
    # closed form for 31 equidistant points of 1/6 min: σ / sqrt(Σ(t-t̄)²)
    expected = noise_c / np.sqrt(np.sum((np.arange(-15, 16) / 6) ** 2))
    assert np.sqrt(np.mean(sigmas[middle] ** 2)) == pytest.approx(expected, rel=0.05)
    assert np.std(slopes[middle]) == pytest.approx(expected, rel=0.35)  # some 20 independent ones


@given(st.lists(st.floats(0.5, 60), min_size=4, max_size=60), st.floats(-5, 5), st.floats(20, 900))
def test_a_line_is_a_line_however_it_is_sampled(steps, rate, window_s):
    time_s = 1e5 + np.cumsum(steps)
    slope, sigma = local_slopes(time_s, 20 + rate * time_s / 60, window_s)
    known = np.isfinite(slope)
    # windows of a second hold digits of 1e5 s only to 1e-5 or so
    np.testing.assert_allclose(slope[known], rate, atol=1e-3 * (1 + abs(rate)))
    assert np.all(sigma[known] >= 0)


def test_too_few_readings_give_no_verdict():
    verdict = judge_ramp([0.0, 10.0], [1.0, 2.0], LEG, RULE, serial="A", run=1)
    assert not verdict.passed
    assert verdict.readings == 0
    assert "no verdict" in verdict.sentence


def test_broken_thermistor_readings_are_left_out():
    temp_c = -40 + TIME_S / 60
    temp_c[100::7] = np.nan
    assert judge(temp_c).passed


def test_mismatch_with_the_sins():
    rule = Uniformity(sins_self_heating_rate_c_per_min=0.8)
    verdict = judge(-40 + TIME_S / 60, rule)
    assert verdict.mismatch_percent == pytest.approx(25.0, abs=1e-6)
    assert "mismatch +25.0 %" in verdict.sentence


def test_the_sins_curve_counts_where_the_ramp_is():
    table = SelfHeating(time_min=(0, 10, 20, 40), temp_c=(20, 30, 35, 40))
    assert self_heating_rate(None, table, 20, 30) == pytest.approx(1.0)
    assert self_heating_rate(None, table, 30, 40) == pytest.approx(1 / 3)
    assert self_heating_rate(None, table, -40, -30) == pytest.approx(0.5)  # the whole of it
    assert self_heating_rate(None, None, 0, 1) is None


def test_a_cooling_ramp_is_compared_by_magnitude():
    leg = dataclasses.replace(LEG, start_c=70, end_c=-40)
    verdict = judge(70 - TIME_S / 60, Uniformity(sins_self_heating_rate_c_per_min=1.0), leg)
    assert verdict.passed
    assert verdict.mismatch_percent == pytest.approx(0.0, abs=1e-6)


def test_every_ramp_of_a_test_is_judged():
    config = read_toml(ROOT / "examples/stations/f4t.toml", StationConfig)
    plan = make_plan(load_sequence(ROOT / "examples/sequences/demo.toml"), config)
    run = plan.run(1)
    rows = [
        pd.DataFrame(
            {
                "run": 1,
                "serial": a.serial,
                "segment": run.segment,
                "time_s": run.time_s,
                "temp_c": run.temp_c,
                "voided": "",
            }
        )
        for a in plan.sequence.accelerometers
    ]
    verdicts = judge_test(plan, pd.concat(rows))
    assert [(v.segment, v.serial) for v in verdicts] == [
        (s, f"QA-00{k}") for s in (1, 2) for k in (1, 2, 3)
    ]
    # behind a lag of 5 min a change of rate (2 °C/min at the turn) needs 5·ln(2/0.1) = 15 min
    assert all(v.passed for v in verdicts)


LONG = Leg(index=1, start_s=0, end_s=13200, start_c=-40, end_c=70, step_c=0, positions=None)


def judge_long(temp_c, period_s=10.0):
    time_s = np.arange(0, 13200, period_s)
    return judge_ramp(time_s, temp_c(time_s / 60), LONG, RULE, serial="A", run=1)


def paused(minutes, at_min, for_min):
    """Half a degree a minute, with a stop."""
    return -40 + 0.5 * (minutes - np.clip(minutes - at_min, 0, for_min))


@pytest.mark.parametrize("for_min", [5.0, 12.0])
def test_a_stop_is_not_uniform_however_long_the_ramp(for_min):
    verdict = judge_long(lambda m: paused(m, 100.0, for_min))
    assert not verdict.passed
    assert verdict.share_inside > 0.9  # the share alone would have passed it
    # a window sees the stop from where it holds a tenth of it
    assert verdict.longest_outside_min == pytest.approx(for_min + 4.0, abs=1.5)
    assert "outside for" in verdict.sentence


def test_a_ramp_that_ends_short_is_not_uniform():
    assert not judge_long(lambda m: np.minimum(-40 + 0.5 * m, 65.0)).passed
    time_s = np.arange(0, 12600, 10.0)
    cut = judge_ramp(time_s, -40 + 0.5 * time_s / 60, LONG, RULE, serial="A", run=1)
    assert not cut.passed
    assert cut.unread_min == pytest.approx(10.0, abs=0.2)
    assert "unread at its end" in cut.sentence


def test_readings_that_are_missing_for_long_are_not_taken_for_uniform():
    time_s = np.arange(0, 13200, 10.0)
    time_s = time_s[(time_s < 6000) | (time_s > 6900)]
    verdict = judge_ramp(time_s, -40 + 0.5 * time_s / 60, LONG, RULE, serial="A", run=1)
    assert not verdict.passed


@pytest.mark.parametrize("noise_c", [0.1, 0.2, 0.3])
def test_a_noisy_thermistor_does_not_make_a_perfect_ramp_uneven(noise_c):
    failed = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        ramp = judge_long(
            lambda m, rng=rng: -40 + 0.5 * m + noise_c * rng.standard_normal(m.size), 60
        )
        failed += not ramp.passed
        assert ramp.noise_c == pytest.approx(noise_c, rel=0.35)  # 200 readings, a median
        assert "hides differences" in ramp.sentence
    assert failed <= 1


def test_a_noisy_thermistor_does_not_hide_a_stop():
    rng = np.random.default_rng(1)
    ramp = judge_long(lambda m: paused(m, 100.0, 15.0) + 0.1 * rng.standard_normal(m.size), 60)
    assert not ramp.passed
