"""Readings of campaigns of a stranger's simulator: what is sound stays, what is not is told.

Each line stands for one that was once silent or wrong.
"""

import logging
from pathlib import Path

import numpy as np
import pytest

from accelbench.commands.fit.doubts import run_to_run_sentence
from errormodel.errors import InputError
from tests.thermo.fitting.strange_runs import NOMINAL, Setup, campaign
from tests.thermo.uncertainty.doubted import STAGES, fitted, worst
from thermo.recording.files import RecordedRuns, make_runs, read_runs, write_runs
from thermo.recording.readings_check import flag_readings
from thermo.recording.units_check import unit_complaints


def changed(setup: Setup, seed: int, **columns) -> RecordedRuns:
    """Return a campaign with columns replaced by functions of its table."""
    frame = campaign(setup, seed).frame()
    return make_runs(
        frame.assign(**{name: change(frame) for name, change in columns.items()}),
        output_unit="mA",
        gravity_m_s2=9.80665,
        nominal_scale=NOMINAL,
    )


def flagged(record: RecordedRuns) -> float:
    return float(np.mean(~flag_readings(record).good))


TWO = {"runs": 2, "rates": (1.0, 1.6)}


@pytest.mark.parametrize(
    "setup",
    [
        Setup(**TWO),
        Setup(**TWO, lag_s=120.0),
        Setup(**TWO, loop_ug=60.0),
        Setup(**TWO, lsb_ug=50.0, white_ug=1.0),
        Setup(**TWO, lsb_ug=200.0),
        Setup(**TWO, thermistor_noise_c=0.3),
        Setup(**TWO, odd_run_ug=100.0),
        Setup(**TWO, line_ug_h=10.0),
        Setup(**TWO, dwell_s=10.0),
        Setup(**TWO, dwell_s=900.0),
        Setup(**TWO, step_s=60.0, dwell_s=600.0),
        Setup(**TWO, positions=(0.0, 180.0)),
        Setup(runs=7, soaks_c=STAGES, offset_ug=30.0),
        Setup(runs=2, soaks_c=(-40.0, 70.0), thermistor_noise_c=0.05),
        Setup(corners_c=(48.0, 53.0, 48.0), rates=(0.05,), runs=1, thermistor_noise_c=0.1),
    ],
    ids=lambda s: str(s)[:60],
)
def test_sound_readings_stay(setup):
    record = campaign(setup, 1)
    assert flagged(record) <= 0.001
    assert unit_complaints(record) == ()


@pytest.mark.parametrize("step_c", [0.1, 0.5])
def test_a_thermistor_shown_in_coarse_digits_loses_nothing(step_c):
    record = changed(Setup(**TWO), 1, temp_c=lambda f: step_c * np.round(f["temp_c"] / step_c))
    assert flagged(record) <= 0.001


def test_tails_of_student_lose_less_than_a_hundredth():
    noise = np.random.default_rng(1).standard_t(3, 4000)
    record = changed(
        Setup(**TWO, white_ug=0.0), 1,
        output=lambda f: f["output"] + 1.3e-6 * 2.5 * noise[: len(f)],
    )  # fmt: skip
    # |t3| beyond 6.5 robust sigmas has probability 0.5 %
    assert flagged(record) < 0.01


def moving_head(every: int, share: float) -> RecordedRuns:
    """The first of some readings in a row is taken on the way from the position before."""
    frame = campaign(Setup(**TWO), 1).frame()
    angle = frame["position_deg"].to_numpy()
    first = np.arange(every, len(frame), every)
    way = np.random.default_rng(1).uniform(0.0, share, first.size)
    true = angle.copy()
    true[first] += (angle[first - 1] - angle[first]) * way
    off = np.sin(np.deg2rad(true)) - np.sin(np.deg2rad(angle))
    return changed(Setup(**TWO), 1, output=lambda f: f["output"] + 1.302 * off)


@pytest.mark.parametrize("every", [6, 12])
def test_a_head_that_still_moves_in_every_sixth_reading_is_refused_with_the_guess(tmp_path, every):
    """It was fitted with a residual of 417 mg, without a word."""
    path: Path = tmp_path / "run.csv"
    write_runs(moving_head(every, 1.0), path)
    with pytest.raises(InputError, match="was the head still moving"):
        read_runs([path])
    assert len(read_runs([path], trust_units=True)) == len(moving_head(every, 1.0))


def test_a_head_that_comes_to_rest_a_little_late_is_told(caplog):
    with caplog.at_level(logging.WARNING):
        record = flag_readings(moving_head(6, 0.02))
    assert record.good.all()
    assert "the head may still move, or the output may settle after a move" in caplog.text


def test_k1_that_differs_between_runs_at_one_temperature_each_is_told_and_carried():
    """It was 46 sigma off in its slope, beside sigmas that knew nothing of it."""
    setup = Setup(runs=7, soaks_c=STAGES, scale_ppm=30.0)
    one = fitted(setup)
    assert worst(one, setup) < 5.0
    assert "ppm in K1" in run_to_run_sentence(one)
