"""Faults of a recording are told by name; what is sound is left alone."""

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest

from errormodel.errors import InputError
from sinscal.library import BASIC
from sinscal.model.sensors import sensor_model
from sinscal.recording.axis_faults import fault_names, permutation_of
from sinscal.recording.check import checked_rig
from sinscal.recording.files import read_rig_run, write_rig_run
from sinscal.recording.gravity_map import gravity_map
from sinscal.recording.run import RigRun
from sinscal.twin.motion import RigFaults, rig_motion
from sinscal.twin.programme import Programme
from sinscal.twin.simulate import SensorNoise, simulate_rig
from tests.sinscal.rig_example import rig_run

# a poor MEMS unit: 0.7 °/√min of gyro, 0.3 mg/√Hz, biases of 1–2 °/s and 30 mg, 1 mg steps
MEMS = {
    "gyro_noise": 2e-4,
    "accel_noise": 3e-3,
    "accel_bias": (0.3, -0.2, 0.1),
    "gyro_bias": (0.02, -0.03, 0.01),
    "quantum": 0.01,
}


@pytest.fixture(scope="module", params=["precise", "MEMS, 2 °/s"])
def sound(request: pytest.FixtureRequest) -> RigRun:
    return rig_run() if request.param == "precise" else rig_run(rate_deg_s=2.0, **MEMS)


@pytest.mark.parametrize("rate_deg_s", [2.0, 10.0, 40.0])
@pytest.mark.parametrize("unit", [{}, MEMS], ids=["precise", "MEMS"])
def test_sound_recordings_are_left_alone(rate_deg_s, unit):
    """Lever arms of 10 cm, reversals, rest at the start, any rate, at 50 Hz."""
    for seed in range(3):
        run = rig_run(rate_deg_s=rate_deg_s, lever_m=0.1, step_s=0.02, seed=seed, **unit)
        done = checked_rig(run)
        assert done.warnings == ()
        assert not np.any(done.flag)


@pytest.mark.parametrize("axes", ["x", "y", "z"])
def test_one_cycle_alone_is_left_alone(axes):
    assert checked_rig(rig_run(axes=axes)).warnings == ()


@pytest.mark.parametrize("noise", [1e-3, 1e-5])
def test_dwells_do_not_hide_the_turns_between_them(noise):
    """Positions a quarter turn apart, lever arms of 6 cm, down to navigation-grade noise."""
    dwell = {"rate_deg_s": 0.0, "duration_s": 30.0}
    turns = [{"rate_deg_s": s * 10.0, "duration_s": 9.0} for s in (1, 1, 1, -1, -1, -1)]
    segments = [part for turn in turns for part in (dwell, turn)]
    programme = Programme.model_validate(
        {
            "cycles": [{"axis": a, "segments": segments} for a in "xyz"],
            "acceleration_deg_s2": 20.0,
            "azimuth_deg": 35.0,
        }
    )
    values = {f"lever_arm_{a}_{b}": 0.06 for a in "xyz" for b in "xyz"}
    run = simulate_rig(
        rig_motion(programme, 50.0, RigFaults()), sensor_model((*BASIC, "lever_arm")), values,
        SensorNoise(gyro=1e-7, accel=noise), np.random.default_rng(1),
    )  # fmt: skip
    assert checked_rig(run).warnings == ()
    found = gravity_map(run)
    assert found is not None
    assert found.known == (True, True, True)


def test_what_cannot_be_checked_is_said():
    (warning,) = checked_rig(rig_run(rate_deg_s=0.0)).warnings
    assert warning.startswith("axes_not_checked: ")


