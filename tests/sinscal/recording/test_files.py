import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.errors import InputError
from sinscal.frames.attitude import c_nb_from_angles
from sinscal.frames.earth import Site
from sinscal.recording.files import read_nav_run, read_rig_run, write_nav_run, write_rig_run
from sinscal.recording.run import NavRun, RigFacts, RigRun

SIDECAR = "latitude_deg = 55.75\nheight_m = 150.0\n"
SITE = Site(lat_rad=float(np.deg2rad(55.75)), height_m=150.0)
HEADER = "time_s,cycle,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"
NAV = "time_s,cycle,lat_deg,lon_deg,height_m,ve_m_s,vn_m_s,vu_m_s,roll_deg,pitch_deg,heading_deg\n"


def put(folder: Path, text: str, sidecar: str = SIDECAR) -> Path:
    path = folder / "rig.csv"
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
    return path


def rows(times: list[float], cycle: int = 0, gyro: str = "0.1,0,0") -> str:
    return "".join(f"{t},{cycle},{gyro},0,0,9.8\n" for t in times)


def read(path: Path) -> RigRun:
    return read_rig_run(path, physics=False)


def made(n: int, seed: int, *, temps: int = 0, angle: bool = False, cycles: int = 2) -> RigRun:
    rng = np.random.default_rng(seed)
    step = 0.01 * rng.uniform(0.9, 1.1, n)
    cycle = np.sort(rng.integers(0, cycles, n))
    cycle = np.unique(cycle, return_inverse=True)[1]
    temp = rng.uniform(20, 30, (n, 3))
    return RigRun(
        time_s=np.cumsum(step),
        step_s=step,
        cycle=cycle,
        gyro=rng.standard_normal((n, 3)),
        accel=rng.standard_normal((n, 3)) * 10.0 ** rng.integers(-9, 9),
        temp_c=None if temps == 0 else temp if temps == 3 else np.repeat(temp[:, :1], 3, axis=1),
        rig_angle_rad=rng.standard_normal(n) if angle else None,
        flag=rng.uniform(size=n) < 0.1,
        facts=RigFacts(
            site=SITE,
            axis_of_cycle=("x", "y", "z")[: int(cycle[-1]) + 1],
            azimuth_rad=1.0,
            gyro_noise=5e-7,
            accel_noise=1e-3,
            angle_noise=7e-5,
        ),
    )


@settings(max_examples=40, deadline=None)
@given(
    n=st.integers(8, 60),
    seed=st.integers(0, 2**31),
    temps=st.sampled_from([0, 1, 3]),
    angle=st.booleans(),
    suffix=st.sampled_from([".csv", ".parquet"]),
)
def test_what_is_written_is_read_back_bit_for_bit(tmp_path_factory, n, seed, temps, angle, suffix):
    run = made(n, seed, temps=temps, angle=angle)
    path = tmp_path_factory.mktemp("rig") / f"run{suffix}"
    write_rig_run(run, path)
    back = read(path)
    for name in ("time_s", "cycle", "gyro", "accel", "temp_c", "rig_angle_rad", "flag"):
        before, after = getattr(run, name), getattr(back, name)
        if before is None:
            assert after is None
        else:
            np.testing.assert_array_equal(after, before, err_msg=name)
    inside = np.concatenate([[False], np.diff(run.cycle) == 0])
    # a difference of times near 0.6 s is rounded at 1e-16 s
    np.testing.assert_allclose(back.step_s[inside], run.step_s[inside], atol=1e-15)
    assert back.warnings == ()
    assert back.facts.axis_of_cycle == run.facts.axis_of_cycle
    for name in ("azimuth_rad", "azimuth_sigma_rad", "gyro_noise", "accel_noise", "angle_noise"):
        # degrees to radians and back: two roundings
        assert getattr(back.facts, name) == pytest.approx(getattr(run.facts, name), rel=1e-15)
    assert back.facts.site.lat_rad == pytest.approx(SITE.lat_rad, rel=1e-15)


