"""`runs` and `export` of a store that is not as it should be; what is shown of its URL."""

import json
import shutil

import pytest

from accelbench.commands.run.text import Afterwards, run_document, run_text
from drivers.devices import SafeResult
from tests.thermo.store.test_database import SECRET, URLS
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import TestOutcome
from thermo.store.database import display_url, parse_store_url
from thermo.store.records import NewTest
from thermo.store.spool.recover import warnings
from thermo.store.store import open_store


@pytest.mark.parametrize("url", URLS)
def test_no_command_shows_the_password(url, refused, tmp_path):
    text = url.format(SECRET)
    for arguments in (
        ["runs", "--json"],
        ["export", "ID", "--out", tmp_path / "x.csv"],
        ["run", "--resume", "ID"],
    ):
        line = refused(*arguments, "--store", text)
        assert SECRET not in line


def test_a_result_shows_the_store_without_its_password():
    url = f"postgresql://u:{SECRET}@h/x?sslmode=require&sslpassword={SECRET}"
    outcome = TestOutcome(
        test_id="T", status="interrupted", reason="stop", head_stopped=True,
        safe=SafeResult(verified=True, steps=("held",)),
    )  # fmt: skip
    shown_url = display_url(parse_store_url(url))
    text = "\n".join(str(line) for line in run_text(outcome, Afterwards(), shown_url))
    document = json.dumps(run_document(outcome, Afterwards(), shown_url, LiveEstimate({})))
    for said in (text, document):
        assert SECRET not in said
        assert "postgresql://u:***@h/x?sslmode=require&sslpassword=***" in said
    assert "resume with: accelbench run --resume T --store 'postgresql://u:***@h/x" in text


def test_the_totals_after_a_resume_and_a_part_that_was_exported_are_explained():
    outcome = TestOutcome(
        test_id="T", status="interrupted", reason="stop", head_stopped=True, readings=2490,
        safe=SafeResult(verified=True, steps=("held",)),
    )  # fmt: skip
    after = Afterwards(in_store=4353, repeated=33, exported=("n.csv",), out="n.csv")
    text = "\n".join(str(line) for line in run_text(outcome, after, "s.sqlite"))
    assert "2490 readings stored in s.sqlite since it was resumed" in text
    assert "in total the store has 4353 readings in all; 33 of them" in text
    assert "recorded run of the readings so far: n.csv" in text
    assert "run --resume T --store s.sqlite --out n.csv --force" in text
    document = run_document(outcome, after, "s.sqlite", LiveEstimate({}))
    assert (document["readings_in_store"], document["readings_repeated"]) == (4353, 33)


def test_what_was_left_behind_beside_a_store_is_told(tmp_path, call, refused, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    file = tmp_path / "night.sqlite"
    store = open_store(file)
    test_id = store.begin_test(NewTest("night", "", "{}"))
    shutil.copy(tmp_path / "night.sqlite-wal", tmp_path / "old.sqlite-wal")
    store.finish_test(test_id, "interrupted", "stop")
    store.close()
    (tmp_path / f"night.sqlite.{test_id}.guardian.json").write_text("{}", encoding="utf-8")
    lines = warnings(file)
    assert len(lines) == 2
    listed = call("runs", "--store", file, "--json")
    assert listed.document["warnings"] == list(lines)
    assert "old.sqlite-wal: an orphaned write-ahead log" in listed.err
    assert "guardian.json: left by a guardian" in listed.err
    file.unlink()
    (tmp_path / "old.sqlite-wal").rename(tmp_path / "night.sqlite-wal")
    said = refused("runs", "--store", file)
    assert "night.sqlite-wal belongs to it: put the file back beside it" in said
