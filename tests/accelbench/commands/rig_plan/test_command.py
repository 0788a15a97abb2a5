"""`accelbench rig simulate` and `rig covariance`, as one calls them."""

import json
from pathlib import Path

import numpy as np
import pytest

from sinscal.calibration.rig import calibrate
from sinscal.recording.files import read_rig_run
from sinscal.twin.rig_file import read_rig_file

EXAMPLES = Path(__file__).parents[4] / "examples/rig"
KEYS = {
    "gyro_bias_deg_h",
    "gyro_scale",
    "gyro_misalignment_arcmin",
    "accel_bias_m_s2",
    "accel_scale",
    "accel_misalignment_arcmin",
}
SHORT = """
acceleration_deg_s2 = 20.0
azimuth_sigma_deg = 1.0
cycles = [
    { axis = "x", segments = [{ rate_deg_s = 10, duration_s = 60 }] },
    { axis = "y", segments = [{ rate_deg_s = -10, duration_s = 60 }] },
]
[recording]
rate_hz = 50
[errors]
gyro_scale_x = 1e-3
lever_arm_x_y = 0.05
"""


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def test_without_a_programme_the_article_s_tables_come_out(call) -> None:
    document = call("rig", "covariance", "--json").document
    ratios = []
    for table in ("table1", "table2"):
        assert set(document[table]) == KEYS
        assert set(document["literal"][table]) == KEYS
        for entry in document[table].values():
            assert entry["ratio"] == pytest.approx(entry["computed"] / entry["published"])
            ratios.append(entry["ratio"])
    ratios = np.array(ratios)
    assert np.all((ratios > 0.6) & (ratios < 1.7))
    assert np.sum((ratios > 0.8) & (ratios < 1.25)) >= 9
    for mode, rig in (("coarse", 0), ("precise", 4)):
        one = document[mode]
        assert len(one["names"]) == len(one["covariance"]) == 21 + rig
        budget = [sum(part[n] for part in one["error_budget"].values()) for n in one["names"]]
        np.testing.assert_allclose(budget, 1.0, rtol=1e-6)


def test_in_words_it_says_what_was_assumed(call) -> None:
    done = call("rig", "covariance")
    assert done.code == 0
    assert "4 times what is stated" in done.out
    assert "to the letter" in done.out


def test_a_programme_of_one_s_own_with_priors_groups_and_report(call, short, tmp_path) -> None:
    priors = tmp_path / "priors.toml"
    priors.write_text("[sigma]\ngyro_bias = 1e-7\n")
    report = tmp_path / "report"
    done = call(
        "rig", "covariance", short, "--mode", "coarse", "--groups", "lever_arm", "--priors", priors,
        "--report", report, "--json",
    )  # fmt: skip
    document = done.document
    assert "table1" not in document
    found = document["coarse"]["parameters"]
    assert found["gyro_bias_x"]["prior_sigma"] == 1e-7
    assert found["lever_arm_x_y"]["unit"] == "m"
    assert document["names"] == list(found)
    assert "gyro_scale_z" in document["coarse"]["not_seen"]  # nothing turns about z
    assert {p.name for p in report.glob("*.png")} == {
        "programme.png", "sigmas_coarse.png", "budget_coarse.png",
    }  # fmt: skip
    assert "lever arm x y" in (report / "report.html").read_text()


def test_people_are_told_sigmas_in_the_units_of_a_calibration(call, short) -> None:
    si = call("rig", "covariance", short, "--mode", "coarse", "--json").document["coarse"]
    rows = {
        words[0]: words[1:]
        for line in call("rig", "covariance", short, "--mode", "coarse").out.splitlines()
        if (words := line.split())
    }
    for name, unit, size in (
        ("gyro_bias_x", "°/h", np.deg2rad(1.0) / 3600.0),
        ("gyro_misalignment_xy", "arcmin", np.deg2rad(1.0) / 60.0),
        ("accel_bias_x", "µg", 9.80665e-6),
        ("accel_scale_x", "ppm", 1e-6),
    ):
        told = rows[name]
        assert told[0] == unit
        # three digits are told
        assert float(told[1]) == pytest.approx(
            si["parameters"][name]["sigma"] / size,
            rel=0.05,  # a sigma is told with two digits
        )