def test_the_map_is_the_identity_within_its_sigmas():
    """They are upper bounds: χ² of nine entries stays below its mean, over 20 seeds."""
    total = 0.0
    for seed in range(20):
        found = gravity_map(rig_run(rate_deg_s=2.0, gyro_noise=1e-6, seed=seed))
        assert found is not None
        assert found.known == (True, True, True)
        total += float(np.sum(((found.matrix - np.eye(3)) / found.sigma) ** 2))
    assert 0.01 < total / 180 < 1.0


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda r: {"gyro": np.rad2deg(r.gyro)}, "they are in °/s, expected rad/s"),
        (lambda r: {"gyro": r.gyro * 0.01}, "they are increments over a step"),
        (lambda r: {"gyro": r.gyro / 0.01}, "they are rates, expected increments"),
        (lambda r: {"gyro": np.rad2deg(r.gyro) * 3600}, "they are in °/h"),
        (
            lambda r: {"time_s": r.time_s * 1e3, "step_s": r.step_s * 1e3},
            "are they in ms",
        ),
        (lambda r: {"accel": r.accel / 9.80665}, "it is in g, expected m/s²"),
        (lambda r: {"accel": r.accel / 9.80665e-3}, "it is in mg, expected m/s²"),
        (lambda r: {"accel": r.accel * 0.01}, "it is an increment over a step"),
        (lambda r: {"accel": r.accel / 0.01}, "it is a force, expected increments"),
        (lambda r: {"gyro": r.gyro[:, [1, 0, 2]]}, "simplest explanation: gyro axes x, y swapped"),
        (lambda r: {"gyro": r.gyro * [1, 1, -1]}, "simplest explanation: gyro z reversed"),
        (lambda r: {"gyro": -r.gyro}, "simplest explanation: all gyros reversed"),
        (lambda r: {"accel": r.accel[:, [0, 2, 1]]}, "accelerometer axes y, z swapped"),
        (lambda r: {"accel": r.accel * [1, -1, 1]}, "accelerometer y reversed"),
        (
            lambda r: {"accel": r.accel[:, [1, 2, 0]]},
            "gyro axes x, y, z swapped, or accelerometer axes x, y, z swapped",
        ),
        (
            lambda r: {"facts": replace(r.facts, axis_of_cycle=("x", "z", "y"))},
            "cycle 1: axis_of_cycle names z, but the gyros turn about y",
        ),
        (
            lambda r: {"rig_angle_rad": np.mod(np.rad2deg(r.rig_angle_rad), 360)},
            "rig_angle_rad: is in degrees",
        ),
        (lambda r: {"rig_angle_rad": -r.rig_angle_rad}, "rig_angle_rad: is reversed"),
        (lambda r: {"rig_angle_rad": 0 * r.rig_angle_rad}, "rig_angle_rad: stands still"),
        (lambda r: {"rig_angle_rad": 0.5 * r.rig_angle_rad}, "rig_angle_rad: does not fit"),
    ],
)
def test_what_makes_every_result_wrong_is_an_error_that_names_it(sound, spoil, words):
    with pytest.raises(InputError) as caught:
        checked_rig(replace(sound, **spoil(sound)))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_angle_that_turns_over_is_sound(sound):
    turned = replace(sound, rig_angle_rad=np.mod(sound.rig_angle_rad, 2 * np.pi))
    assert checked_rig(turned).warnings == ()


def test_a_force_that_points_down_is_told_by_the_earth():
    (warning,) = checked_rig(replace(rig_run(), accel=-rig_run().accel)).warnings
    assert warning.startswith("reversed_force: ")


@pytest.mark.parametrize(
    ("spoil", "name"),
    [
        (lambda r: {"gyro": r.gyro * [0, 1, 1]}, "gravity_unexplained"),
        (lambda r: {"gyro": r.gyro * 1.1}, "gravity_map"),
        (lambda r: {"accel": r.accel * 1.05}, "force_off"),
        (lambda r: {"rig_angle_rad": 1.05 * r.rig_angle_rad}, "rig_angle_off"),
    ],
)
def test_what_may_be_a_poor_sensor_is_a_named_warning(sound, spoil, name):
    done = checked_rig(replace(sound, **spoil(sound)))
    assert name in {w.split(":")[0] for w in done.warnings}


