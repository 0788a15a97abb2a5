"""The command make-safe: a chamber that nobody guards, that somebody holds, out of reach."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from accelbench.cli import main
from accelbench.commands.run import make_safe_work as commands_safe
from drivers.devices import SafeResult
from drivers.station import StationConfig
from tests.thermo.station.processes.guard_bench import (
    guardian_pid,
    make_safe,
    running,
    station_file,
)
from tests.thermo.station.processes.processes import chamber_config, hold, newest_test, setpoint_c
from thermo.launch import make_safe as making_safe
from thermo.launch.make_safe import make_station_safe
from thermo.safety.guardian_record import read_record
from thermo.safety.guardian_results import result_file


@pytest.mark.slow
def test_a_chamber_whose_controller_and_guardian_died_is_made_safe_by_command(bench, tmp_path):
    path = station_file(bench, tmp_path)
    with running(bench) as controller:
        os.kill(guardian_pid(bench), signal.SIGKILL)
        controller.process.kill()
        controller.process.wait(30)
        hold(chamber_config(bench), 50.0)  # nobody is left who would notice
        record = read_record(result_file(bench[3], newest_test(bench[3])))
        assert record is not None
        assert record.needs_help
        code, document = make_safe(path, "--interrupted")
        assert (code, document["verified"]) == (0, True)
        assert document["interrupted_test"] == newest_test(bench[3])
        assert setpoint_c(bench[2]) == 25.0
        record = read_record(result_file(bench[3], newest_test(bench[3])))
        assert record is not None
        assert record.verified
        assert "make-safe" in record.text
    hold(chamber_config(bench), 40.0)
    code, document = make_safe(path, "--interrupted")
    assert (code, document["needed"], document["commanded"]) == (0, False, False)
    assert setpoint_c(bench[2]) == 40.0
    code, document = make_safe(path)
    assert (code, document["verified"], document["held_by"]) == (0, True, None)
    assert setpoint_c(bench[2]) == 25.0


@pytest.mark.slow
def test_a_test_that_runs_is_not_disturbed_unless_that_is_wanted(bench, tmp_path):
    path = station_file(bench, tmp_path)
    with running(bench) as controller:
        code, document = make_safe(path)
        assert (code, document["verified"], document["commanded"]) == (1, False, False)
        assert f"process {controller.process.pid}" in document["held_by"]
        assert newest_test(bench[3]) in document["held_by"]
        code, document = make_safe(path, "--force")
        assert (code, document["verified"], document["held_by"]) == (0, True, None)
        assert controller.end()[-1] == "outcome interrupted True stopped by SIGTERM"
        assert setpoint_c(bench[2]) == 25.0


def test_a_chamber_that_a_sitting_holds_is_left_to_it(bench, sitting, tmp_path):
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    sitting.start("T7", {}, tmp_path / "g.json")
    hold(config.chamber, 40.0)
    made = make_station_safe(config, patience_s=0.0)
    assert not made.done
    assert not made.safe.commanded
    assert f"process {os.getpid()}" in made.held_by
    assert setpoint_c(bench[2]) == 40.0
    sitting.end(SafeResult(verified=True, steps=()))
    made = make_station_safe(config, interrupted_only=True)
    assert made.done
    assert not made.needed
    assert setpoint_c(bench[2]) == 40.0
    assert make_station_safe(config).done
    assert setpoint_c(bench[2]) == 25.0


def test_one_that_does_not_end_when_asked_is_told_beside_the_safe_chamber(
    bench, sitting, tmp_path, monkeypatch
):
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    sitting.start("T8", {}, tmp_path / "g.json")
    hold(config.chamber, 40.0)
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(making_safe.os, "kill", lambda pid, number: asked.append((pid, number)))
    made = make_station_safe(config, force=True, patience_s=0.0, abort_s=0.0)
    assert asked[0] == (os.getpid(), signal.SIGTERM)
    assert made.safe.verified
    assert not made.done
    assert f"process {os.getpid()}" in made.held_by
    assert setpoint_c(bench[2]) == 25.0
    sitting.end(SafeResult(verified=True, steps=()))


def test_make_safe_takes_no_bad_station_file(tmp_path, capsys):
    path = tmp_path / "station.toml"
    path.write_text("[chamber]\n", encoding="utf-8")
    assert main(["make-safe", str(path)]) == 2
    told = capsys.readouterr().err
    assert str(path) in told
    assert told.count("\n") == 1


def test_a_chamber_out_of_reach_is_told_with_exit_code_1(bench, tmp_path, capsys, monkeypatch):
    path = station_file(bench, tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(chamber_config(bench).url, "modbus+tcp://127.0.0.1:9"))
    monkeypatch.setattr(commands_safe, "make_station_safe", partial(make_station_safe, retry_s=0.0))
    assert main(["make-safe", str(path)]) == 1
    assert "NOT VERIFIED" in capsys.readouterr().out