def test_increments_are_the_same_run(tmp_path):
    run = made(50, 3, cycles=1)
    run = replace(run, step_s=np.full(50, 0.01), time_s=0.01 * np.arange(1, 51))
    write_rig_run(run, tmp_path / "a.csv", increments=True)
    assert "dtheta_x" in (tmp_path / "a.csv").read_text(encoding="utf-8")
    back = read(tmp_path / "a.csv")
    # times are rounded at 1e-16 s of a step of 0.01 s
    np.testing.assert_allclose(back.gyro, run.gyro, rtol=2e-14)
    np.testing.assert_allclose(back.accel, run.accel, rtol=2e-14)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        (HEADER + rows([0.01, 0.02, 0.02]), "line 4", "time_s 0.02 is a duplicate"),
        (HEADER + rows([0.01, 0.03, 0.02]), "line 4", "goes back from 0.03 in line 3"),
        (HEADER + rows([0.01, 0.02]) + rows([1], 1) + rows([2]), "line 5", "cycle 0 again"),
        (HEADER + rows([0.01]) + ",0,0,0,0,0,0,9.8\n", "line 3", "time_s is empty"),
        (HEADER + rows([0.01, 0.02], gyro="inf,0,0"), "line 2", "gyro_x is infinite"),
        (HEADER + rows([0.01, 0.02], gyro="0,9.9e37,0"), "line 2", r"gyro_y 9\.9e\+37"),
        (HEADER + rows([0.01, 0.02], gyro="0,0,-1e308"), "line 2", r"gyro_z -1e\+308"),
        (HEADER + rows([0.01, 0.02], gyro="a,0,0"), "line 2", "gyro_x 'a', expected a number"),
        (HEADER + rows([0.01]) + "0.02,0.5,0,0,0,0,0,9.8\n", "line 3", "cycle 0.5"),
        (HEADER.replace("gyro_z", "gyro_q") + rows([0, 1]), "header", "no column gyro_z"),
        (HEADER.replace("gyro_", "g_") + rows([0, 1]), "header", "expected either; nav"),
        (HEADER + rows([0.01]), "", "no cycle has two rows"),
        (HEADER + rows([0, 1, 2, 3], gyro=",0,0"), "column gyro_x", "is empty"),
    ],
)
def test_a_fault_is_named_with_its_place(tmp_path, text, place, words):
    path = put(tmp_path, text)
    with pytest.raises(InputError, match=words.replace("(", "\\(")) as caught:
        read(path)
    assert caught.value.source == str(path)
    assert caught.value.place == place


@pytest.mark.parametrize(
    ("sidecar", "words"),
    [
        ("latitude_deg = 55\n", "height_m: Field required"),
        (SIDECAR + "lattitude = 1\n", "lattitude"),
        (SIDECAR + "latitude_deg = 1\n", "not TOML"),
        ("latitude_deg = 95.0\nheight_m = 0.0\n", "less than or equal to 90"),
        (SIDECAR + 'axis_of_cycle = ["x", "w"]\n', "axis_of_cycle.1"),
        (SIDECAR + 'axis_of_cycle = ["x", "y"]\n', "1 cycles, but axis_of_cycle"),
        (SIDECAR + "gyro_noise_deg_h_rthz = 0.0\n", "greater than 0"),
        (SIDECAR + "height_m = nan\n", "not TOML"),
        ("latitude_deg = 55.0\nheight_m = nan\n", "height_m"),
        (SIDECAR + 'body_axes = "forward-left-up"\n', "body_axes"),
    ],
)
def test_a_sidecar_that_is_wrong_is_refused(tmp_path, sidecar, words):
    path = put(tmp_path, HEADER + rows([0.01, 0.02, 0.03]), sidecar)
    with pytest.raises(InputError, match=words):
        read(path)


def test_a_missing_sidecar_is_asked_for(tmp_path):
    path = put(tmp_path, HEADER + rows([0.01, 0.02]))
    path.with_suffix(".toml").unlink()
    with pytest.raises(InputError, match=r"expected rig\.toml beside it with the keys latitude"):
        read(path)


def holed(n: int, missing: list[int], tmp_path: Path) -> RigRun:
    """A run at 100 Hz that turns faster and faster, some rows left out."""
    text = "".join(
        f"{0.01 * k:.2f},0,{1e-3 * k:.4f},0,0,0,0,9.8\n" for k in range(n) if k not in missing
    )
    return read(put(tmp_path, HEADER + text))


