"""A run-in through the program: emulated until it stops by itself, then judged from its file."""

from pathlib import Path

import pandas as pd
import pytest

from tests.accelbench.program import ran
from thermo.launch.emulated import relive_stored
from thermo.planning.default_station import default_station
from thermo.planning.sequence import load_sequence
from thermo.twin.assembly_stress import BIAS, CYCLE_TRAVEL_C
from thermo.twin.plant import make_plant

ROOT = Path(__file__).parents[4]
SEQUENCE = ROOT / "tests/thermo/run-in.toml"
KEYS = {
    *("serial", "before_sigma_ug", "after_sigma_ug", "cycles", "cycles_still_needed", "settled"),
}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One run-in through the program itself; nothing may be changed in it.

    Within 15 µg it would take some twenty cycles, and to decide takes as long as to run one: within
    40 µg it takes fifteen, and the first eleven decide nothing here.
    """
    folder = tmp_path_factory.mktemp("run_in")
    text = SEQUENCE.read_text(encoding="utf-8").replace("[run_in]", "[run_in]\nmin_cycles = 9")
    text = text.replace("_ug = 15.0", "_ug = 90.0").replace("_ppm = 15.0", "_ppm = 90.0")
    text = text.replace("period_s = 30.0", "period_s = 60.0")
    (folder / "late.toml").write_text(text, encoding="utf-8")
    return ran(folder, "run", "late.toml", "--store", "s.sqlite", "--out", "run.csv", "--json")


def test_the_emulated_run_in_stops_by_itself_and_says_why(done):
    _, document, stderr = done
    (one,) = document["run_in"]
    assert document["status"] == "finished"
    assert document["reason"].endswith(f"settled after {one['cycles']} cycles")
    assert one["settled"]
    assert one["cycles_still_needed"] == [0, 0]
    assert 6 <= one["cycles"] < 25
    assert one["before_sigma_ug"] > 5 * one["after_sigma_ug"]
    assert "cycles still needed" in stderr


def test_the_recorded_runs_give_the_same_verdict_and_a_report(done, call, tmp_path):
    folder, document, _ = done
    report = tmp_path / "report"
    arguments = (
        "runin",
        folder / "run.csv",
        "--sequence",
        folder / "late.toml",
        "--report",
        report,
    )
    again = call(*arguments, "--json").document
    assert again["accelerometers"] == document["run_in"]
    assert set(again["accelerometers"][0]) >= KEYS
    page = (report / "report.html").read_text(encoding="utf-8")
    assert again["accelerometers"][0]["sentence"] in page
    pictures = sorted(p.name for p in report.glob("*.png"))
    assert pictures == ["before_and_after.png", "convergence_1_QA-001.png"]
    assert "--force" in call(*arguments).err


def test_accelerometers_made_anew_for_a_resumed_test_are_as_relaxed_as_the_old(done):
    """Emulated instruments go with their process; their state is in the stored temperatures."""
    folder, document, _ = done
    sequence = load_sequence(SEQUENCE)
    plant = make_plant(default_station(sequence), new_from_assembly=True)
    relive_stored(plant, folder / "s.sqlite", document["test_id"])
    state = plant._units[0].memory[BIAS]
    cycles = document["run_in"][0]["cycles"]
    # the thermistor sees less than the chamber's 110 °C each way at 5 °C/min: it lags some 5 min
    assert 0.6 * cycles < state.travel_c / CYCLE_TRAVEL_C < cycles


def test_fewer_cycles_have_not_settled_and_say_how_many_are_needed(done, call, tmp_path):
    folder, document, _ = done
    frame = pd.read_csv(folder / "run.csv")
    first = frame["run"].drop_duplicates().tolist()[:5]
    frame[frame["run"].isin(first)].to_csv(tmp_path / "five.csv", index=False)
    (tmp_path / "five.toml").write_text((folder / "run.toml").read_text(encoding="utf-8"))
    shown = call("runin", tmp_path / "five.csv")
    assert shown.code == 1
    assert "not settled after 5 cycles" in shown.out
    (one,) = call("runin", tmp_path / "five.csv", "--json").document["accelerometers"]
    low, high = one["cycles_still_needed"]
    needed = document["run_in"][0]["cycles"] - 5  # by the stop; the truth may be a little less
    assert low <= needed
    assert high is None or high >= needed - 3
    assert one["other_law_needs"] is not None  # five cycles do not tell the laws apart
    assert one["scale"] == "fitted"
    assert not one["nothing_slow_assumed"]
    assumed = call("runin", tmp_path / "five.csv", "--nothing-slow", "--json").document
    assert "assumed that there is no process slower" in assumed["rule"]
    assert assumed["accelerometers"][0]["nothing_slow_assumed"]


def test_what_cannot_be_judged_is_told_in_one_line(done, refused, tmp_path):
    folder, _, _ = done
    frame = pd.read_csv(folder / "run.csv")
    two = frame["run"].drop_duplicates().tolist()[:2]
    frame[frame["run"].isin(two)].to_csv(tmp_path / "two.csv", index=False)
    (tmp_path / "two.toml").write_text((folder / "run.toml").read_text(encoding="utf-8"))
    assert "2 runs; a run-in needs 3" in refused("runin", tmp_path / "two.csv")
    assert "k0_limit_ug" in refused("runin", folder / "run.csv", "--k0-limit-ug", "-1")
    assert "run_in" in refused(
        "runin", folder / "run.csv", "--sequence", ROOT / "examples/sequences/short.toml"
    )
    assert "nothing.csv" in refused("runin", tmp_path / "nothing.csv")
