"""The rig generator is right by closed forms and by an attitude computed in another way."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.blind.rig.motion import (
    EARTH_RATE,
    Rig,
    attitude_at_zero,
    integrate,
    matrix_of,
    move,
    normal_gravity,
    rotation,
)
from benchmarks.blind.rig.setup import EFFECTS, Setup, multirate
from benchmarks.blind.rig.truth import write_rig_run

SHORT = ((0.0, 5.0), (10.0, 20.0), (-10.0, 15.0))
LATITUDE = np.deg2rad(Rig().latitude_deg)
QUIET = {
    "gyro_noise_deg_h": 0.0,
    "accel_noise": 0.0,
    "angle_noise_arcsec": 0.0,
    "gyro_quantum": 1e-13,
    "accel_quantum": 1e-13,
    "scale_of_priors": 0.0,
}


def setup(**changed) -> Setup:
    return Setup(**{"programme": SHORT, "angles": True, **QUIET, **changed})


def recorded(path: Path, values=None, **changed) -> pd.DataFrame:
    write_rig_run(path / "r.csv", seed=1, setup=setup(**changed), values=values)
    return pd.read_csv(path / "r.csv")


def added(path: Path, values, **changed) -> pd.DataFrame:
    """Return what a parameter adds to each reading."""
    return recorded(path, values, **changed) - recorded(path, None, **changed)


def test_gravity_is_that_of_the_standard() -> None:
    # WGS 84 defines the values at the equator and the pole (NIMA TR8350.2, table 3.4)
    assert normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert normal_gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849379, abs=1e-8)


def test_many_small_turns_are_one_large_one() -> None:
    turns = np.random.default_rng(3).normal(scale=0.01, size=(1237, 3))
    expected = Rotation.identity()
    for v in turns:
        expected = expected * Rotation.from_rotvec(v)
    np.testing.assert_allclose(matrix_of(integrate(turns)[-1]), expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_start_is_as_said_and_righthanded(axis: int) -> None:
    c_nb = attitude_at_zero(Rig(tilt_arcmin=0.0, azimuth_deg=90.0), axis)
    assert np.linalg.det(c_nb) == pytest.approx(1.0)
    np.testing.assert_allclose(c_nb[:, axis], [1.0, 0.0, 0.0], atol=1e-15)  # east
    np.testing.assert_allclose(c_nb[:, (axis + 2) % 3], [0.0, 0.0, 1.0], atol=1e-15)


def test_the_rotation_axis_stands_still_in_a_turned_sins() -> None:
    mount = np.array([0.01, -0.02, 0.005])
    motion = move(Rig(ripple=0.0, wobble_arcsec=0.0), 0, SHORT, mount)
    # 10 s into a constant rate; e − mount × e to first order
    expected = np.deg2rad(10.0) * (np.eye(3)[0] - np.cross(mount, np.eye(3)[0]))
    np.testing.assert_allclose(motion.omega_eb[15000], expected, atol=np.deg2rad(10) * 5e-4)


def test_the_gyros_alone_lead_from_gravity_to_gravity(tmp_path: Path) -> None:
    """Attitude by scipy's rotations from the recorded rates, in inertial space."""
    frame = recorded(tmp_path, axes="x", period_s=0.01)
    rates, forces = frame[["gyro_x", "gyro_y", "gyro_z"]], frame[["accel_x", "accel_y", "accel_z"]]
    dt, g = 0.01, normal_gravity(LATITUDE, Rig().height_m)
    earth = EARTH_RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    at = Rotation.from_matrix(rotation([0.0, 0.0, 0.0]) @ attitude_at_zero(Rig(), 0))
    miss = []
    for k, (w, f) in enumerate(zip(rates.to_numpy(), forces.to_numpy(), strict=True)):
        middle = at * Rotation.from_rotvec(0.5 * dt * w)
        turned = Rotation.from_rotvec(earth * dt * (k + 0.5))  # the earth, since the start
        miss.append(np.abs(turned.inv().apply(middle.apply(f)) - [0, 0, g]).max())
        at = at * Rotation.from_rotvec(dt * w)
    # While the rate changes by 0.35 rad/s², the middle of a reading's turn is not its mean:
    # 0.35 Δt²/12 = 2.9e-6 rad of g. Else a force averaged over 1.7e-3 rad is short by 1.3e-7, and
    # the ripple (2e-4 of the rate, 36 a turn) shifts the middle by 1e-7 rad.
    assert max(miss) < 3.2e-5
    assert np.median(miss) < 3e-6


