"""`accelbench runs`: the tests of a store, and what guardians have left for them."""

import json
from pathlib import Path

import pytest

from accelbench.cli import main
from thermo.safety.guardian_record import RecordFile
from thermo.safety.guardian_results import result_file
from thermo.store.records import NewTest
from thermo.store.store import open_store


def test_a_guardian_that_could_not_make_the_chamber_safe_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "night.sqlite"
    with open_store(store) as opened:
        test_id = opened.begin_test(NewTest("night", "", "{}"))
    record = RecordFile(result_file(store, test_id), {"test_id": test_id})
    assert main(["runs", "--store", str(store), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["guardians"] == []  # it only watches
    record.write("trying", why="the controller ended", steps=("no answer in 1 s",))
    assert main(["runs", "--store", str(store), "--json"]) == 0
    (shown,) = json.loads(capsys.readouterr().out)["guardians"]
    assert (shown["test_id"], shown["verified"], shown["needs_help"]) == (test_id, False, True)
    assert main(["runs", "--store", str(store)]) == 0
    told = capsys.readouterr().out
    assert f"guardian of {test_id}" in told
    assert "keeps trying" in told
    assert "no answer in 1 s" in told