def test_a_simulated_run_is_read_back_and_holds_what_the_file_says(call, short, tmp_path) -> None:
    out, truth = tmp_path / "run.csv", tmp_path / "truth.json"
    done = call("rig", "simulate", short, "--out", out, "--truth", truth, "--angle", "--json")
    assert done.code == 0, done.err
    answer = json.loads(truth.read_text())
    assert answer == done.document
    assert answer["parameters"]["gyro_scale_x"] == {"value": 1e-3, "unit": "1"}
    run = read_rig_run(out)
    assert len(run) == 6000
    assert run.facts.axis_of_cycle == ("x", "y")
    assert run.rig_angle_rad is not None
    found = calibrate(run, "coarse")
    apart = (found.value("gyro_scale_x") - 1e-3) / found.sigma("gyro_scale_x")
    assert abs(apart) < 5.0


def test_errors_drawn_once_can_be_given_again(call, short, tmp_path) -> None:
    first, again, truth = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "truth.json"
    assert call(
        "rig", "simulate", short, "--out", first, "--errors", "random", "--groups",
        "accel_temperature_bias", "--self-heating", "--truth", truth, "--seed", "3",
    ).code == 0  # fmt: skip
    assert call(
        "rig", "simulate", short, "--out", again, "--errors", truth, "--self-heating", "--seed", "3"
    ).code == 0  # fmt: skip
    assert first.read_bytes() == again.read_bytes()
    assert "accel_temperature_bias_x" in json.loads(truth.read_text())["parameters"]


def test_increments_are_the_rates_times_the_step(call, short, tmp_path) -> None:
    rates, steps = tmp_path / "a.csv", tmp_path / "b.csv"
    call("rig", "simulate", short, "--out", rates)
    call("rig", "simulate", short, "--out", steps, "--increments")
    assert "dtheta_x" in steps.read_text().splitlines()[0]
    a, b = read_rig_run(rates), read_rig_run(steps)
    np.testing.assert_allclose(a.gyro, b.gyro, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("name", ["article", "experiment", "two_rates"])
def test_the_examples_are_taken(name: str) -> None:
    file = read_rig_file(EXAMPLES / f"{name}.toml")
    assert [c.axis for c in file.cycles] == ["x", "y", "z"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("rate_deg_s = 10,", "rate_deg_s = nan,"), "rate_deg_s"),
        (('axis = "x"', 'axis = "q"'), "axis"),
        (("acceleration_deg_s2 = 20.0", "acceleration_deg_s2 = 0.1"), "shorter than"),
        (("gyro_scale_x", "gyro_scale_q"), "gyro_scale_q"),
        (("rate_hz = 50", "rate_hz = 5000"), "rate_hz"),
        (("[recording]", "[recordings]"), "recordings"),
    ],
)
def test_a_programme_that_is_wrong_is_refused(refused, short, tmp_path, change, said) -> None:
    text = short.read_text()
    assert change[0] in text
    short.write_text(text.replace(*change))
    assert said in refused("rig", "simulate", short, "--out", tmp_path / "out.csv")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["covariance", "none.toml"], "none.toml"),
        (["covariance", "--groups", "lever_arm"], "PROGRAMME.toml"),
        (["covariance", "SHORT", "--groups", "nonsense"], "nonsense"),
        (["covariance", "SHORT", "--groups", "accel_temperature_bias"], "[temperature]"),
        (["simulate", "SHORT"], "--out"),
        (["simulate", "SHORT", "--out", "SHORT"], "--out"),
        (["simulate", "SHORT", "--out", "x.csv", "--errors", "SHORT"], "parameters"),
        (["nonsense"], "nonsense"),
    ],
)
def test_misuse_is_told(refused, short, tmp_path, monkeypatch, arguments, said) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused("rig", *[str(short) if a == "SHORT" else a for a in arguments])
