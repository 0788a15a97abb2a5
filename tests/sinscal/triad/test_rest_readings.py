"""A triad's readings that cannot be true: coarse converters, wrong units, spoiled rows, means."""

from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import InputError
from sinscal.triad.rests import (
    RestCalibration,
    Rests,
    calibrate_at_rest,
    rests_of_log,
    rests_of_means,
)
from tests.sinscal.triad.example import COUNTS, G, recording

# readings in m/s²: scales, misalignments, biases
TRUTH = np.array([1 / 1.02, 1 / 0.99, 1 / 1.005, 0.01, -0.005, 0.008, 0.12, -0.08, 0.2])
NOISE = 0.002  # m/s²
CHI2_9 = 27.9  # p = 0.001


def rests(values: np.ndarray, **given: object) -> Rests:
    whole = {
        "accel": values, "others": np.empty((len(values), 0)), "step_s": 0.01,
        "gravity_m_s2": G, "unit": "m/s2", "source": "log",
    }  # fmt: skip
    return Rests(**(whole | given))  # type: ignore[arg-type]


def log(seed: int) -> np.ndarray:
    return recording(seed=seed, positions=24, noise=NOISE, values=TRUTH)[0]


def chi2(done: RestCalibration, truth: np.ndarray = TRUTH) -> float:
    off = done.fit.values - truth
    return float(off @ np.linalg.solve(done.fit.cov, off))


@pytest.mark.parametrize("digit", [0.0383, 0.01, 0.004])
def test_a_converter_coarser_than_the_noise_finds_all_positions_and_says_what_it_hides(digit):
    """From a step of twenty times the noise to twice: sigmas hold over ten recordings."""
    found = []
    for seed in range(10):
        done = calibrate_at_rest(rests(np.round(log(seed) / digit) * digit))
        assert len(done.intervals) == 24
        assert done.left_out.size <= 3
        found.append(chi2(done))
    # nine times ten degrees of freedom, and the scatter between positions where it is estimated
    assert 0.3 * 9 < np.mean(found) < 1.6 * 9
    if digit > 0.01:
        # over all places within a step, e.g. 0.0383/√12 = 0.0111 less what some toggle
        assert 0.7 < done.intervals.digit_sigma.max() / (digit / np.sqrt(12)) < 1.0


def test_a_fine_converter_hides_nothing():
    done = calibrate_at_rest(rests(log(1)))
    assert not done.intervals.digit_sigma.any()


def test_readings_that_cannot_be_true_are_left_out():
    """One in two hundred: every rest has two, and a half-second window with one is no rest."""
    clean = log(3)
    whole = calibrate_at_rest(rests(clean))
    for change in (lambda v: v + 0.5, lambda v: 9.9e37, lambda v: 0.0):
        spoiled, rng = clean.copy(), np.random.default_rng(3)
        rows = rng.choice(len(clean), len(clean) // 200, replace=False)
        spoiled[rows, 1] = change(spoiled[rows, 1])
        done = calibrate_at_rest(rests(spoiled))
        assert len(done.intervals) == 24
        inside = [any(a <= r <= b for a, b in zip(done.intervals.first, done.intervals.last,
                                                  strict=True)) for r in rows]  # fmt: skip
        big = np.abs(clean[rows, 1] - spoiled[rows, 1]) > 0.1
        assert set(rows[np.array(inside) & big]) <= set(done.left_out.tolist())
        # the median of fifty neighbours stands in for one reading of two hundred
        off = (done.fit.values - whole.fit.values) / whole.fit.sigmas
        assert np.abs(off).max() < 0.5
        assert done.left_out.size < 1.3 * rows.size


@pytest.mark.parametrize(
    ("unit", "factor", "words"),
    [
        ("m/s2", 1 / G, "m/s²: are they in g?"),
        ("g", 1.0, "are they in m/s²?"),
        ("m/s2", 1e3, "are they in thousandths of m/s2?"),
        ("g", 1e3 / G, "are they in thousandths of g?"),
        ("m/s2", 0.3, "expected 0.5 to 2 times 1"),
    ],
)
def test_units_that_are_unlikely_are_refused_with_a_guess(unit, factor, words):
    wrong = rests(factor * log(4), unit=unit)
    with pytest.raises(InputError) as caught:
        calibrate_at_rest(wrong)
    assert words in str(caught.value)
    done = calibrate_at_rest(wrong, trust_units=True)
    assert len(done.doubts) == 1
    assert words in done.doubts[0]


@pytest.mark.parametrize(("unit", "step"), [("ms", 10.0), ("µs", 1e4), ("ns", 1e7)])
def test_times_in_another_unit_are_refused_with_a_guess(tmp_path, unit, step):
    values = log(5)
    path = tmp_path / "log.csv"
    table = np.column_stack([step * np.arange(len(values)), values])
    np.savetxt(path, table, delimiter=",", header="t,x,y,z", comments="", fmt="%.6f")
    read = rests_of_log(path, ("x", "y", "z"), gravity_m_s2=G, time_column="t", unit="m/s2")
    with pytest.raises(InputError, match=f"are the times in {unit}\\?"):
        calibrate_at_rest(read)


def means_file(folder: Path, k: int, sigma: float, seed: int) -> Path:
    raw, where = recording(seed=seed, positions=k, noise=0.0)
    rng = np.random.default_rng(seed)
    means = np.array([raw[a] for a, _ in where]) + sigma * rng.standard_normal((k, 3))
    path = folder / f"means{seed}.csv"
    np.savetxt(path, means, delimiter=",", header="x,y,z", comments="", fmt="%.4f")
    return path


@pytest.mark.parametrize("sigma", [0.0, 1.5])
def test_means_of_positions_are_enough(tmp_path, sigma):
    """With their sigma given, and with what they differ by as the only witness of it."""
    total = []
    for seed in range(12):
        path = means_file(tmp_path, 24, 1.5, seed)
        read = rests_of_means(path, ("x", "y", "z"), gravity_m_s2=G, sigma=sigma)
        total.append(chi2(calibrate_at_rest(read), COUNTS))
    # χ² of 9, or 9·F(9, 15) where the noise is estimated; means of twelve, 4 sigma
    assert 9 - 4 * np.sqrt(18 / 12) < np.mean(total) < 9 * 15 / 13 + 4 * np.sqrt(2.6 * 18 / 12)


def test_too_few_means_are_told(tmp_path):
    read = rests_of_means(means_file(tmp_path, 7, 1.0, 1), ("1", "2", "3"), gravity_m_s2=G)
    with pytest.raises(InputError, match="7 positions, expected 9 at least"):
        calibrate_at_rest(read)
    nine = rests_of_means(means_file(tmp_path, 9, 1.0, 1), ("1", "2", "3"), gravity_m_s2=G)
    with pytest.raises(InputError, match="their sigma cannot be estimated"):
        calibrate_at_rest(nine)
