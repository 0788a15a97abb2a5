"""How noisy a thermistor is, told from how its temperature moves."""

import numpy as np
import pandas as pd
import pytest

from accelbench.commands.fit.text import fit_sentences
from tests.thermo.fitting.strange_runs import NOMINAL, TRUE, output_of
from thermo.fitting.fit import fit_runs
from thermo.recording.channel import channel_of
from thermo.recording.files import RecordedRuns, make_runs
from thermo.selection.support import thermistor_noise_c

POSITIONS = np.arange(0.0, 360.0, 45.0)


def stairs(runs: int, step_s: float, noise_c: float) -> RecordedRuns:
    """Eleven soaks from 80 to −30 °C and back, each approached within 5 min, 10 h a run."""
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 36_000.0, step_s)
    soaks_c = np.concatenate([np.arange(80.0, -31.0, -22.0), np.arange(-8.0, 81.0, 22.0)])
    target_c = soaks_c[np.minimum((time_s / 3600.0 * 1.1).astype(int), soaks_c.size - 1)]
    keep, temp_c = np.exp(-step_s / 300.0), target_c.copy()
    for k in range(1, time_s.size):
        temp_c[k] += keep * (temp_c[k - 1] - temp_c[k])
    angle = POSITIONS[np.arange(time_s.size) % POSITIONS.size]
    exact = output_of(TRUE, temp_c, angle)
    frames = [
        pd.DataFrame(
            {
                "run": str(run),
                "serial": "A",
                "time_s": time_s,
                "temp_c": temp_c + noise_c * rng.standard_normal(time_s.size),
                "position_deg": angle,
                "output": exact + 1.3e-6 * 5.0 * rng.standard_normal(time_s.size),
            }
        )
        for run in range(runs)
    ]
    return recorded(pd.concat(frames, ignore_index=True))


def recorded(frame: pd.DataFrame) -> RecordedRuns:
    return make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL)


def noise_of(record: RecordedRuns) -> float:
    return thermistor_noise_c(channel_of(record, "A", t_ref_c=25.0))


def test_a_thermistor_without_noise_is_not_called_noisy_on_stairs() -> None:
    """It was told of 0.65 °C of noise: what an approach read every 4 min leaves about a line."""
    (one,) = fit_runs(stairs(8, 240.0, 0.0))
    assert not one.doubts.temperature_noise_counts
    assert not any("the thermistor's noise of" in told for told in fit_sentences(one))


@pytest.mark.parametrize("step_s", [10.0, 60.0, 120.0])
@pytest.mark.parametrize("noise_c", [0.02, 0.3])
def test_the_noise_of_a_thermistor_is_found_on_stairs(step_s: float, noise_c: float) -> None:
    found = noise_of(stairs(2, step_s, noise_c))
    # a robust sigma of 600 readings whose deviations overlap is known to 7 %; at 120 s one window
    # in eight holds a corner of the stairs, which adds some 15 %
    assert noise_c * 0.79 < found < noise_c * 1.36


def test_what_digits_round_off_is_noise_though_neighbours_repeat_them() -> None:
    frame = stairs(1, 2.0, 0.0).frame()
    frame["temp_c"] = 0.5 * np.round(np.linspace(-30.0, 80.0, len(frame)) / 0.5)
    ramp = recorded(frame)
    # half a digit at most: uniform, but for what a robust sigma makes of a line in two minutes
    assert 0.5 * 0.5 / np.sqrt(12.0) < noise_of(ramp) < 1.5 * 0.5 / np.sqrt(12.0)