def test_an_angle_that_stands_still_for_a_while_is_told():
    run = rig_run()
    angle = np.array(run.rig_angle_rad)
    angle[3000:3500] = angle[3000]
    (warning,) = checked_rig(replace(run, rig_angle_rad=angle)).warnings
    assert warning.startswith("rig_angle_stuck: the angle stands still in 4")


def test_shocks_and_saturation_are_flagged_and_logged(sound):
    accel, gyro = np.array(sound.accel), np.array(sound.gyro)
    accel[5000:5005] += [3.0, 0.0, 0.0]
    gyro[9000] += 1.0  # a glitch of one sample
    accel[20_000:20_006, 1] = 19.6  # the end of the range
    done = checked_rig(replace(sound, accel=accel, gyro=gyro))
    names = {w.split(":")[0] for w in done.warnings}
    assert names == {"shock", "saturated"}
    flagged = np.flatnonzero(np.asarray(done.flag))
    wanted = [*range(5000, 5005), 9000, *range(20_000, 20_006)]
    assert set(wanted) <= set(flagged.tolist())
    assert flagged.size < 80  # 50 ms about each
    shock = next(w for w in done.warnings if w.startswith("shock"))
    assert f"{sound.time_s[4995]:.6g} s of cycle 0" in shock


def test_each_single_fault_has_its_name():
    """Any swap or sign of one triad, through the map that it makes."""
    signs = [np.diag(s) for s in itertools.product((1.0, -1.0), repeat=3)]
    for order in ([0, 1, 2], [1, 0, 2], [2, 1, 0], [0, 2, 1]):
        for sign in signs[1:4]:
            q = sign @ np.eye(3)[order]
            made = permutation_of(q.T, (True, True, True))
            assert made is not None
            assert all("reversed" in n or "swapped" in n for n in fault_names(made, (True,) * 3))
    assert fault_names(np.eye(3), (True,) * 3) == [""]
    assert permutation_of(np.full((3, 3), 0.577), (True,) * 3) is None


def test_the_reader_checks(tmp_path):
    run = rig_run()
    path = tmp_path / "rig.csv"
    write_rig_run(replace(run, gyro=np.rad2deg(run.gyro)), path)
    with pytest.raises(InputError, match=r"rig\.csv: gyro: .* they are in °/s"):
        read_rig_run(path)
    write_rig_run(run, path, increments=True)
    assert read_rig_run(path).warnings == ()


def test_checks_are_quick():
    run = rig_run(cycle_s=900.0)
    began = time.process_time()
    checked_rig(run)
    assert time.process_time() - began < 10.0  # one second when the machine is free


def test_readings_that_never_change_are_only_not_checked():
    """A coarse sensor at rest: no noise at all is no reason to fail."""
    run = rig_run(rate_deg_s=0.0)
    still = replace(
        run, gyro=np.zeros_like(run.gyro), accel=np.tile([0.0, 0.0, 9.8], (len(run), 1))
    )
    (warning,) = checked_rig(still).warnings
    assert warning.startswith("axes_not_checked: ")


@pytest.mark.parametrize("rate_deg_s", [0.0, 20.0], ids=["at rest", "about the vertical"])
def test_readings_without_noise_that_never_change_tell_nothing_of_the_gyros(rate_deg_s):
    rows = 3000
    rate = np.array([3e-5, 4e-5, 6e-5 + np.deg2rad(rate_deg_s)])
    run = replace(
        rig_run(),
        time_s=np.arange(1, rows + 1) / 50.0,
        step_s=np.full(rows, 0.02),
        cycle=np.zeros(rows, dtype=np.intp),
        gyro=np.tile(rate, (rows, 1)),
        accel=np.tile([0.1, 0.2, 9.81], (rows, 1)),
        rig_angle_rad=None,
        temp_c=None,
        flag=np.zeros(rows, dtype=np.bool_),
    )
    found = gravity_map(run)
    assert found is not None
    # constant gravity fixes one column, that of the axis turned about; of the rest it tells nothing
    assert found.known[0] is found.known[1] is False
    assert found.unexplained == 0.0
