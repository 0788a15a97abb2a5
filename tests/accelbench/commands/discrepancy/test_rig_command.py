"""`accelbench discrepancy rig`: its JSON, its files, what takes them, and bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from accelbench.cli import main
from benchmarks.blind.rig.setup import EFFECTS, Setup, multirate
from benchmarks.blind.rig.truth import write_rig_run as write_truth
from sinscal.recording.files import read_rig_run, write_rig_run

Captured = pytest.CaptureFixture[str]
SETUP = Setup(programme=tuple(multirate(3.0)), period_s=0.05, angles=True, warm_up_c=15.0)
JUMP_S = 400.0  # in the middle of the second cycle


@pytest.fixture(scope="module")
def lever(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lever") / "run.csv"
    write_truth(path, seed=4, setup=SETUP, effects=["lever_arm"])
    return path


@pytest.fixture(scope="module")
def jump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("jump") / "run.csv"
    values = {"accel_bias_step_y": 0.02, "accel_bias_step_at_s": JUMP_S}
    write_truth(path, seed=5, setup=SETUP, values=values)
    return path


def said(capsys: Captured, *words: object, code: int = 0) -> dict[str, Any]:
    assert main([str(w) for w in (*words, "--json")]) == code
    return json.loads(capsys.readouterr().out)


def test_the_larger_model_is_taken_by_the_filter(
    lever: Path, tmp_path: Path, capsys: Captured
) -> None:
    model, result = tmp_path / "model.toml", tmp_path / "result.json"
    report = tmp_path / "report"
    found = said(capsys, "discrepancy", "rig", lever, "--out", model, "--report", report)
    assert found["verdict"] == "named"
    assert [e["name"] for e in found["effects"]] == ["lever_arm"]
    assert {p.name for p in report.iterdir()} == {"report.html", "innovations.png", "cycles.png"}
    page = (report / "report.html").read_text(encoding="utf-8")
    for words in ("lever_arm goes with the rate", "mm", "excluded"):
        assert words in page
    # the bearing wobbles by 2″ where 15″ are assumed: the rest is consistent
    made = said(capsys, "rig", "calibrate", lever, "--model", model, "--out", result)
    assert made["mode"] == "precise"
    assert "lever_arm" in made["groups"]
    for name, true in EFFECTS["lever_arm"].items():
        one = made["parameters"][name]
        # one in 16,000 lies beyond four sigma
        assert abs(one["value"] - true) < 4.0 * one["sigma"], name
    told = found["effects"][0]["parameters"]["lever_arm_x_x"]
    # the same data and terms; the clock's offset and the mounting are estimated beside them here
    assert made["parameters"]["lever_arm_x_x"]["value"] == pytest.approx(
        told["value"], abs=told["sigma"]
    )


def test_a_model_that_has_the_effect_lacks_nothing(
    lever: Path, tmp_path: Path, capsys: Captured
) -> None:
    model = tmp_path / "present.toml"
    model.write_text('mode = "precise"\ngroups = ["lever_arm"]\n', encoding="utf-8")
    found = said(capsys, "discrepancy", "rig", lever, "--model", model)
    assert found["verdict"] == "nothing"
    assert "lever_arm" not in found["smallest_nameable"]


@pytest.mark.slow  # a lever arm by default, above
def test_a_jump_goes_from_file_to_filter_to_compensated_run(
    jump: Path, tmp_path: Path, capsys: Captured
) -> None:
    model, result, out = tmp_path / "m.toml", tmp_path / "r.json", tmp_path / "c.csv"
    found = said(capsys, "discrepancy", "rig", jump, "--out", model)
    (effect,) = found["effects"]
    assert effect["name"] == "accel_bias_step"
    at = effect["parameters"]["accel_bias_step_at_s"]
    assert abs(at["value"] - JUMP_S) < 4.0 * at["sigma"] + 1.0  # the filter's steps are 1 s long
    made = said(capsys, "rig", "calibrate", jump, "--model", model, "--out", result)
    assert made["steps"] == [{"kind": "accel", "at_s": at["value"]}]
    step = made["parameters"]["accel_bias_step_y"]
    assert abs(step["value"] - 0.02) < 4.0 * step["sigma"]
    said(capsys, "rig", "compensate", jump, "--calibration", result, "--out", out)
    raw, done = read_rig_run(jump), read_rig_run(out, physics=False)
    taken = (raw.accel - done.accel)[:, 1]
    before, after = raw.time_s < JUMP_S - 3.0, raw.time_s > JUMP_S + 3.0
    second = raw.cycle == 1
    # accelerometer y's scale error (1e-3 of g at most) averages out over whole turns
    jumped = taken[after & second].mean() - taken[before & second].mean()
    assert jumped == pytest.approx(0.02, rel=0.2)
    # another run is made later: the constant error is what it was after the jump
    later = tmp_path / "later.csv"
    write_rig_run(raw.take_cycles([0]), later)
    said(capsys, "rig", "compensate", later, "--calibration", result, "--out", tmp_path / "l.csv")
    other = (read_rig_run(later).accel - read_rig_run(tmp_path / "l.csv", physics=False).accel)[
        :, 1
    ]
    first = raw.cycle == 0
    np.testing.assert_allclose(other - taken[first], step["value"], rtol=5e-3)


@pytest.mark.slow  # cycles in one file, above
def test_files_are_cycles_that_follow_one_another(
    lever: Path, tmp_path: Path, capsys: Captured
) -> None:
    whole = read_rig_run(lever)
    parts = [tmp_path / f"cycle-{k}.csv" for k in range(3)]
    for k, path in enumerate(parts):
        write_rig_run(whole.take_cycles([k]), path)
    found = said(capsys, "discrepancy", "rig", *parts)
    assert [e["name"] for e in found["effects"]] == ["lever_arm"]
    held = found["heldout"]["runs"]
    assert [h["cycle"] for h in held] == [1, 2, 3]
    floor = found["floor_si"]
    for h in held:
        for channel in ("force_e", "force_n", "force_u"):
            # 160 innovations a cycle: 5.6 % is one sigma of an rms; four of them
            assert h["after_si"][channel] < 1.23 * floor[channel], (h["cycle"], channel)
    loudest = found["where"]["channel"]
    gaps = found["gaps"]
    assert max(g["before_si"][loudest] for g in gaps) > 2.0 * floor[loudest]
    assert all(g["after_si"][loudest] < 1.23 * floor[loudest] for g in gaps)


def test_misuse_and_bad_input_are_one_line_and_write_nothing(
    lever: Path, tmp_path: Path, capsys: Captured
) -> None:
    broken = tmp_path / "broken.csv"
    frame = pd.read_csv(lever)
    frame.drop(columns="gyro_x").to_csv(broken, index=False)
    broken.with_suffix(".toml").write_bytes(lever.with_suffix(".toml").read_bytes())
    outputs = tmp_path / "outputs.csv"
    sensors = {f"{kind}_{a}" for kind in ("gyro", "accel") for a in "xyz"}
    frame.drop(columns=sorted(sensors)).assign(roll_deg=0.0).to_csv(outputs, index=False)
    outputs.with_suffix(".toml").write_bytes(lever.with_suffix(".toml").read_bytes())
    coarse = tmp_path / "coarse.toml"
    coarse.write_text('mode = "coarse"\ngroups = ["rig_time_offset"]\n', encoding="utf-8")
    unknown = tmp_path / "unknown.toml"
    unknown.write_text('groups = ["lever"]\n', encoding="utf-8")
    out = tmp_path / "out.toml"
    cases = [
        ((tmp_path / "nowhere.csv",), "nowhere.csv"),
        ((broken,), "gyro_x"),
        ((outputs,), "navigation outputs are for rig calibrate --mode navigation alone"),
        ((lever, "--model", coarse), "expected mode 'precise'"),
        ((lever, "--model", unknown), "no group 'lever'"),
        ((lever, "--experiment-out", tmp_path / "s.toml"), "--experiment-out"),
        ((lever, "--out", lever), "is an input"),
    ]
    for words, expected in cases:
        more = () if "--out" in words else ("--out", out)
        assert main([str(w) for w in ("discrepancy", "rig", *words, *more)]) == 2, words
        told = capsys.readouterr()
        assert expected in told.err, words
        assert told.out == ""
        assert len(told.err.strip().splitlines()) == 1, told.err
    assert not out.exists()
    model = tmp_path / "m.toml"
    model.write_text('mode = "precise"\ngroups = ["rig_time_offset"]\n', encoding="utf-8")
    words = ["rig", "calibrate", str(lever), "--mode", "coarse", "--model", str(model)]
    assert main(words) == 2
    assert "rig_time_offset needs the rig's angle" in capsys.readouterr().err
