"""A hidden effect through the instruments, in minutes of chamber time instead of days."""

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from accelbench.commands.demo import hidden as demo_hidden
from accelbench.commands.demo.hidden_page import NextRun, next_run_lines
from accelbench.commands.demo.steps import DemoSteps
from thermo.compensation.model_file import read_model
from thermo.discrepancy.find import DRAWS
from thermo.library import term, thermal_library
from thermo.planning.sequence import load_sequence
from thermo.twin.planted import (
    plain_accelerometer,
    plantable,
    planted_effects,
    simulated_by,
    size_in_words,
)
from thermo.twin.unknown import unknown_effect

HERE = Path(__file__).parent
EXAMPLES = planted_effects()


@pytest.fixture
def short(monkeypatch):
    """Two quick runs of two accelerometers, and fewer simulated nulls."""
    sequence = load_sequence(HERE.parents[1] / "mini.toml")
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
    assert abs(found["value"] - 1e6 * EXAMPLES[name].values[name]) < 4.0 * found["sigma"]
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


def test_an_effect_of_no_library_gets_a_shape_that_the_next_run_follows(call, short, tmp_path):
    done = call("demo", "--hidden", "unknown", "--out", tmp_path / "demo", "--json")
    assert done.code == 0, done.err
    document, folder = done.document, tmp_path / "demo/001"
    assert document["right"]
    assert "sin(2π" in document["hidden"]["size"]
    verdicts = {a["serial"]: a for a in document["discrepancy"]["accelerometers"]}
    mine = verdicts.pop(document["hidden"]["serial"])
    assert (mine["verdict"], mine["effects"]) == ("unexplained_repeatable", [])
    assert mine["shape"]["quantity"] == "temperature"
    assert [a["verdict"] for a in verdicts.values()] == ["nothing"]
    gap = document["next_run"]
    # as above: three sigma of the drift of one short run
    assert gap["after_ug"] < 10.3 < gap["before_ug"]
    assert (folder / "larger_model.py").is_file()
    assert "my_effect_1" in (folder / "larger_model.toml").read_text()
    assert gap["over_noise"] == pytest.approx(gap["after_ug"] / gap["floor_ug"])
    assert "times that" in (folder / "report/next_run.html").read_text()
    assert "An effect without a name" in (folder / "report/report.html").read_text()


def test_an_effect_of_no_library_is_drawn_from_the_seed():
    one, same, other = (unknown_effect(seed) for seed in (1, 1, 2))
    assert one.words == same.words != other.words
    assert "unknown" not in thermal_library().terms
    assert plain_accelerometer("A", one).values["unknown"] == one.values["unknown"]


# Parameters that count from the first run's beginning; the key says the station's clock.
BY_THE_CLOCK = {"run_in", "bias_step_at_h"}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_every_effect_that_can_be_hidden_is_named_and_the_next_run_matched(name, tmp_path):
    made = demo_hidden.run_hidden_demo(tmp_path, name, watch=lambda _: nullcontext(()))
    assert made.right, [(d.serial, d.verdict, [e.name for e in d.effects]) for d in made.verdicts]
    (mine,) = [d for d in made.verdicts if d.serial == made.serial]
    planted = EXAMPLES[name]
    one = term(planted.term) if planted.term else None
    units = [(u.name, u.per_unit) for u in (*one.coefficients, *one.parameters)] if one else []
    found = mine.effects[0].parameters
    for own, per_unit in units:
        if own not in BY_THE_CLOCK:
            # the recorded rate is a slope over two minutes: rounded where ramps turn, 0.8 % short
            blurred = 0.01 * abs(planted.values[own] * per_unit) * ("rate" in own)
            off = abs(found[own].value - planted.values[own] * per_unit)
            assert off < 4.0 * found[own].sigma + blurred, own
    assert made.next_run is not None
    # white 5 µg; 3 µg of drift with an hour of correlation are 9 ± 5.7 µg² over a run of 3.8 h
    assert made.next_run.gap_after_ug**2 < 25.0 + 9.0 + 3.0 * 5.7
    if made.next_run.predictive:
        assert made.next_run.gap_after_ug < made.next_run.gap_before_ug


def test_what_belonged_to_its_moment_is_compared_without_level_and_slope() -> None:
    time_h, noise = np.linspace(0.0, 4.0, 500), np.random.default_rng(1).normal(0.0, 5.0, 500)
    beside = {
        predictive: NextRun(
            serial="A",
            time_h=time_h,
            temp_c=0.0 * time_h,
            before_ug=noise + 30.0,
            after_ug=noise + 60.0 - 2.0 * time_h,
            floor_ug=5.0,
            predictive=predictive,
        )
        for predictive in (True, False)
    }
    assert beside[True].gap_after_ug > 50.0
    # of 500 readings two are spent on the line: 5 µg but for 5/√1000
    assert beside[False].gap_after_ug == pytest.approx(5.0, abs=3 * 0.16)
    assert beside[False].gap_before_ug == pytest.approx(beside[False].gap_after_ug)
    event, line = next_run_lines(beside[False])
    assert "a model of earlier runs cannot predict" in event
    assert line.startswith("These apart: in the next run")
    assert len(next_run_lines(beside[True])) == 1


def test_the_time_left_follows_the_weights(monkeypatch):
    told, clock = [], iter([0.0, 30.0, 40.0])
    monkeypatch.setattr("accelbench.commands.demo.steps.time.monotonic", lambda: next(clock))
    steps = DemoSteps(told.append, [3.0, 1.0, 2.0])
    steps.next("a night")
    steps.next("a search")
    steps.add(4.0)
    steps.next("an experiment")
    assert told == [
        "1 of 3: a night",
        "2 of 3: a search; about 0 min 30 s left",
        "3 of 4: an experiment; about 1 min 00 s left",
    ]


def test_no_effect_and_a_wrong_one_are_refused_with_the_choices(refused, tmp_path):
    for words in (("--hidden",), ("--hidden", "indexer_harmonic")):
        said = refused("demo", *words, "--out", tmp_path / "demo")
        assert all(name in said for name in EXAMPLES)
    assert not (tmp_path / "demo").exists()


@pytest.mark.parametrize("name", [n for n, p in EXAMPLES.items() if p.term])
def test_what_is_planted_is_within_its_term(name):
    planted = plantable(name)
    one = term(planted.term)
    assert set(planted.values) == {u.name for u in (*one.coefficients, *one.parameters)}
    assert all(p.lo < planted.values[p.name] < p.hi for p in one.parameters)
    assert (
        "µ" in size_in_words(planted)
        or "ppm" in size_in_words(planted)
        or size_in_words(planted).endswith(" s")
    )
    assert plain_accelerometer("A", planted).values.keys() > planted.values.keys()


def test_an_accelerometer_made_of_a_model_file_has_no_noise(fitted):
    model = read_model(fitted.model).accelerometers[0]
    made = simulated_by(model)
    assert (made.white_ug, made.drift_ug) == (0.0, 0.0)
    assert made.values == pytest.approx(model.values())
    assert np.isclose(made.values["k0"] * 1e6, model.coefficients["k0"].value)
