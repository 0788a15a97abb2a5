"""`accelbench discrepancy thermal` on runs that cannot be searched: one line, nothing written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from accelbench.cli import main
from accelbench.commands.discrepancy.larger_model import model_files, model_lines
from accelbench.commands.discrepancy.text import verdict_lines
from tests.thermo.discrepancy.examples import hidden_runs
from thermo.discrepancy.find import find_discrepancy
from thermo.recording.files import RecordedRuns, make_runs, write_runs

FORCES = ["a_i_g", "a_p_g", "a_o_g"]
HEADER = "run,serial,time_s,temp_c,output\n"
SIDECAR = 'output_unit = "g"\ngravity_m_s2 = 9.8\nnominal_scale = 1.0\n'
FEWER = 60  # simulated nulls: what is said here does not hang on their number


@pytest.fixture(scope="module")
def good() -> RecordedRuns:
    return hidden_runs(1)


def again(good: RecordedRuns, frame: pd.DataFrame) -> RecordedRuns:
    return make_runs(
        frame,
        output_unit=good.output_unit,
        gravity_m_s2=good.gravity_m_s2,
        nominal_scale=good.nominal_scale,
    )


def many_runs(f: pd.DataFrame) -> pd.DataFrame:
    one = f[f["run"] == f["run"].iloc[0]]
    return pd.concat([one.assign(run=f"m{k}", output=one["output"] + 1e-9 * k) for k in range(65)])


def short_run(f: pd.DataFrame) -> pd.DataFrame:
    last = f["run"].iloc[-1]
    return pd.concat([f[f["run"] != last], f[f["run"] == last].iloc[:3]])


def second_is_dead(f: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([f, f.assign(serial="B", output=0.0)])


def other_positions(f: pd.DataFrame) -> pd.DataFrame:
    mixed = f["position_deg"].sample(frac=1.0, random_state=1).to_numpy()
    return f.assign(position_deg=mixed).drop(columns=FORCES)


def thermistor_noise(f: pd.DataFrame) -> pd.DataFrame:
    return f.assign(temp_c=25.0 + 0.002 * np.random.default_rng(5).standard_normal(len(f)))


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (lambda f: f.iloc[:3], "serial A: 3 readings, at least 200 expected"),
        (short_run, "run 4 has 3 readings, at least 30 expected; leave it out"),
        (many_runs, "65 runs, at most 64 expected"),
        (lambda f: f.assign(flag="gap"), "every reading is flagged"),
        (
            lambda f: f.assign(position_deg=0.0),
            "run 1: a_i_g and a_p_g do not agree with",
        ),
        (
            lambda f: f.assign(temp_c=25.0),
            "does not change by more than its noise of 0 °C",
        ),
        (thermistor_noise, "does not change by more than its noise of 0.00"),
        (lambda f: f.assign(output=0.0), "serial A: every reading is flagged"),
        (second_is_dead, "serial B: every reading is flagged"),
        (other_positions, "the output does not follow the positions"),
        (lambda f: f.assign(output=1000.0 * f["output"]), "nominal_scale says"),
        (lambda f: f.assign(output=-f["output"]), "nominal_scale says"),
    ],
)
def test_runs_that_cannot_be_searched_are_refused(
    refused: Callable[..., str],
    good: RecordedRuns,
    tmp_path: Path,
    spoilt: Callable[[pd.DataFrame], pd.DataFrame],
    said: str,
) -> None:
    path = tmp_path / "runs.csv"
    write_runs(again(good, spoilt(good.frame())), path)
    outputs = ("--out", tmp_path / "m.toml", "--report", tmp_path / "report")
    more = ("--experiment-out", tmp_path / "next.toml")
    told = refused("discrepancy", "thermal", path, *outputs, *more)
    assert "runs.csv" in told
    assert said in told


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("run,serial,time_s,temp_c,output\n", "no readings"),
        ("run,serial,time_s,output\n1,A,0,1\n", "no column temp_c"),
        (
            "run,serial,time_s,temp_c,output\n1,A,0,nan,1\n",
            "serial A: 1 readings, at least 200 expected",  # a run without any temperature
        ),
        ("run,serial,time_s,temp_c,output\n1,A,0,20,\n", "line 2: output is empty or not a number"),
    ],
)
def test_files_that_are_no_runs_are_refused(refused, tmp_path, text, said):
    path = tmp_path / "runs.csv"
    path.write_text(text)
    path.with_suffix(".toml").write_text(
        'output_unit = "g"\ngravity_m_s2 = 9.8\nnominal_scale = 1.0\n'
    )
    assert said in refused("discrepancy", "thermal", path, "--out", tmp_path / "m.toml")


def test_one_run_at_one_position_says_what_it_cannot_show(good: RecordedRuns) -> None:
    frame = good.frame()
    here = (frame["run"] == "1") & (frame["position_deg"] == 90.0)
    (d,) = find_discrepancy(again(good, frame[here]), draws=FEWER)
    text = "\n".join(verdict_lines(d))
    assert "One run does not show what repeats" in text
    assert {"second_order", "third_order", "cross_axis", "turn_on_offset"} <= set(d.invisible)
    assert f"These runs cannot show at all: {', '.join(d.invisible)}." in text


@pytest.mark.slow
def test_two_accelerometers_have_a_model_each(good: RecordedRuns, tmp_path: Path) -> None:
    both = pd.concat(
        [good.frame(), hidden_runs(1, {"cross": 20.0}, every_45=True).frame().assign(serial="B")]
    )
    runs = again(good, both[both["run"].isin(["1", "2"])])
    found = find_discrepancy(runs, model="bare", draws=FEWER)
    assert [[e.name for e in d.effects] for d in found] == [[], ["cross_axis"]]
    files = dict(model_files(runs, found, tmp_path / "m.toml"))
    assert [p.name for p in files] == ["m.toml", "m-1.toml", "m-2.toml", "m.json"]
    assert (
        files[tmp_path / "m.toml"] == files[tmp_path / "m-2.toml"] != files[tmp_path / "m-1.toml"]
    )
    # a head turns its accelerometers about the output axis: nothing is felt along it
    assert set(found[1].effects[0].parameters) == {"delta_o", "k_ip"}
    told = list(model_lines(found, tmp_path / "m.toml"))
    assert [line.split(":")[0] for line in told[:3]] == ["larger model", "of A alone", "of B alone"]
    assert told[3:] == [
        "left out for B, these runs cannot determine all of its parameters: delta_p, k_io"
    ]


@pytest.mark.parametrize(
    ("option", "value", "complaint"),
    [
        ("--max-hours", ["0"], "0, expected more than 0"),
        ("--temperatures", ["60", "-20"], "expected the coldest and then the hottest"),
        ("--angles", ["0,ninety"], "'0,ninety', expected angles in °"),
    ],
)
def test_what_no_laboratory_can_do_is_refused(
    option: str, value: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["discrepancy", "thermal", "none.csv", option, *value]) == 2
    assert complaint in capsys.readouterr().err