def test_a_short_gap_is_bridged_with_the_attitude_kept(tmp_path):
    run = holed(2500, [700, 701, 702], tmp_path)
    assert run.warnings[0].startswith("gaps_bridged: 1 of at most 5 rows")
    assert "line 702" in run.warnings[0]
    assert np.flatnonzero(np.asarray(run.flag)).tolist() == [700]
    # the rate grows linearly: the straight line is off by the half step it begins early
    whole = 0.01 * float(np.sum(1e-3 * np.arange(2500)))
    assert float(run.gyro[:, 0] @ run.step_s) == pytest.approx(whole, abs=0.01 * 1e-3 * 3)
    assert len(run.cycles) == 1


def test_a_long_gap_splits_the_cycle(tmp_path):
    run = holed(4000, list(range(1800, 2000)), tmp_path)
    assert run.warnings[0].startswith("gap_in_cycle: cycle 0 is split at 1 gap(s)")
    assert [part.stop - part.start for part in run.cycles] == [1800, 2000]
    assert not np.any(run.flag)
    np.testing.assert_allclose(run.step_s, 0.01, atol=1e-12)  # rounding of the times


def test_a_piece_too_short_to_be_of_use_is_left_out(tmp_path):
    run = holed(4000, list(range(300, 400)), tmp_path)
    assert [part.stop - part.start for part in run.cycles] == [3600]
    assert "1 piece(s)" in run.warnings[0]


def test_a_split_cycle_keeps_its_axis(tmp_path):
    lines = "".join(f"{t:.2f},0,0.1,0,0,0,0,9.8\n" for t in np.arange(0, 30, 0.01))
    lines += "".join(f"{t:.2f},1,0.1,0,0,0,0,9.8\n" for t in np.arange(40, 60, 0.01))
    lines += "".join(f"{t:.2f},1,0.1,0,0,0,0,9.8\n" for t in np.arange(70, 90, 0.01))
    run = read(put(tmp_path, HEADER + lines, SIDECAR + 'axis_of_cycle = ["x", "z"]\n'))
    assert run.facts.axis_of_cycle == ("x", "z", "z")
    assert [int(run.cycle[part][0]) for part in run.cycles] == [0, 1, 2]


def with_empty(n: int, at: range, cell: int, tmp_path: Path) -> Path:
    lines = [f"{0.01 * k:.2f},0,0.1,0,0,0,0,9.8" for k in range(n)]
    for k in at:
        cells = lines[k].split(",")
        cells[cell] = ""
        lines[k] = ",".join(cells)
    return put(tmp_path, HEADER + "\n".join(lines) + "\n")


def test_dropouts_are_bridged_and_flagged(tmp_path):
    run = read(with_empty(3000, range(1500, 1504), 2, tmp_path))
    assert run.warnings == ("dropouts: 4 rows with empty cells flagged, from line 1502",)
    assert np.flatnonzero(np.asarray(run.flag)).tolist() == [1500, 1501, 1502, 1503]
    np.testing.assert_allclose(run.gyro[:, 0], 0.1)


def test_gyros_away_for_long_split_the_cycle(tmp_path):
    run = read(with_empty(3000, range(1500, 1600), 3, tmp_path))
    assert [w.split(":")[0] for w in run.warnings] == ["dropouts", "gap_in_cycle"]
    assert [part.stop - part.start for part in run.cycles] == [1500, 1400]


def test_accelerometers_away_for_long_are_only_flagged(tmp_path):
    run = read(with_empty(3000, range(1500, 1600), 7, tmp_path))
    assert int(np.sum(run.flag)) == 100
    assert len(run.cycles) == 1


def test_too_many_dropouts_are_no_recording(tmp_path):
    with pytest.raises(InputError, match=r"line 1502: empty cells; they are in 33% of the cycle"):
        read(with_empty(3000, range(1500, 2500), 7, tmp_path))


def test_a_fast_reader(tmp_path):
    """45 min at 100 Hz with temperature and angle; the bound is ten times what it takes alone."""
    n = 270_000
    run = made(n, 1, temps=1, angle=True, cycles=3)
    write_rig_run(run, tmp_path / "a.csv")
    began = time.process_time()
    back = read(tmp_path / "a.csv")
    assert len(back) == n
    assert time.process_time() - began < 5.0


