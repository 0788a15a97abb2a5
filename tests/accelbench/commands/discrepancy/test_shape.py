"""An effect that the library has no name for: built, written, and taken by the other commands."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accelbench.commands.discrepancy import thermal_work
from tests.thermo.discrepancy.examples import NOMINAL, hidden_runs
from thermo.library import thermal_library
from thermo.recording.files import RecordedRuns, write_runs

RATES = (1.5, 1.5)
FEW = ("bias_hysteresis", "temperature_rate_bias", "bias_kink", "second_order")
WHITE_UG, DRIFT_UG, RUN_S, TAU_S = 5.0, 3.0, 13600.0, 3600.0
# White noise and drift of one run more, and three sigmas of its drift's mean square: a run is some
# four times the drift's correlation, so that it has RUN_S/TAU_S independent values.
LARGEST_UG = np.sqrt(WHITE_UG**2 + DRIFT_UG**2 * (1.0 + 3.0 * np.sqrt(2.0 * TAU_S / RUN_S)))


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """A few effects and simulated nulls: which stand in the library does not matter here."""
    whole = thermal_work.find_discrepancy
    effects = [thermal_library().by_name[name] for name in FEW]

    def few(runs: RecordedRuns, **given: Any) -> Any:
        return whole(runs, draws=60, effects=effects, **given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thermal_work, "find_discrepancy", few)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs")
    write_runs(hidden_runs(2, {"wave": 20.0}, rates=RATES), path / "runs.csv")
    write_runs(hidden_runs(3, {"wave": 20.0}, rates=RATES[:1]), path / "new.csv")
    return path


def test_a_shape_is_written_fitted_compensated_and_missing_no_more(
    call: Callable[..., Any], refused: Callable[..., str], folder: Path, tmp_path: Path
) -> None:
    runs, out, own = folder / "runs.csv", tmp_path / "larger.toml", tmp_path / "larger.py"
    report, model = tmp_path / "report", tmp_path / "larger.json"
    words = ("discrepancy", "thermal", runs, "--out", out)
    done = call(*words, "--report", report, "--json")
    assert done.code == 0, done.err
    found = done.document
    assert (found["verdict"], found["where"]["factor"]) == ("unexplained_repeatable", "temperature")
    shape = found["shape"]
    assert (shape["name"], shape["quantity"], shape["times"]) == ("my_effect_1", "temperature", "")
    assert shape["formula"]["family"] == "sine"
    # 110 °C are 5.5 periods and formulas come an eighth of one apart: 20 °C/5.5/8
    assert abs(shape["formula"]["at"] - 20.0) < 20.0 / 5.5 / 8.0
    assert 0.0 <= shape["formula"]["loses_share"] < 0.05
    assert shape["heldout"]["after_ug"] < 1.1 * found["floor_ug"] < shape["heldout"]["before_ug"]
    sizes = {len(shape[key]) for key in ("knots", "values", "sigmas")}
    assert len(sizes) == 1
    # the broken line cuts the tops between knots: a few µg of 20
    assert 0.5 * np.ptp(shape["values"]) == pytest.approx(20.0, abs=4.0)
    assert shape["library"] == str(own)
    assert found["rest"]["factor"] == "temperature"
    assert {p.name for p in report.iterdir()} >= {"report.html", "shape_A.png"}
    assert "my_effect_1: An effect without a name" in (report / "report.html").read_text()
    for one in (out, model):
        one.rename(one.with_stem("kept"))
    assert f"{own}: exists already" in refused(*words)
    for one in (out, model):
        one.with_stem("kept").rename(one)

    library, fitted = ("--library", own), tmp_path / "fitted.json"
    assert call("fit", runs, "--model", out, "--out", fitted, *library).code == 0
    for one in (model, fitted):
        new = tmp_path / f"new_{one.stem}.csv"
        compensate = ("compensate", folder / "new.csv", "--model", one, "--out", new)
        done = call(*compensate, *library, "--json")
        assert done.code == 0, done.err
        assert done.document["accelerometers"][0]["error_after_ug"] < LARGEST_UG
    assert "needs the library larger.py" in refused(*compensate, "--force")
    nothing = call("discrepancy", "thermal", runs, "--model", model, *library, "--json")
    assert (nothing.document["verdict"], nothing.document["shape"]) == ("nothing", None)


@pytest.mark.slow
def test_a_second_shape_has_the_next_number(
    call: Callable[..., Any], folder: Path, tmp_path: Path
) -> None:
    own = tmp_path / "earlier.py"
    own.write_text(
        "from thermo.library.shape import shape_term\n"
        "TERMS = {'my_effect_1': lambda: shape_term('my_effect_1', 'rate', [0, 1], [[0, 1]])}\n"
    )
    out = tmp_path / "second.toml"
    words = ("discrepancy", "thermal", folder / "runs.csv", "--out", out, "--library", own)
    done = call(*words)
    assert done.code == 0, done.err
    assert "def my_effect_2():" in (tmp_path / "second.py").read_text()
    text = "".join(done.out.split())  # lines are broken to the width of the terminal
    assert f"--library{own}--library{tmp_path / 'second.py'}" in text
    assert "my_effect_2:Aneffectwithoutaname" in text


def test_without_a_shape_the_verdict_stands_alone(
    call: Callable[..., Any], folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "m.toml"
    words = ("discrepancy", "thermal", folder / "runs.csv", "--out", out, "--no-shape", "--json")
    done = call(*words)
    assert done.code == 0, done.err
    assert done.document["verdict"] == "unexplained_repeatable"
    assert done.document["shape"] is None
    assert not out.with_suffix(".py").exists()


def test_what_follows_a_recorded_column_is_told_with_it(
    call: Callable[..., Any], tmp_path: Path
) -> None:
    for name, seed, rates in (("runs", 4, RATES), ("new", 5, RATES[:1])):
        runs = hidden_runs(seed, rates=rates)
        frame = runs.frame()
        rng = np.random.default_rng(seed)
        # a supply that changes every four minutes
        steps = np.floor(frame["time_s"].to_numpy() / 240.0).astype(int)
        supply = rng.uniform(14.0, 16.0, steps.max() + 2)[steps + (frame["run"] == "2").to_numpy()]
        frame["output"] += NOMINAL * 20e-6 * np.sin(np.pi * (supply - 15.0))
        frame = frame.assign(supply_v=supply, operator="Ann", reading=np.arange(len(frame)))
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
        write_runs(runs, tmp_path / "side.csv")
        (tmp_path / f"{name}.toml").write_text((tmp_path / "side.toml").read_text())
        (tmp_path / "side.toml").unlink()
        (tmp_path / "side.csv").unlink()
    runs, out = tmp_path / "runs.csv", tmp_path / "larger.toml"
    done = call("discrepancy", "thermal", runs, "--out", out, "--json")
    assert done.code == 0, done.err
    assert "columns looked at beside those of every run: supply_v" in done.err
    assert "column operator is not looked at" in done.err
    assert "column reading is not looked at" in done.err
    assert done.document["where"]["factor"] == "supply_v"
    assert done.document["shape"]["quantity"] == "supply_v"
    assert "Signal(name='supply_v'" in (tmp_path / "larger.py").read_text()
    words = ("--model", tmp_path / "larger.json", "--library", tmp_path / "larger.py")
    new = call("compensate", tmp_path / "new.csv", *words, "--out", tmp_path / "c.csv", "--json")
    assert new.code == 0, new.err
    assert new.document["accelerometers"][0]["error_after_ug"] < LARGEST_UG
