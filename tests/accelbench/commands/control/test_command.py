"""`accelbench control` from a terminal."""

import json
from pathlib import Path

import pytest

from accelbench.cli import main
from tests.thermo.store.short_test import begun
from thermo.store.operation.alarms import raise_alarm
from thermo.store.store import open_store

SHORT = Path(__file__).parents[4] / "examples/sequences/short.toml"


@pytest.fixture
def store(tmp_path) -> str:
    path = tmp_path / "store.sqlite"
    with open_store(path):
        pass
    return str(path)


def said(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


def test_a_test_without_a_controller_is_told_at_once(store, capsys):
    with open_store(store) as opened:
        test_id = begun(opened)
    assert main(["control", "pause", test_id, "--store", store, "--json"]) == 1
    answer = said(capsys)
    assert (answer["state"], answer["answered"]) == ("refused", True)
    assert "no controller is alive" in answer["outcome"]
    assert main(["control", "abort", "nobody", "--store", store]) == 2
    assert "no test has this id" in capsys.readouterr().err


def test_a_test_is_planned_armed_and_withdrawn_and_all_of_it_is_listed(store, capsys):
    assert main(["control", "plan", str(SHORT), "--store", store, "--json"]) == 0
    planned = said(capsys)
    assert (planned["state"], planned["emulated"]) == ("planned", True)
    number = str(planned["number"])
    assert main(["control", "arm", number, "--store", store, "--json"]) == 0
    armed = said(capsys)
    assert armed["armed"] is True
    assert {c["name"] for c in armed["checks"]} >= {"limits", "store", "disk"}
    again = ["control", "start", number, "--store", store, "--patience", "0", "--json"]
    assert main(again) == 1  # nobody serves
    assert said(capsys)["answered"] is False
    assert main(["control", "withdraw", number, "--store", store, "--json"]) == 0
    assert said(capsys)["state"] == "withdrawn"
    assert main(["control", "list", "--store", store, "--json"]) == 0
    listed = said(capsys)
    actions = [c["action"] for c in listed["commands"]]
    assert actions == ["plan", "arm", "start", "withdraw"]
    assert listed["planned"] == listed["controllers"] == []
    assert main(["control", "list", "--store", store]) == 0
    assert "no test is running" in capsys.readouterr().out


def test_alarms_are_shown_until_they_are_acknowledged(store, capsys):
    with open_store(store) as opened:
        number = raise_alarm(opened, "link lost", "multimeter lost")
    assert main(["control", "list", "--store", store]) == 0
    shown = capsys.readouterr().out
    assert "Instrument lost: multimeter lost" in shown
    assert "See to its power and cable" in shown
    assert main(["control", "acknowledge", str(number), "--store", store, "--json"]) == 0
    assert said(capsys)["acknowledged"] == [number]
    assert main(["control", "acknowledge", "--all", "--store", store]) == 0
    assert "no alarm is open" in capsys.readouterr().out
    assert main(["control", "acknowledge", "99", "--store", store]) == 2
    assert main(["control", "acknowledge", "--store", store]) == 2


def test_the_addresses_of_notices_are_shown_without_their_secrets(tmp_path, capsys):
    path = tmp_path / "notify.toml"
    path.write_text('[notify]\nurls = ["json://u:secret@h/"]\n', encoding="utf-8")
    path.chmod(0o600)
    assert main(["control", "notify", "--notify", str(path)]) == 0
    shown = capsys.readouterr()
    assert "json" in shown.out
    assert "secret" not in shown.out + shown.err
    missing = str(tmp_path / "none.toml")
    assert main(["control", "notify", "--notify", missing]) == 2


def test_a_detached_test_takes_no_options_of_one_that_is_watched(store, tmp_path, capsys):
    out = str(tmp_path / "x.csv")
    assert main(["run", str(SHORT), "--store", store, "--detach", "--out", out]) == 2
    assert "--detach goes without" in capsys.readouterr().err
