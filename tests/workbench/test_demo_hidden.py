"""A hidden effect through the instruments, in minutes of chamber time instead of days."""

import json
from pathlib import Path

import numpy as np
import pytest

from thermo.discrepancy import DRAWS
from thermo.modelfile import read_model
from thermo.planted import PLANTED, plain_accelerometer, plantable, simulated_by
from thermo.sequence import load_sequence
from thermo.terms import term
from workbench import demo_hidden

HERE = Path(__file__).parent


@pytest.fixture
def short(monkeypatch):
    """Two quick runs of two accelerometers, and fewer simulated nulls."""
    sequence = load_sequence(HERE / "mini.toml")
    same = [a.model_copy(update={"nominal_scale": 1.3}) for a in sequence.accelerometers]
    sequence = sequence.model_copy(
        update={
            "accelerometers": tuple(same),
            "positions": sequence.positions.model_copy(update={"readings_per_position": 4}),
        }
    )
    monkeypatch.setattr(demo_hidden, "hidden_sequence", lambda: sequence)
    whole = demo_hidden.find_discrepancy
    monkeypatch.setattr(
        demo_hidden, "find_discrepancy", lambda runs, **kw: whole(runs, draws=DRAWS // 3, **kw)
    )


def test_a_hidden_effect_is_named_from_the_files_and_the_next_run_is_matched(call, short, tmp_path):
    name = "temperature_rate_bias"
    done = call("demo", "--hidden", name, "--out", tmp_path / "demo", "--json")
    assert done.code == 0, done.err
    document, folder = done.document, tmp_path / "demo/001"
    assert document["right"]
    hidden = document["hidden"]
    verdicts = {a["serial"]: a for a in document["discrepancy"]["accelerometers"]}
    mine = verdicts.pop(hidden["serial"])
    assert [e["name"] for e in mine["effects"]] == [name]
    found = mine["effects"][0]["parameters"][name]
    assert abs(found["value"] - 1e6 * PLANTED[name].values[name]) < 4.0 * found["sigma"]
    assert [a["verdict"] for a in verdicts.values()] == ["nothing"]
    gap = document["next_run"]
    # a run is shorter than its drift's hour of correlation: 3 µg of it are one draw, which the
    # floor of two runs has on average; √(5² + (3·3)²) µg is what three sigma of it leave
    assert gap["after_ug"] < 10.3 < 0.5 * gap["before_ug"]
    assert {p.name for p in folder.iterdir()} >= {
        "run.csv", "run.toml", "next_run.csv", "larger_model.json", "larger_model.toml",
        "present_model.json", "report", "key.json",
    }  # fmt: skip
    assert name in read_model(folder / "larger_model.json").of(hidden["serial"]).terms
    assert json.loads((folder / "key.json").read_text())["serial"] == hidden["serial"]
    # nothing of the key is in what the search was given
    assert name not in (folder / "run.csv").read_text()
    assert (folder / "report/next_run.html").is_file()


def test_no_effect_and_a_wrong_one_are_refused_with_the_choices(refused, tmp_path):
    for words in (("--hidden",), ("--hidden", "indexer_harmonic")):
        said = refused("demo", *words, "--out", tmp_path / "demo")
        assert all(name in said for name in PLANTED)
    assert not (tmp_path / "demo").exists()


@pytest.mark.parametrize("name", [n for n, p in PLANTED.items() if p.term])
def test_what_is_planted_is_within_its_term(name):
    planted = plantable(name)
    one = term(planted.term)
    assert set(planted.values) == {u.name for u in (*one.coefficients, *one.parameters)}
    assert all(p.lo < planted.values[p.name] < p.hi for p in one.parameters)
    assert "µ" in planted.words() or "ppm" in planted.words() or planted.words().endswith(" s")
    assert plain_accelerometer("A", planted).values.keys() > planted.values.keys()


def test_an_accelerometer_made_of_a_model_file_has_no_noise(fitted):
    model = read_model(fitted.model).accelerometers[0]
    made = simulated_by(model)
    assert (made.white_ug, made.drift_ug) == (0.0, 0.0)
    assert made.values == pytest.approx(model.values())
    assert np.isclose(made.values["k0"] * 1e6, model.coefficients["k0"].value)
