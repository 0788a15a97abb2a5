"""Recorded runs as an error model sees them."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from errormodel.errors import InputError
from tests.thermo.examples import recorded, simulate_run
from thermo.recording.channel import channel_of, direction_of, rows_of
from thermo.recording.signals import smooth_temperature


def test_a_ramp_has_its_rate_and_its_own_value_everywhere() -> None:
    time_s = np.cumsum(np.random.default_rng(0).uniform(5, 15, 300))
    temp_c = 3.0 + 1.5 / 60 * time_s
    slow, rate = smooth_temperature(time_s, temp_c, np.zeros(300, dtype=int))
    np.testing.assert_allclose(rate, 1.5, rtol=1e-6)
    np.testing.assert_allclose(slow, temp_c, atol=1e-6)


def test_thermistor_noise_is_averaged_as_a_line_over_the_window_does() -> None:
    time_s = np.arange(2000) * 10.0
    noise = 0.002 * np.random.default_rng(1).standard_normal(2000)
    slow, rate = smooth_temperature(time_s, noise, np.zeros(2000, dtype=int))
    inner = slice(20, -20)
    # 13 points in ±60 s: σ/√13 for the value, σ/√Σt² for the slope (Σt² = 18200 s²)
    assert np.std(slow[inner]) == pytest.approx(0.002 / np.sqrt(13), rel=0.1)
    assert np.std(rate[inner]) == pytest.approx(60 * 0.002 / np.sqrt(18200), rel=0.1)


def test_runs_do_not_leak_into_one_another() -> None:
    time_s = np.tile(np.arange(50) * 10.0, 2)
    temp_c = np.concatenate([np.linspace(0, 10, 50), np.linspace(10, 0, 50)])
    _, rate = smooth_temperature(time_s, temp_c, np.repeat([0, 1], 50))
    assert np.all(rate[:50] > 1.0)
    assert np.all(rate[50:] < -1.0)


def test_directions_by_their_sign_with_holds_between() -> None:
    rate = np.array([1.0, 1.0, 0.02, -0.03, -0.9, -1.0])
    assert direction_of(rate).tolist() == [1, 1, 0, 0, -1, -1]


def test_the_head_angle_gives_the_forces() -> None:
    frame = simulate_run(np.random.default_rng(0), n=40)
    channel = channel_of(recorded(frame), "A")
    angle = np.deg2rad(frame["position_deg"])
    # forces are rounded to 1e-15 g, so that sin 180° is zero
    np.testing.assert_allclose(channel.record["a_i_g"], np.sin(angle), atol=1e-15)
    np.testing.assert_allclose(channel.record["a_p_g"], np.cos(angle), atol=1e-15)
    assert np.all(channel.record["a_i_g"][np.isin(frame["position_deg"], [0.0, 180.0])] == 0.0)
    np.testing.assert_allclose(channel.record.output, frame["output"] / 1.3)
    np.testing.assert_allclose(channel.record["x_c"], frame["temp_c"] - 25.0)


def test_runs_come_in_order_and_flagged_readings_stay_out() -> None:
    rng = np.random.default_rng(0)
    one, two = simulate_run(rng, run="b", n=40), simulate_run(rng, run="a", n=40)
    two["flag"] = ["late"] * 3 + [""] * 37
    runs = recorded(one, two)
    channel = channel_of(runs, "A")
    assert channel.run_ids == ("b", "a")
    assert len(channel.record) == 77
    assert rows_of(runs, "A", np.ones(80, dtype=bool)).size == 80
    part = channel.take(channel.runs_mask(("a",)))
    assert part.run_ids == ("a",)
    assert len(part.record) == 37


def test_nothing_good_and_nobody_there_are_said() -> None:
    frame = simulate_run(np.random.default_rng(0), n=40)
    frame["flag"] = "bad"
    with pytest.raises(InputError, match="every reading is flagged"):
        channel_of(recorded(frame), "A")
    with pytest.raises(InputError, match="no serial 'B'; expected one of A"):
        channel_of(recorded(frame), "B")


def test_runs_that_cannot_have_been_at_once_are_laid_end_to_end() -> None:
    frames = [simulate_run(np.random.default_rng(k), run=f"r{k}", n=40) for k in range(2)]
    long_s = frames[0]["time_s"].max()
    first = datetime(2026, 3, 2, 18, tzinfo=UTC)

    def hours(later_s: float) -> float:
        runs = replace(
            recorded(*frames),
            run_start_utc={"r0": first, "r1": first + timedelta(seconds=later_s)},
        )
        channel = channel_of(runs, "A")
        began = channel.record["elapsed_h"][channel.record.run == 1]
        return float(began[0] - frames[1]["time_s"][0] / 3600.0)

    assert hours(long_s + 7200.0) == pytest.approx(long_s / 3600.0 + 2.0)
    assert hours(30.0) == pytest.approx(long_s / 3600.0)  # an emulated test: hours in seconds
