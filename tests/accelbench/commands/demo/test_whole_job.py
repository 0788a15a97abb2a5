import json
from pathlib import Path

import pandas as pd
import pytest

from accelbench.commands.demo import work as commands_demo
from accelbench.commands.demo.whole_job import demo_sequence, fresh_folder, run_demo
from thermo.compensation.model_file import read_model
from thermo.planning.sequence import load_sequence
from thermo.station.outcome import TestOutcome

HERE = Path(__file__).parent


@pytest.fixture
def short(monkeypatch):
    """The demonstration of some minutes instead of half a day of chamber time."""
    sequence = load_sequence(HERE.parents[1] / "mini.toml")
    same = [a.model_copy(update={"nominal_scale": 1.3}) for a in sequence.accelerometers]
    sequence = sequence.model_copy(update={"accelerometers": tuple(same)})
    monkeypatch.setattr(commands_demo, "demo_sequence", lambda: sequence)
    return sequence


def test_the_demonstration_from_sequence_to_report(call, short, tmp_path):
    done = call("demo", "--out", tmp_path / "demo", "--json")
    assert done.code == 0, done.err
    document = done.document
    folder = tmp_path / "demo/001"
    assert document["folder"] == str(folder)
    assert {p.name for p in folder.iterdir()} >= {
        "store.sqlite", "run.csv", "run.toml", "model.json", "compensated.csv", "report",
    }  # fmt: skip
    assert Path(document["report"]).is_file()
    one, three = document["fit"]["accelerometers"]
    assert (one["serial"], three["serial"]) == ("QA-001", "QA-003")
    for a in (one, three):
        assert a["residual_ug"] < 0.2 * a["residual_raw_ug"]
    # the hidden hysteresis is ±20 µg with a width of 12 °C, over 30 °C; drift is 3 µg
    assert three["heating_minus_cooling_ug"] > 15.0
    assert abs(one["heating_minus_cooling_ug"]) < 12.0
    assert [m.serial for m in read_model(folder / "model.json").accelerometers] == [
        "QA-001", "QA-003",
    ]  # fmt: skip
    frame = pd.read_csv(folder / "compensated.csv")
    assert frame["accel_compensated_g"].notna().all()
    assert json.dumps(document)


@pytest.mark.slow  # the same demonstration as above, told as text
def test_the_text_ends_with_the_table_and_the_path(call, short, tmp_path, monkeypatch):
    def undrawn(_fits: object, _runs: object, folder: Path, **_kwargs: object) -> Path:
        return folder / "report.html"

    monkeypatch.setattr("accelbench.commands.demo.whole_job.write_report", undrawn)
    lines = call("demo", "--out", tmp_path).out.strip().splitlines()
    assert lines[-1] == f"report: {tmp_path}/001/report/report.html"
    header = next(k for k, line in enumerate(lines) if line.startswith("serial"))
    assert [line.split()[0] for line in lines[header + 1 : header + 3]] == ["QA-001", "QA-003"]
    assert any(line.startswith("QA-003: heating lies") for line in lines)


def test_every_demonstration_has_a_folder_of_its_own(tmp_path):
    assert [fresh_folder(tmp_path / "d").name for _ in range(3)] == ["001", "002", "003"]


def test_a_place_where_nothing_can_be_made_is_refused(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "no folder can be made" in refused("demo", "--out", tmp_path / "file")


def test_a_test_that_ends_early_has_no_report(short, tmp_path, monkeypatch, call):
    def ended(*_args: object, **_kwargs: object) -> TestOutcome:
        from drivers.devices import SafeResult

        return TestOutcome(
            test_id="t",
            status="failed",
            reason="lost the chamber",
            safe=SafeResult(verified=False, steps=()),
            head_stopped=True,
        )

    monkeypatch.setattr("accelbench.commands.demo.whole_job.run_emulated", ended)
    result = run_demo(fresh_folder(tmp_path), sequence=short)
    assert (result.report, result.fits) == (None, ())
    done = call("demo", "--out", tmp_path)
    assert done.code == 1
    assert "lost the chamber" in done.out


def test_what_is_shipped_is_what_was_promised():
    sequence = demo_sequence()
    assert [a.serial for a in sequence.accelerometers] == ["QA-001", "QA-002", "QA-003"]
    assert sequence.sampling.period_s == 10.0
    assert len(sequence.positions.angles_deg) >= 4
    assert sequence.temperature.repeats == 2
    ramps = [s for s in sequence.temperature.segments if s.kind == "ramp"]
    assert [(s.to_c, s.rate_c_per_min) for s in ramps] == [(70.0, 1.0), (-40.0, 1.0)]
