import numpy as np
import pytest

from errormodel.errors import InputError
from sinscal.triad.intervals import find_intervals, what_is_missing
from tests.sinscal.triad.example import recording


@pytest.mark.parametrize("unit", [1.0, 1e-6, 2.4e-3])
def test_rests_are_found_whatever_the_unit(unit):
    raw, rests = recording(seed=1, unit=unit)
    found = find_intervals(raw, 0.01)
    assert len(found) == len(rests)
    for (a, b), first, last in zip(rests, found.first, found.last, strict=True):
        # half a window is lost at either end, and a window that begins in motion is no rest
        assert a <= first <= a + 30
        assert b - 30 <= last < b
    # noise of 3 counts: the mode of a variance of 50 samples is that of a χ² of 49 dof, 4 % low,
    # and is found to some per cent
    np.testing.assert_allclose(found.noise / unit, 3.0, rtol=0.08)


def test_no_rest_is_lost_to_chance():
    """An hour of nothing but noise is one rest, or pieces that together are nearly all of it."""
    for seed in range(5):
        values = np.random.default_rng(seed).standard_normal((72_000, 3))
        found = find_intervals(values, 0.01)
        assert found.rest_s / found.total_s > 0.995


def test_slow_drift_at_rest_is_rest_still():
    rng = np.random.default_rng(3)
    drift = np.cumsum(rng.standard_normal((6000, 3)), axis=0) * 0.02
    raw, rests = recording(seed=3)
    found = find_intervals(raw + np.resize(drift, raw.shape), 0.01)
    assert len(found) == len(rests)


@pytest.mark.parametrize("rate", [0.05, 0.2])
def test_a_steady_turn_is_no_rest(rate):
    """2.9 and 11 °/s, 1 mg of noise: the force moves by more than it in a window."""
    rng = np.random.default_rng(4)
    t = np.arange(0, 60, 0.01)
    turning = np.where(t < 30, 0.0, rate * (t - 30))
    values = 9.81 * np.column_stack([np.cos(turning), np.sin(turning), 0 * t])
    found = find_intervals(values + 0.01 * rng.standard_normal(values.shape), 0.01)
    assert np.all(found.last < 3000 + 60)


def test_a_knock_does_not_make_two_rests_of_one():
    raw, rests = recording(seed=5)
    raw[150:160] += 50.0
    assert len(find_intervals(raw, 0.01)) == len(rests)


def test_what_is_missing_is_said():
    raw, _ = recording(seed=6, positions=8)
    text = what_is_missing(find_intervals(raw, 0.01), 9)
    assert text.startswith("8 rests of 1 s or more found in 46 s, expected 9 at least, better 18")
    raw, _ = recording(seed=6, positions=12, rest_s=1.2)
    text = what_is_missing(find_intervals(raw, 0.01), 9)
    assert "12 more are too short: hold each position still for 3 s or more" in text
    still = np.random.default_rng(7).standard_normal((6000, 3))
    text = what_is_missing(find_intervals(still, 0.01), 9)
    assert "turn it to more positions" in text
    raw, _ = recording(seed=8)
    assert what_is_missing(find_intervals(raw, 0.01), 9) == ""


def test_other_channels_have_means_too():
    raw, _ = recording(seed=9)
    found = find_intervals(raw, 0.01)
    np.testing.assert_allclose(found.means_of(raw), found.means, rtol=1e-12)


@pytest.mark.parametrize("rows", [slice(0, 400), slice(0, 0)])
def test_a_recording_too_short_is_refused(rows):
    raw, _ = recording(seed=1)
    with pytest.raises(InputError, match="expected ten windows"):
        find_intervals(raw[rows], 0.01)


def test_a_nan_is_named_with_its_row():
    raw, _ = recording(seed=1)
    raw[77, 1] = np.nan
    with pytest.raises(InputError, match="row 78: expected finite numbers"):
        find_intervals(raw, 0.01)