def test_at_rest_the_gyros_see_the_earth_and_its_latitude(tmp_path: Path) -> None:
    first = recorded(tmp_path, axes="y").iloc[10:200].mean()
    w, f = (first[[f"{kind}_{a}" for a in "xyz"]].to_numpy() for kind in ("gyro", "accel"))
    assert np.linalg.norm(w) == pytest.approx(EARTH_RATE, rel=1e-6)
    sine = w @ f / np.linalg.norm(w) / np.linalg.norm(f)
    assert sine == pytest.approx(np.sin(LATITUDE), abs=1e-6)


def test_a_lever_arm_is_felt_as_the_pull_towards_the_axis(tmp_path: Path) -> None:
    more = added(tmp_path, {"lever_arm_y_y": 0.1, "lever_arm_z_x": 0.2}, axes="x")
    steady = more.iloc[500:1000]
    w = np.deg2rad(10.0)
    # ripple of the rate 2e-4: its square enters, and its derivative times 36 w²
    assert steady["accel_y"].mean() == pytest.approx(-(w**2) * 0.1, rel=1e-3)
    assert abs(steady["accel_z"].mean()) < 1e-6  # along the axis a lever arm is not felt
    assert abs(steady["accel_x"].mean()) < 1e-9


@pytest.mark.parametrize(
    ("name", "value", "column", "size"),
    [
        ("gyro_bias_x", 1e-5, "gyro_x", lambda r: 1.0),
        ("gyro_scale_x", 1e-3, "gyro_x", lambda r: r["gyro_x"]),
        ("gyro_misalignment_yx", 1e-3, "gyro_y", lambda r: r["gyro_x"]),
        ("gyro_g_sensitivity_zy", 1e-6, "gyro_z", lambda r: r["accel_y"]),
        ("gyro_scale_asymmetry_x", 1e-4, "gyro_x", lambda r: r["gyro_x"].abs()),
        ("accel_bias_z", 0.01, "accel_z", lambda r: 1.0),
        ("accel_scale_y", 1e-3, "accel_y", lambda r: r["accel_y"]),
        ("accel_misalignment_zy", 1e-3, "accel_z", lambda r: r["accel_y"]),
        ("accel_second_order_y", 1e-5, "accel_y", lambda r: r["accel_y"] ** 2),
        ("accel_temperature_bias_x", 1e-4, "accel_x", lambda r: r["temp_x_c"] - 25),
        (
            "accel_temperature_scale_y",
            1e-4,
            "accel_y",
            lambda r: (r["temp_y_c"] - 25) * r["accel_y"],
        ),
        ("gyro_temperature_drift_z", 1e-8, "gyro_z", lambda r: r["temp_z_c"] - 25),
        ("gyro_bias_step_x", 1e-5, "gyro_x", lambda r: 1.0),
        ("accel_bias_step_y", 1e-3, "accel_y", lambda r: 1.0),
    ],
)
def test_every_parameter_adds_what_the_contract_says(
    tmp_path: Path, name, value, column, size
) -> None:
    warm = {"axes": "x", "warm_up_c": 30.0, "warm_up_s": 20.0, "temp_per_axis": True}
    plain = recorded(tmp_path, None, **warm)
    more = recorded(tmp_path, {name: value}, **warm) - plain
    expected = value * size(plain)
    scale = float(np.max(np.abs(expected)))
    # the thermometers are read to 5 mK, the force turns within a reading
    np.testing.assert_allclose(more[column], expected, atol=3e-3 * scale + 1e-12)
    assert np.abs(more.drop(columns=column)).to_numpy().max() < 1e-9


