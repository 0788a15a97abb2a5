import logging

import numpy as np
import pytest

from tests.thermo.recording.readings_examples import NOMINAL, WAYS, clean, recorded
from thermo.recording.files import make_runs, read_runs, write_runs
from thermo.recording.readings_check import flag_readings


@pytest.mark.parametrize("way", WAYS)
def test_every_spoiled_reading_is_found_and_sound_ones_stay(way):
    """Twenty recordings of each, and what they change, are in benchmarks/bench_spoiled.py."""
    before = clean(1)
    after = WAYS[way](before, np.random.default_rng(1001))
    touched = (before["temp_c"] != after["temp_c"]) | (before["output"] != after["output"])
    flagged = ~flag_readings(recorded(after)).good
    assert flagged[touched].all()
    # of the clipped ones those go as well whose noise the end of the range may have cut off
    allowed = 0.02 if way == "output clipped" else 0.001
    assert np.mean(flagged & ~touched) <= allowed


@pytest.mark.parametrize(
    "real",
    [
        {"loop_ug": 200.0},
        {"loop_ug": 60.0, "loop_c": 8.0},
        {"loop_ug": 100.0, "loop_c": 4.0, "period_s": 10.0},
        {"step_ug": 500.0},
        {"settling_ug": 60.0},
        {"lag_s": 120.0},
        {"period_s": 10.0, "noise_ug": 1.0},
        {"period_s": 60.0},
    ],
    ids=str,
)
def test_what_is_real_is_not_taken_away(real):
    for seed in range(3):
        flagged = ~flag_readings(recorded(clean(seed, **real))).good
        assert flagged.mean() <= 0.001


def test_a_true_85_degrees_stays():
    frame = clean(3)
    frame["temp_c"] = frame["temp_c"] + 60.0  # 70 + 60: the run passes 85 °C on its way
    assert flag_readings(recorded(frame)).good.all()


def test_coarse_counts_are_neither_flat_nor_clipped():
    frame = clean(4)
    frame["output"] = np.round(frame["output"] / 1e-3) * 1e-3  # steps of 770 µg: digits repeat
    assert flag_readings(recorded(frame)).good.mean() > 0.999


def test_heavy_tails_lose_few_readings():
    frame = clean(5, noise_ug=0.0)
    noise = np.random.default_rng(5).standard_t(3, len(frame))
    frame["output"] += 4e-6 * 1.3 * noise
    flagged = ~flag_readings(recorded(frame)).good
    # |t3| beyond 6.5 robust sigmas has probability 0.5 %
    assert flagged.mean() < 0.01


def test_readings_left_out_are_told_with_run_line_and_reason(tmp_path, caplog):
    frame = clean(6)
    frame.loc[100, "temp_c"] = 85.0
    write_runs(recorded(frame), tmp_path / "run.csv")
    with caplog.at_level(logging.WARNING):
        record = read_runs([tmp_path / "run.csv"])
    assert record.flag.at(100) == "temperature_outlier"
    assert "run 1, A: 1 readings left out as temperature_outlier: line 102 (temp_c 85)" in (
        caplog.text
    )


def test_what_is_too_frequent_to_be_an_accident_is_told_and_kept(caplog):
    frame = clean(7, period_s=10.0)
    first = np.arange(len(frame)) % 6 == 0
    frame.loc[first, "output"] += 1e-3  # the head still moves
    with caplog.at_level(logging.WARNING):
        record = flag_readings(recorded(frame))
    assert record.good.all()
    assert "too many readings deviate from their neighbours" in caplog.text


def test_without_positions_the_outputs_are_judged_over_temperature():
    frame = clean(8).drop(columns="position_deg")
    x = frame["temp_c"] - 25.0
    frame["output"] = 1.3e-6 * (
        -430 + 11 * x + 4 * np.random.default_rng(8).standard_normal(len(frame))
    )
    frame.loc[[50, 400], "output"] += 1e-3
    record = flag_readings(
        make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL)
    )
    assert np.flatnonzero(~record.good).tolist() == [50, 400]
