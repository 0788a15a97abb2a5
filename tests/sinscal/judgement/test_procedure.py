"""Contradictions between a calibration and what the sidecar says are told by name."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from errormodel.errors import InputError
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import Site
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.recording.join import join_rig_runs
from tests.sinscal.twin import make_twin

QUICK = Options(hold_out="none")


def names_of(warnings: tuple[str, ...]) -> set[str]:
    return {w.partition(":")[0] for w in warnings}


def test_a_right_run_passes_without_a_warning() -> None:
    judged = calibrate_and_judge(make_twin(1).run, Options())
    assert judged.passed
    assert judged.warnings == ()
    (held,) = judged.consistency.held_out
    assert held.cycle == 2
    assert held.after_m_s2 < held.before_m_s2


def test_any_cycle_can_be_held_out_or_each_in_turn() -> None:
    run = make_twin(1).run
    each = calibrate_and_judge(run, Options(hold_out="each")).consistency
    assert [held.cycle for held in each.held_out] == [0, 1, 2]
    assert each.repeats
    (first,) = calibrate_and_judge(run, Options(hold_out=1)).consistency.held_out
    assert first == each.held_out[0]
    for wrong in (0, 4):
        with pytest.raises(InputError, match="expected 1 to 3"):
            calibrate_and_judge(run, Options(hold_out=wrong))


def test_the_cycle_that_disagrees_is_named_whichever_it_is() -> None:
    run = make_twin(1).run
    gyro = np.array(run.gyro)
    gyro[run.cycles[0], 1] += 10 * np.deg2rad(0.5) / 3600  # ten sigmas of the bias beforehand
    found = calibrate_and_judge(replace(run, gyro=gyro), Options(hold_out="each"))
    assert not found.consistency.repeats
    least = min(found.consistency.held_out, key=lambda held: held.shift.p_value)
    assert f"cycle {least.cycle + 1} does not agree" in " ".join(found.warnings)


def test_a_wrong_azimuth_is_named_and_not_used() -> None:
    twin = make_twin(1)
    wrong = replace(twin.run.facts, azimuth_rad=np.deg2rad(35.0 + 90.0))
    judged = calibrate_and_judge(replace(twin.run, facts=wrong), QUICK)
    assert "azimuth_contradiction" in names_of(judged.warnings)
    assert twin.chi2(judged) < chi2.isf(0.001, 21)


def test_an_azimuth_without_the_axis_it_belongs_to_is_not_used() -> None:
    twin = make_twin(1)
    facts = replace(twin.run.facts, axis_of_cycle=None)
    judged = calibrate_and_judge(replace(twin.run, facts=facts), QUICK)
    assert "azimuth_not_used" in names_of(judged.warnings)
    assert twin.chi2(judged) < chi2.isf(0.001, 21)


@pytest.mark.parametrize("factor", [3.0, 1 / 3.0])
def test_noise_that_is_not_as_stated_is_named(factor: float) -> None:
    run = make_twin(1).run
    assert run.facts.accel_noise is not None
    facts = replace(run.facts, accel_noise=factor * run.facts.accel_noise)
    judged = calibrate_and_judge(replace(run, facts=facts), QUICK)
    assert "noise_contradiction" in names_of(judged.warnings)
    assert not judged.passed


@pytest.mark.parametrize("factor", [1.25, 0.8])
def test_noise_that_is_stated_a_little_wrong_is_measured(factor: float) -> None:
    run = make_twin(1, cycle_s=400.0).run
    accel, gyro = run.facts.accel_noise, run.facts.gyro_noise
    assert accel is not None
    assert gyro is not None
    facts = replace(run.facts, accel_noise=factor * accel, gyro_noise=factor * gyro)
    judged = calibrate_and_judge(replace(run, facts=facts), Options())
    assert judged.passed
    assert names_of(judged.warnings) == {"noise_misstated"}
    told = re.findall(r"(\w+) noise is ([\d.]+) times what is stated", " ".join(judged.warnings))
    assert [sensor for sensor, _ in told] == ["gyro", "accelerometer"]
    assert all(abs(float(found) * factor - 1.0) < 0.08 for _, found in told)
    # third differences know a density to some 2 %
    assert isinstance(judged.found.noise, RigNoise)
    assert abs(judged.found.noise.accel / accel - 1.0) < 0.06
    assert abs(judged.found.noise.gyro / gyro - 1.0) < 0.08


def test_a_latitude_that_is_not_the_rig_s_does_not_pass_unseen() -> None:
    run = make_twin(1, cycle_s=400.0).run
    facts = replace(run.facts, site=Site(lat_rad=np.deg2rad(10.0), height_m=150.0))
    judged = calibrate_and_judge(replace(run, facts=facts), QUICK)
    assert not judged.passed


def test_gyros_that_do_not_feel_the_earth_find_no_north() -> None:
    run = make_twin(1, cycle_s=40.0).run
    facts = replace(run.facts, gyro_noise=1e-4, azimuth_rad=None)
    noisy = run.gyro + 1e-4 * np.sqrt(50.0) * np.random.default_rng(0).standard_normal(
        run.gyro.shape
    )
    with pytest.raises(InputError, match="find north only to"):
        calibrate_and_judge(replace(run, gyro=noisy, facts=facts), QUICK)


def test_temperatures_are_needed_by_what_depends_on_them() -> None:
    with pytest.raises(InputError, match="temp_c"):
        calibrate_and_judge(make_twin(1).run, Options(groups=("accel_temperature_bias",)))


def test_runs_joined_are_worth_what_one_run_is() -> None:
    whole = make_twin(1).run
    parts = [whole.take_cycles([0]), whole.take_cycles([1, 2])]
    joined = join_rig_runs(parts)
    assert joined.facts == whole.facts
    np.testing.assert_array_equal(joined.gyro, whole.gyro)
    np.testing.assert_array_equal(joined.cycle, whole.cycle)
    with pytest.raises(InputError, match="differs"):
        join_rig_runs([parts[0], replace(parts[1], facts=replace(whole.facts, accel_noise=2e-3))])
