"""What single cycles show: a daily swing is named by its period, and nothing else is."""

import numpy as np
import pytest

from errormodel.arrays import FloatArray
from tests.thermo.run_in.examples import series_of
from tests.thermo.stability.coverage import LAWS
from thermo.run_in.judge import judge_run_in
from thermo.run_in.signs import daily_swing

EVERY_5_H = 5.0 * np.arange(90)


def swing(hours: FloatArray, size: float) -> FloatArray:
    return np.vstack([size * np.cos(2 * np.pi * (hours - 15.0) / 24.0), np.zeros(hours.size)])


def test_a_daily_swing_is_named_with_its_size_where_the_times_show_it() -> None:
    truth = LAWS["exponential"](np.random.default_rng(3)) + swing(EVERY_5_H, 10.0)
    series = [s.first(14) for s in series_of(truth, np.random.default_rng(4))]
    verdict = judge_run_in("S", series, hours=EVERY_5_H[:14])
    (found,) = verdict.swings
    # 14 cycles known to 2 µg give an amplitude to 2·√(2/14) = 0.8 µg
    assert found.coefficient == "k0"
    assert found.amplitude == pytest.approx(10.0, abs=3 * 0.8)
    assert "K0 swings by ±" in verdict.sentence
    assert "period 24 h" in verdict.sentence
    assert judge_run_in("S", series).swings == ()


@pytest.mark.parametrize("every_h", [24.0, 23.9, 48.0])
def test_cycles_at_the_same_hour_of_the_day_show_no_daily_swing(every_h: float) -> None:
    hours = every_h * np.arange(90)
    truth = LAWS["exponential"](np.random.default_rng(3)) + swing(hours, 10.0)
    series = [s.first(14) for s in series_of(truth, np.random.default_rng(4))]
    assert daily_swing(series[0], hours[:14], 3.0) is None


@pytest.mark.parametrize("law", ["still", "exponential", "stretched", "walk", "power"])
def test_what_does_not_swing_is_named_in_half_a_percent_of_cases(law: str) -> None:
    named = 0
    for seed in range(400):
        rng = np.random.default_rng([5, seed])
        (one, _) = series_of(LAWS[law](rng), rng)
        hours = rng.uniform(3.0, 9.0) * np.arange(90)
        named += daily_swing(one.first(14), hours[:14], 2.5) is not None
    # 2 expected at 0.5 %; nine or more come by chance in 2 of 10⁴ cases
    assert named <= 8
