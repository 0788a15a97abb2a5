"""`accelbench discrepancy thermal`: its JSON, its files, and that they are taken further."""

import json
from pathlib import Path

import pytest

from accelbench.cli import main
from tests.thermo.discrepancy.examples import hidden_runs
from thermo.library import thermal_library
from thermo.planning.sequence import load_sequence
from thermo.recording.files import write_runs

KEYS = {
    "verdict",
    "effects",
    "alias_sets",
    "where",
    "rms_before_ug",
    "rms_after_ug",
    "floor_ug",
    "heldout",
    "invisible",
    "smallest_nameable",
    "next_experiment",
}


@pytest.fixture(scope="module")
def runs_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "runs.csv"
    write_runs(hidden_runs(1, {"loop": 15.0}), path)
    return path


def test_one_document_and_files_that_others_take(
    runs_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, report, sequence = tmp_path / "m.toml", tmp_path / "report", tmp_path / "next.toml"
    words = ["discrepancy", "thermal", str(runs_file), "--out", str(out), "--report", str(report)]
    assert main([*words, "--experiment-out", str(sequence), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) >= KEYS
    assert document["verdict"] == "named"
    (effect,) = document["effects"]
    assert set(effect) == {"name", "parameters", "strength_d", "share", "p_value", "sentence"}
    assert effect["name"] == "bias_hysteresis"
    assert set(effect["parameters"]["bias_hysteresis"]) == {"value", "sigma", "unit"}
    assert document["where"]["factor"] == "direction"
    assert document["heldout"]["after_ug"] < document["heldout"]["before_ug"]
    assert [r["run"] for r in document["heldout"]["runs"]] == ["1", "2", "3", "4"]
    assert set(document["smallest_nameable"]["temperature_rate_bias"]) == {"value", "unit"}
    assert {p.name for p in report.iterdir()} == {"report.html", "residual_A.png", "gap_A.png"}
    assert load_sequence(sequence).positions.order == "random"
    fitted = tmp_path / "fitted.json"
    assert main(["fit", str(runs_file), "--model", str(out), "--out", str(fitted), "--json"]) == 0
    residual = json.loads(capsys.readouterr().out)["accelerometers"][0]["residual_ug"]
    assert residual < 1.02 * document["rms_after_ug"]
    compensated = tmp_path / "c.csv"
    larger = str(out.with_suffix(".json"))
    taken = ["compensate", str(runs_file), "--model", larger, "--out", str(compensated)]
    assert main(taken) == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["lost.csv"], "lost.csv: no such file"),
        (["{runs}", "--effects", "lost.py"], "lost.py: no such file"),
        (["{runs}", "--out", "{runs}"], "is an input"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], complaint: str, runs_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [w.format(runs=runs_file) for w in words]
    assert main(["discrepancy", "thermal", *given]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert complaint in shown.err.splitlines()[-1]


OWN_EFFECT = """
import numpy as np
from errormodel.terms import Coefficient, Term, memoryless
from thermo.library.effects import Form, ThermalEffect

def ripple():
    return Term(
        name="ripple", sentence="A ripple over temperature.", place="input",
        coefficients=(Coefficient(name="ripple", symbol="R", unit="µg", per_unit=1e6),),
        columns=memoryless(lambda r: np.sin(2 * np.pi * (r["x_c"] + 25.0) / 20.0)),
        needs=frozenset(["x_c"]),
    )

TERMS = {"ripple": ripple}
EFFECTS = [
    ThermalEffect(
        name="ripple", sentence="The bias ripples over temperature, {size}.",
        forms=lambda at: [] if "ripple" in at.term_names else [Form(terms=("ripple",))],
        experiment="a slower ramp",
    )
]
"""


@pytest.mark.slow  # tests/test_effect_in_one_file.py names one by default
def test_an_effect_of_one_s_own_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own, runs = tmp_path / "own.py", tmp_path / "runs.csv"
    own.write_text(OWN_EFFECT, encoding="utf-8")
    write_runs(hidden_runs(2, {"wave": 20.0}), runs)
    assert main(["discrepancy", "thermal", str(runs), "--effects", str(own), "--json"]) == 0
    (effect,) = json.loads(capsys.readouterr().out)["effects"]
    value = effect["parameters"]["ripple"]
    assert effect["name"] == "ripple"
    assert abs(value["value"] - 20.0) < 4.0 * value["sigma"]
    assert "ripple" not in thermal_library().terms  # it joined it for this command alone
