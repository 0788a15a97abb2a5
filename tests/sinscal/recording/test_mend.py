"""Wild readings, rows of zeros and stamps that jitter: mended so that a calibration stays right."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from errormodel.errors import InputError
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.recording.files import read_rig_run, write_rig_run
from tests.sinscal.twin import Twin, make_twin

COARSE = Options(hold_out="none")
Spoil = Callable[[pd.DataFrame], object]


@pytest.fixture(scope="module")
def twin() -> Twin:
    return make_twin(6)


def spoiled(twin: Twin, spoil: Spoil, folder: Path, *, increments: bool = False) -> Path:
    path = folder / "run.csv"
    write_rig_run(twin.run, path, increments=increments)
    frame = pd.read_csv(path)
    spoil(frame)
    frame.to_csv(path, index=False)
    return path


SENSORS = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]


def wild_gyro(frame: pd.DataFrame) -> None:
    frame.loc[7_000, "gyro_z"] = 5.0


def wild_row(frame: pd.DataFrame) -> None:
    frame.loc[7_000, SENSORS] = 1e4


def zeros(frame: pd.DataFrame) -> None:
    frame.loc[7_000:7_001, SENSORS] = 0.0


def no_rates(frame: pd.DataFrame) -> None:
    frame.loc[7_000:7_003, SENSORS[:3]] = 0.0


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (wild_gyro, "in 1 row(s) (gyro_z), from line 7002"),
        (wild_row, "in 1 row(s) (gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z), from line 7"),
        (zeros, "zero_rows: 2 rows of zeros (gyros, accelerometers) are taken as empty cells, fro"),
        (no_rates, "zero_rows: 4 rows of zeros (gyros) are taken as empty cells, from line 7002"),
    ],
)
def test_what_stands_alone_is_mended_and_told(
    twin: Twin, spoil: Spoil, told: str, tmp_path: Path
) -> None:
    run = read_rig_run(spoiled(twin, spoil, tmp_path))
    assert told in " ".join(run.warnings)
    # a row 20 ms long at 10 °/s: without the repair the attitude is off by 0.2° at least
    np.testing.assert_allclose(run.gyro[7_000:7_004], twin.run.gyro[7_000:7_004], atol=5e-5)
    assert np.asarray(run.flag)[7_000]
    judged = calibrate_and_judge(run, COARSE)
    assert judged.passed, judged.warnings
    assert twin.chi2(judged) < chi2.isf(0.001, 21)


def test_without_repair_one_wild_reading_spoils_the_calibration(twin: Twin, tmp_path: Path) -> None:
    run = read_rig_run(spoiled(twin, wild_gyro, tmp_path), physics=False)
    assert run.warnings == ()
    judged = calibrate_and_judge(run, COARSE)
    assert twin.chi2(judged) > chi2.isf(1e-6, 21) or not judged.passed


@pytest.mark.parametrize(
    ("columns", "value", "words"),
    [
        (SENSORS, 0.0, "zeros in all of a triad's cells; so are 1.2% of the cycle's rows"),
        (["gyro_x"], 5.0, "an isolated reading; so are 1.2% of the cycle's rows"),
    ],
)
def test_a_run_with_many_of_them_is_refused(
    twin: Twin, columns: list[str], value: float, words: str, tmp_path: Path
) -> None:
    def spoil(frame: pd.DataFrame) -> None:
        frame.loc[np.arange(100, 100 + 120 * 50, 50), columns] = value

    path = spoiled(twin, spoil, tmp_path)
    with pytest.raises(InputError) as caught:
        read_rig_run(path)
    assert "line 102" in str(caught.value)
    assert words in str(caught.value)


def test_stamps_that_jitter_beside_even_increments_are_evened(twin: Twin, tmp_path: Path) -> None:
    """1 ms of 20 ms; an interval of 1 s would see gravity wrong by 10 mm/s²."""
    rng = np.random.default_rng(1)

    def jitter(frame: pd.DataFrame) -> None:
        frame["time_s"] += 1e-3 * rng.uniform(-1.0, 1.0, len(frame))

    run = read_rig_run(spoiled(twin, jitter, tmp_path, increments=True))
    (told,) = run.warnings
    assert told.startswith("stamps_evened: time_s is up to 1.0")
    # the mean of 10 000 stamps that are even within 1 ms is known to 6 µs
    np.testing.assert_allclose(run.step_s, 0.02, atol=1e-8)
    judged = calibrate_and_judge(run, COARSE)
    assert judged.passed, judged.warnings
    assert twin.chi2(judged) < chi2.isf(0.001, 21)


def test_steps_that_really_vary_are_left_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    n = 2_000
    step = 0.02 * rng.uniform(0.9, 1.1, n)
    table = {"time_s": np.cumsum(step), "cycle": np.zeros(n, dtype=int)}
    table |= {f"dtheta_{a}": 0.1 * step for a in "xyz"}
    noise = 1e-3 * np.sqrt(0.02) * rng.standard_normal((n, 3))
    table |= {f"dv_{a}": 9.8 / np.sqrt(3.0) * step + noise[:, k] for k, a in enumerate("xyz")}
    path = tmp_path / "run.csv"
    pd.DataFrame(table).to_csv(path, index=False)
    path.with_suffix(".toml").write_text("latitude_deg = 55.75\nheight_m = 150.0\n")
    run = read_rig_run(path)
    assert not any(w.startswith("stamps_evened") for w in run.warnings)
    np.testing.assert_allclose(run.step_s[1:], step[1:], atol=1e-12)
