"""`rig calibrate` and `rig compensate` through their commands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from accelbench.commands.rig_calibrate.command import calibrate, compensate
from errormodel.errors import InputError
from sinscal.recording.files import read_rig_run, write_rig_run
from tests.sinscal.twin import Twin, make_twin


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Twin]:
    path = tmp_path_factory.mktemp("rig") / "run.csv"
    twin = make_twin(1, angle=True)
    write_rig_run(twin.run, path)
    return path, twin


def run(command, *words: object) -> Result:
    return CliRunner().invoke(command, [str(w) for w in words], standalone_mode=False)


def test_precise_calibration_is_written_told_and_applied(
    recorded: tuple[Path, Twin], tmp_path: Path
) -> None:
    path, twin = recorded
    out, report = tmp_path / "r.json", tmp_path / "report"
    told = run(calibrate, path, "--mode", "precise", "--out", out, "--report", report, "--json")
    assert told.exception is None, told.output
    assert told.return_value == 0
    document = json.loads(told.stdout)
    assert "calibrating" in told.stderr
    for name, one in document["parameters"].items():
        assert abs(one["value"] - twin.truth[name]) < 5 * one["sigma"], name
    assert {"rig_time_offset", "rig_mount_x"} <= {*document["parameters"]}
    lo, hi = document["consistency"]["nis_interval"]
    assert lo < document["consistency"]["nis_mean"] < hi
    assert document["consistency"]["passed"] is True
    page = (report / "report.html").read_text(encoding="utf-8")
    assert "passed: the calibration is consistent" in page
    assert "1000 ppm fast is −1000 ppm in every gyro scale" in document["not_tested"][0]
    assert "not tested: the recorder" in page
    assert "; ".join(document["not_tested"][1:]) in page
    assert {p.name for p in report.iterdir()} == {
        "report.html", "estimates.png", "innovations.png", "sigmas.png",
        "motion.png",
    }  # fmt: skip
    corrected = tmp_path / "corrected.csv"
    done = run(compensate, path, "--calibration", out, "--out", corrected, "--json")
    assert done.exception is None, done.output
    assert json.loads(done.stdout)["calibration"] == document["result_id"]
    # true forces have the magnitude of gravity: the errors of 1e-3 of it are gone
    force = np.linalg.norm(read_rig_run(corrected).accel, axis=1)
    raw = np.linalg.norm(twin.run.accel, axis=1)
    g = twin.run.facts.site.gravity_m_s2
    assert abs(force.mean() - g) < 2e-5
    assert abs(raw.mean() - g) > 5e-4
    again = run(compensate, corrected, "--calibration", out, "--out", tmp_path / "twice.csv")
    assert isinstance(again.exception, InputError)
    assert "already compensated" in str(again.exception)


def test_a_calibration_that_fails_ends_with_1_and_says_why(
    recorded: tuple[Path, Twin], tmp_path: Path
) -> None:
    _, twin = recorded
    path = tmp_path / "noisy.csv"
    facts = replace(twin.run.facts, accel_noise=1e-4)
    write_rig_run(replace(twin.run, facts=facts), path)
    told = run(calibrate, path, "--holdout", "none", "--json")
    assert told.return_value == 1
    assert any("noise_contradiction" in w for w in json.loads(told.stdout)["warnings"])
    words = run(calibrate, path, "--holdout", "none").stdout
    assert "failed: not fulfilled: " in words
    assert "innovations agree with their sigmas" in words
    # what bounds errors in a run that passes bounds none in one that does not
    assert "the levels below are valid only after the cause is removed" in words


def test_a_protection_level_above_its_limit_ends_with_1_and_says_what_to_add(
    recorded: tuple[Path, Twin],
) -> None:
    path, _ = recorded
    words = (path, "--holdout", "none", "--protect", "gyro_bias=0.001")
    told = run(calibrate, *words, "--protect", "accel_misalignment=60")
    assert told.return_value == 1
    assert "failed: protection level above the limit: gyro_bias" in told.stdout
    assert "not tested: the recorder's clock (1000 ppm fast" in told.stdout
    line = next(x for x in told.stdout.splitlines() if "protection level of gyro_bias" in x)
    assert "above the limit of 0.001 °/h" in line
    assert "--groups gyro_scale_asymmetry" in line or "record the temperature" in line
    document = json.loads(run(calibrate, *words, "--json").stdout)
    assert document["consistency"]["passed"] is True  # the tests themselves are quiet
    assert document["protection"]["exceeded"] == ["gyro_bias"]
    one = document["protection"]["parameters"]["gyro_bias_x"]
    assert one["total"] == pytest.approx(one["covariance"] + one["effects"][one["worst"]])
    wide = run(calibrate, path, "--holdout", "none", "--protect", "accel_misalignment=60")
    assert wide.return_value == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--protect", "gyro_bias"), "expected gyro_bias=LIMIT, > 0, in °/h"),
        (("--protect", "gyro_bias=-1"), "expected gyro_bias=LIMIT, > 0, in °/h"),
        (("--protect", "bias=1"), "expected one of gyro_bias"),
        (("--protect", "lever_arm=1"), "not estimated; add it by --groups"),
        (("--groups", "lever"), "expected one of gyro_bias"),
        (("--groups", "accel_temperature_bias"), "temp_c"),
        (("--priors", "nowhere.toml"), "nowhere.toml"),
        (("--holdout", "4"), "no such cycle; expected 1 to 3"),
        (("--holdout", "first"), "expected a cycle's number, last, each or none"),
        (("--out", "run.csv"), "is an input"),
    ],
)
def test_misuse_is_one_line_and_nothing_is_written(
    recorded: tuple[Path, Twin], words: tuple[str, str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = recorded
    monkeypatch.chdir(path.parent)
    before = sorted(path.parent.iterdir())
    told = run(calibrate, "run.csv", *words)
    assert said in str(told.exception)
    assert sorted(path.parent.iterdir()) == before