def nav(n: int = 30, seed: int = 1) -> NavRun:
    rng = np.random.default_rng(seed)
    roll, heading = rng.uniform(-np.pi, np.pi, (2, n))
    pitch = rng.uniform(-0.5, 0.5, n) * np.pi
    pitch[0], pitch[1] = np.pi / 2, -np.pi / 2
    return NavRun(
        time_s=1.0 + np.arange(n),
        cycle=np.repeat([0, 1], [n // 2, n - n // 2]),
        lat_rad=SITE.lat_rad + 1e-4 * rng.standard_normal(n),
        lon_rad=0.6 + 1e-4 * rng.standard_normal(n),
        height_m=150 + rng.standard_normal(n),
        velocity=rng.standard_normal((n, 3)),
        c_nb=c_nb_from_angles(roll, pitch, heading),
        temp_c=rng.uniform(20, 30, (n, 3)),
        facts=RigFacts(site=SITE, axis_of_cycle=("x", "z"), azimuth_rad=-1.0),
    )


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_navigation_outputs_come_back(tmp_path, suffix):
    run = nav()
    write_nav_run(run, tmp_path / f"nav{suffix}")
    back = read_nav_run(tmp_path / f"nav{suffix}")
    for name in ("time_s", "cycle", "height_m", "velocity", "temp_c"):
        np.testing.assert_array_equal(getattr(back, name), getattr(run, name), err_msg=name)
    # radians to degrees and back: rounding, in the angles up to 2π
    np.testing.assert_allclose(back.lat_rad, run.lat_rad, rtol=1e-15)
    np.testing.assert_allclose(back.c_nb, run.c_nb, atol=3e-15)
    assert back.facts.axis_of_cycle == ("x", "z")


def test_body_axes_say_where_the_body_points(tmp_path):
    """Heading east, nose up by 10°, right wing down by 20°: ahead, right and up are the same."""
    line = "0,0,55.75,37,150,0,0,0,20,10,90\n1,0,55.75,37,150,0,0,0,20,10,90\n"
    path = put(tmp_path, NAV + line)
    plain = read_nav_run(path).c_nb[0]
    right, ahead, up = plain.T
    np.testing.assert_allclose(
        ahead, [np.cos(np.deg2rad(10)), 0, np.sin(np.deg2rad(10))], atol=1e-12
    )
    assert right[2] < 0  # right wing down
    for name, columns in (
        ("forward-right-down", (ahead, right, -up)),
        ("forward-left-up", (ahead, -right, up)),
    ):
        path = put(tmp_path, NAV + line, SIDECAR + f'body_axes = "{name}"\n')
        np.testing.assert_allclose(read_nav_run(path).c_nb[0], np.column_stack(columns), atol=1e-12)


@pytest.mark.parametrize(
    ("line", "place", "words"),
    [
        ("1,0,0.973,0.65,150,0,0,0,0,0,0\n", "line 3", r"lat_deg 0.973, .* is it in radians\?"),
        ("1,0,45,37,150,0,0,0,0,0,0\n", "line 3", "expected the site's 55.75 or near"),
        ("1,0,55.75,37,150,0,0,0,0,0,\n", "line 3", "heading_deg is empty"),
        ("1,0,55.75,37,150,0,0,nan,0,0,0\n", "line 3", "vu_m_s is empty or not a number"),
        ("0,0,55.75,37,150,0,0,0,0,0,0\n", "line 3", "duplicate"),
        ("1,0,55.75,37,150,0,0,0,0,91,0\n", "line 3", "pitch_deg 91, expected -90 to 90"),
        ("1,0,55.75,37,150,0,0,0,0,0,6.28\n", "line 3", "heading_deg turns over at 2π"),
    ],
)
def test_a_wrong_navigation_output_is_named(tmp_path, line, place, words):
    path = put(tmp_path, NAV + "0,0,55.75,37,150,0,0,0,0,0,0.01\n" + line)
    with pytest.raises(InputError, match=words) as caught:
        read_nav_run(path)
    assert caught.value.place == place