def test_a_step_begins_at_its_time(tmp_path: Path) -> None:
    more = added(tmp_path, {"gyro_bias_step_x": 1e-5, "gyro_bias_step_at_s": 12.0}, axes="x")
    time_s = recorded(tmp_path, axes="x")["time_s"]
    assert (more["gyro_x"][time_s <= 12.0].abs() < 1e-10).all()
    np.testing.assert_allclose(more["gyro_x"][time_s > 12.0], 1e-5, rtol=1e-4)


def test_a_late_clock_and_a_harmonic_move_the_angle(tmp_path: Path) -> None:
    plain = recorded(tmp_path, axes="x")
    steady = slice(500, 1000)
    late = recorded(tmp_path, {"rig_time_offset": 0.05}, axes="x") - plain
    assert late["rig_angle_rad"][steady].mean() == pytest.approx(np.deg2rad(10) * 0.05, rel=1e-3)
    wavy = recorded(tmp_path, {"rig_angle_harmonic_sin2": 1e-3}, axes="x") - plain
    expected = 1e-3 * np.sin(2 * plain["rig_angle_rad"])
    np.testing.assert_allclose(wavy["rig_angle_rad"], expected, atol=1e-9)


def test_noise_and_counts_are_as_stated(tmp_path: Path) -> None:
    set_up = setup(accel_noise=1e-3, gyro_noise_deg_h=0.1, gyro_quantum=2e-8, accel_quantum=1e-5)
    quiet = recorded(tmp_path)
    write_rig_run(tmp_path / "n.csv", seed=1, setup=set_up)
    noise = pd.read_csv(tmp_path / "n.csv") - quiet
    seconds = noise.groupby(np.arange(len(noise)) // 50).mean()  # of 1 s each: the stated sigmas
    assert len(seconds) == 120
    # σ of a σ from 360 values is 3.7 %: four of them; a count adds less than 1 %
    accel = seconds[["accel_x", "accel_y", "accel_z"]].to_numpy().std()
    gyro = seconds[["gyro_x", "gyro_y", "gyro_z"]].to_numpy().std()
    assert accel == pytest.approx(1e-3, rel=0.15)
    assert gyro == pytest.approx(np.deg2rad(0.1) / 3600, rel=0.15)


def test_rates_and_increments_are_the_same_run(tmp_path: Path) -> None:
    write_rig_run(tmp_path / "i.csv", seed=1, setup=setup(increments=True))
    steps, rates = pd.read_csv(tmp_path / "i.csv"), recorded(tmp_path)
    np.testing.assert_allclose(steps["dtheta_x"] / 0.02, rates["gyro_x"], atol=1e-9)
    np.testing.assert_allclose(steps["dv_z"] / 0.02, rates["accel_z"], atol=1e-8)


def test_an_effect_that_cannot_show_is_a_mistake(tmp_path: Path) -> None:
    cold = Setup(programme=SHORT, angles=False)
    for name in ("accel_temperature_bias", "rig_time_offset"):
        with pytest.raises(ValueError, match=f"{name} needs"):
            write_rig_run(tmp_path / "r.csv", seed=1, setup=cold, effects=[name])
    assert not (tmp_path / "r.csv").exists()


def test_all_rig_effects_of_the_contract_can_be_hidden(tmp_path: Path) -> None:
    set_up = setup(programme=tuple(multirate(0.2)), warm_up_c=20.0)
    for name in EFFECTS:
        key = write_rig_run(tmp_path / "r.csv", seed=1, setup=set_up, effects=[name])
        assert key["effects"] == [name]
        assert set(EFFECTS[name]) <= set(key["parameters"])  # type: ignore[arg-type]
    assert len(EFFECTS) == 13
