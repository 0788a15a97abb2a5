"""What a calibration's model lacks is found in its innovations, or bounded by protection levels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ncx2

from sinscal.calibration.effect_tests import FALSE_ALARM
from sinscal.discrepancy.find import find_rig_discrepancy
from sinscal.frames.earth import DEG_PER_H
from sinscal.judgement.judge import Judged
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.judgement.protection import COVERED_SIGMAS, MISSED, noncentrality, unseen_errors
from sinscal.judgement.result_file import checked_result, make_result
from sinscal.library import BASIC, rig_library
from sinscal.model.compensate import compensate_run
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigRun
from sinscal.sensitivity.views import EffectView
from sinscal.twin.motion import RigFaults, rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import simulate_rig
from tests.sinscal.twin import NOISE, SIX_RATES, make_twin

G = 9.80665
# What passed every test once: each is worth 5 to 29 sigmas of some parameter.
SILENT = {
    "gyro_g_sensitivity": {"gyro_g_sensitivity_xy": 0.2 * DEG_PER_H / G},
    "gyro_scale_asymmetry": {"gyro_scale_asymmetry_y": 5e-6},
    "accel_second_order": {"accel_second_order_z": 50e-6 / G},
    "lever_arm": {"lever_arm_x_x": 0.01, "lever_arm_y_z": -0.01},
    "accel_delay": {f"accel_delay_{a}": 1e-3 for a in "xyz"},
}


def recorded(values: dict[str, float], groups: tuple[str, ...] = (), seed: int = 3) -> RigRun:
    """Return a run of three cycles of ten minutes at six speeds with some errors."""
    programme = there_and_back(SIX_RATES, 600.0, "xyz", acceleration_deg_s2=10.0, azimuth_deg=35.0)
    rng = np.random.default_rng(seed)
    return simulate_rig(
        rig_motion(programme, 20.0, RigFaults()), sensor_model((*BASIC, *groups)), values, NOISE,
        rng, with_angle=True,
    )  # fmt: skip


def missing(judged: Judged) -> list[str]:
    assert judged.consistency.effects is not None
    return [t.name for t in judged.consistency.effects.missing]


@pytest.mark.parametrize(
    "name",
    [
        "lever_arm",
        *(pytest.param(n, marks=pytest.mark.slow) for n in SILENT if n != "lever_arm"),
    ],
)
def test_an_effect_that_the_model_lacks_does_not_pass_in_silence(name: str) -> None:
    run = recorded(SILENT[name], (name,))
    without = calibrate_and_judge(run, Options(mode="precise", hold_out="none"))
    assert missing(without)[0] == name
    assert not without.passed
    assert any(w.startswith(f"effect_missing: {name} ") for w in without.warnings)
    having = calibrate_and_judge(run, Options(mode="precise", hold_out="none", groups=(name,)))
    assert missing(having) == []
    for parameter, true in SILENT[name].items():
        apart = abs(having.found.value(parameter) - true)
        assert apart < 4.0 * having.found.sigma(parameter)


def test_a_sound_run_lacks_nothing_and_its_errors_are_within_the_levels() -> None:
    twin = make_twin(2, angle=True)
    judged = calibrate_and_judge(twin.run, Options(mode="precise"))
    assert judged.passed
    assert missing(judged) == []
    assert judged.protection is not None
    for name, error in zip(judged.found.names, twin.errors(judged), strict=True):
        level = judged.protection[name]
        assert level.covariance == pytest.approx(COVERED_SIGMAS * judged.found.sigma(name))
        assert abs(error) < level.total
        assert level.total == pytest.approx(level.covariance + max(level.effects.values()))


def view_of(strengths: list[float], errors: list[list[float]]) -> EffectView:
    k = len(strengths)
    return EffectView(
        effect=rig_library().by_name["lever_arm"], names=("lever_arm_x_x",) * k, theta=(),
        strengths=np.array(strengths), scores=np.zeros(k), errors=np.array(errors), axes=np.eye(k),
    )  # fmt: skip


def test_the_level_of_an_effect_is_its_slope_times_what_the_test_finds() -> None:
    alarm = FALSE_ALARM / 10.0
    found_at = noncentrality(1, alarm)
    limit = ncx2.ppf(MISSED, 1, found_at)
    assert ncx2.sf(limit, 1, found_at) == pytest.approx(1.0 - MISSED)
    strong = unseen_errors(view_of([1e6], [[2.0]]), alarm, 1.0)
    assert strong[0] == pytest.approx(2.0 * np.sqrt(found_at / 1e6), rel=1e-4)
    # noise twice as large hides an effect √2 larger
    noisy = unseen_errors(view_of([1e6], [[2.0]]), alarm, 2.0)
    assert noisy[0] == pytest.approx(np.sqrt(2.0) * strong[0], rel=1e-4)


def test_an_effect_that_does_not_show_is_bounded_by_what_is_expected_of_it() -> None:
    unseen = unseen_errors(view_of([0.0], [[2.0]]), 1e-3, 1.0)
    assert unseen[0] == pytest.approx(2.0 * COVERED_SIGMAS)
    # one direction shows well, the other not at all: the worst mixture is less than both added
    both = unseen_errors(view_of([0.0, 1e4], [[2.0, 30.0]]), 1e-3, 1.0)[0]
    alone = 30.0 * np.sqrt(noncentrality(1, 1e-3) / 1e4)
    # a bound, for the weights tried are so many that it is wide by less than a hundredth
    assert max(alone, 2.0 * COVERED_SIGMAS) < both < 1.01 * (alone + 2.0 * COVERED_SIGMAS)


def walking(run: RigRun, size: float, seed: int = 0) -> RigRun:
    """Return a run whose accelerometers' constant errors walk, zero in the mean."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal(run.accel.shape), axis=0)
    walk -= walk.mean(axis=0)
    return replace(run, accel=run.accel + size * walk / walk.std(axis=0))


def test_a_walk_is_estimated_and_carried_by_the_sigmas() -> None:
    twin = make_twin(4, rates=SIX_RATES, cycle_s=400.0)
    run = walking(twin.run, 1e-3)
    judged = calibrate_and_judge(run, Options())
    found = [(d.kind, d.family, d.shown) for d in judged.drifts]
    assert found == [("accel", "walk", True), ("gyro", "walk", False)]
    assert judged.passed
    errors = twin.errors(judged) / judged.found.sigmas
    assert np.sqrt(np.mean(errors**2)) < 1.5  # 21 of them, two or three times as many without it
    plain = calibrate_and_judge(run, Options(accel_instability=1e-9))
    assert not plain.passed
    told = [w.partition(":")[0] for w in judged.warnings]
    assert "drift_estimated" in told
    assert "drift_allowed" in told


def test_an_even_drift_is_a_term_of_the_result_and_taken_out_with_it() -> None:
    twin = make_twin(5, rates=SIX_RATES, cycle_s=400.0)
    began = np.array(twin.run.begin_of_cycle_s)[twin.run.cycle]
    first = np.array([twin.run.time_s[rows][0] for rows in twin.run.cycles])[twin.run.cycle]
    elapsed_s = began + twin.run.time_s - first
    rise = 3e-3 * (elapsed_s / elapsed_s.max() - 0.5)
    run = replace(twin.run, accel=twin.run.accel + rise[:, None] * [1.0, -1.0, 0.5])
    judged = calibrate_and_judge(run, Options())
    assert judged.passed
    (drift,) = judged.drifts
    assert drift.kind == "accel"
    result = make_result(judged, run)
    again = checked_result(result.model_dump(mode="json"), type(result), "r.json")
    assert again.drifts == judged.terms
    if drift.family != "walk":
        got = judged.found.value("accel_bias_drift_x")
        assert abs(got - 3e-3) < 5.0 * judged.found.sigma("accel_bias_drift_x")
        done = compensate_run(run, again.sensors, again.values)
        left = np.linalg.norm(done.accel, axis=1) - run.facts.site.gravity_m_s2
        slow = [abs(left[rows].mean()) for rows in run.cycles]
        assert max(slow) < 1e-4  # a thirtieth of the drift


@pytest.mark.slow
def test_a_walk_has_no_bare_name_of_something_else() -> None:
    run = walking(make_twin(4, rates=SIX_RATES, cycle_s=300.0).run, 1.5e-3)
    d = find_rig_discrepancy(run, draws=200)
    assert d.drift is not None
    assert (d.drift.kind, d.drift.family) == ("accel", "walk")
    assert d.verdict != "named"
    for names in d.alias_sets:
        assert "accel_bias_drift" in names


@pytest.mark.parametrize(
    "warning", ["reversed_force: the earth's rotation …", "azimuth_contradiction: the gyros …"]
)
def test_a_contradiction_never_passes(warning: str) -> None:
    run = make_twin(1).run
    judged = calibrate_and_judge(replace(run, warnings=(warning,)), Options(hold_out="none"))
    assert judged.consistency.tests["no_contradiction"] is False
    assert not judged.passed
