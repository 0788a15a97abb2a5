"""A synthetic effect with a signal of its own, in one file, goes through all of the program.

Nothing of it is known anywhere else: what is named, fitted, compensated and emulated here comes
from the file alone.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accelbench.cli import main
from accelbench.shell.library import library
from errormodel.errors import InputError
from sinscal.library import rig_library
from tests.thermo.examples import NOMINAL, simulate_run
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import make_model_file
from thermo.discrepancy.foresee import foresee_effects
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.launch.emulated import run_emulated
from thermo.library import thermal_library
from thermo.planning.default_station import default_station
from thermo.planning.sequence import load_sequence
from thermo.recording.files import make_runs, read_runs, write_runs
from thermo.recording.signals import recorded_signals
from thermo.station.job import make_job
from thermo.station.observers.live import LiveEstimate
from thermo.station.observers.live_model import LIVE_TERMS
from thermo.store.files import open_existing_store, recorded_runs
from thermo.twin.plant import Twin, TwinSettings
from thermo.twin.planted import PLAIN_TERMS, plain_accelerometer, plantable

HERE = Path(__file__).parent
STILL_HEAD = TwinSettings(head_offset_arcsec=0.0, head_harmonic_arcsec=0.0)
CHAMBER = """
import numpy as np
from thermo.library.effects import Example, ThermalEffect, one_column, plain_form
from thermo.recording.signals import Signal

NOMINAL_V = 15.0

def emulated(at):
    return NOMINAL_V + 0.4 * np.sin(2.0 * np.pi * at.elapsed_h / 0.13)

def supply_bias():
    return one_column(
        "supply_bias", symbol="sv", unit="µg/V",
        sentence="The bias follows the supply voltage.",
        column=lambda r: r["supply_v"] - NOMINAL_V,
        needs=("supply_v",), prior_sigma=1e-3, min_share=1e-3,
    )

SIGNALS = [
    Signal(
        name="supply_v", unit="V", sentence="Supply voltage.", recorded=True, within=(0.0, 40.0),
        emulated=emulated,
    )
]
TERMS = {"supply_bias": supply_bias}
EFFECTS = [
    ThermalEffect(
        name="supply_sensitivity", sentence="The bias follows the supply voltage, {size}.",
        forms=plain_form("supply_bias"), experiment="the supply changed in steps",
        example=Example(term="supply_bias", values={"supply_bias": 200e-6}),
    )
]
"""
RIG = """
from errormodel.terms import Told
from sinscal.frames.earth import STANDARD_G
from sinscal.library.groups import PHASE, Group, effect_of, term_of

def make(c):
    name = f"accel_cubed_{c.letter}"
    sentence = "The output has a part proportional to the input cubed."
    part = (name, f"K3{c.letter}", "1/(m/s²)²", lambda r: r[c.input] ** 3)
    return term_of(name, sentence, [part])

CUBED = Group(
    name="accel_cubed", kinds=("accel",), make=make, prior_sigma=1e-3 / STANDARD_G**2,
    told=Told(unit="µg/g³", size=1e-6 / STANDARD_G**2), formula="K3·f³",
)
GROUPS = [CUBED]
EFFECTS = [
    effect_of(
        CUBED, "The accelerometers' outputs have a part proportional to the input cubed.",
        "turn about horizontal axes in whole turns", PHASE,
    )
]
"""


def written(folder: Path, text: str, name: str = "own.py") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def said(capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> dict[str, Any]:
    assert main([str(w) for w in (*words, "--json")]) == code, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert main([str(w) for w in words]) == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("own"), CHAMBER)


@pytest.fixture(scope="module")
def measured(own: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A test on the emulated station: its recorded file, and what was said of it live."""
    folder = tmp_path_factory.mktemp("measured")
    sequence = load_sequence(HERE / "accelbench/mini.toml")
    with library(own):
        same = [a.model_copy(update={"nominal_scale": 1.3}) for a in sequence.accelerometers]
        sequence = sequence.model_copy(update={"accelerometers": tuple(same)})
        config = default_station(sequence)
        assert list(config.signal_channels) == ["supply_v"]
        units = {
            "QA-001": plain_accelerometer("QA-001", plantable("supply_sensitivity")),
            "QA-003": plain_accelerometer("QA-003"),
        }
        live = LiveEstimate(dict.fromkeys(units, 1.3), terms=(*LIVE_TERMS, "supply_bias"))
        plant = Twin(config.inputs, units, STILL_HEAD, 3, signals=config.signal_channels)
        store = folder / "store.sqlite"
        job = make_job(sequence, store, config)
        outcome = run_emulated(job, plant=plant, observers=[live])
        assert outcome.status == "finished"
        with open_existing_store(store) as opened:
            (record,) = recorded_runs(opened, outcome.test_id)
        write_runs(record, folder / "run.csv")
        plan = job.plan
        foreseen = foresee_effects([plan.run(k) for k in range(1, plan.runs + 1)])
    return folder / "run.csv", {
        "live": {serial: live.parameters(serial)["supply_bias"] for serial in units},
        "invisible": foreseen.invisible,
    }


def test_the_station_records_the_signal_and_the_live_estimate_takes_the_term(
    own: Path, measured: tuple[Path, dict[str, Any]]
) -> None:
    path, told = measured
    assert "supply_v" in path.read_text(encoding="utf-8").splitlines()[0].split(",")
    with library(own):
        runs = read_runs([path])
        assert [one.name for one in recorded_signals()] == ["supply_v"]
    supply = runs.more["supply_v"]
    assert np.ptp(supply) == pytest.approx(0.8, abs=0.05)  # a sine of 0.4 V
    assert runs.digest(runs.run_ids[0]) == read_runs([path]).digest(runs.run_ids[0])
    assert "supply_v" not in read_runs([path]).more  # without the file it is no signal
    assert "supply_sensitivity" not in told["invisible"]
    for serial, true in (("QA-001", 200e-6), ("QA-003", 0.0)):
        value, sigma = told["live"][serial]
        assert sigma < 20e-6
        assert abs(value - true) < 4.0 * sigma, serial


def test_it_is_named_fitted_and_compensated_from_the_recorded_file(
    own: Path,
    measured: tuple[Path, dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, _ = measured
    larger, model, out = (tmp_path / n for n in ("larger.toml", "model.json", "out.csv"))
    search = ("discrepancy", "thermal", path, "--model", "bare", "--library", own)
    found = said(capsys, *search, "--out", larger)
    named = {a["serial"]: [e["name"] for e in a["effects"]] for a in found["accelerometers"]}
    assert named["QA-001"] == ["supply_sensitivity"]
    # an event is found in one of 125 sets in which nothing is hidden; it has no bare name here
    (other,) = (a for a in found["accelerometers"] if a["serial"] == "QA-003")
    assert other["verdict"] in ("nothing", "alias")
    assert "supply_bias" not in thermal_library().terms  # it was part of it for the command alone

    # the fitted file beside it is taken as it is, and so are its terms
    fitted = said(capsys, "fit", path, "--model", larger, "--library", own, "--out", model)
    one = next(a for a in fitted["accelerometers"] if a["serial"] == "QA-001")
    value = one["coefficients"]["supply_bias"]
    assert value["unit"] == "µg/V"
    assert abs(value["value"] - 200.0) < 4.0 * value["sigma"]
    for file in (model, larger.with_suffix(".json")):
        said(capsys, "compensate", path, "--model", file, "--library", own, "--out", out, "--force")

    # without the file, or with another one, a model of it is refused in a line that helps
    for words in (
        ("fit", path, "--model", larger),
        ("compensate", path, "--model", model, "--out", out, "--force"),
    ):
        assert "--library" in refused(capsys, *words)
    other = written(tmp_path, CHAMBER.replace("15.0", "14.0"))
    words = ("compensate", path, "--model", model, "--library", other, "--out", out, "--force")
    assert "unchanged since the model was made" in refused(capsys, *words)


@settings(max_examples=4, deadline=None)
@given(
    size_ug=st.floats(-300.0, 300.0),
    period_h=st.floats(0.1, 0.8),
    seed=st.integers(0, 2**31),
)
def test_whatever_its_size_and_course_a_fit_finds_it_and_compensation_takes_it_out(
    own: Path, size_ug: float, period_h: float, seed: int
) -> None:
    frame = simulate_run(np.random.default_rng(seed), n=900)
    frame["supply_v"] = 15.0 + 0.4 * np.sin(2.0 * np.pi * frame["time_s"] / 3600.0 / period_h)
    plain_ug = np.asarray(frame["output"]) / NOMINAL * 1e6
    frame["output"] += NOMINAL * 1e-6 * size_ug * (frame["supply_v"] - 15.0)
    with library(own):
        runs = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL)
        terms = (*PLAIN_TERMS, "k0_t3", "k2", "k3", "delta_o", "k_ip", "supply_bias")
        (fitted,) = fit_runs(runs, terms=TermsFile(terms=terms))
        # the model is relative to the accelerometer's own scale, 0.2 % from the nominal one
        value, sigma = 1e6 * fitted.fit.value("supply_bias"), 1e6 * fitted.fit.sigma("supply_bias")
        assert abs(value - size_ug / 1.00176) < 5.0 * sigma  # one in a million lies beyond
        done = compensate(runs, make_model_file([fitted]))
    theta = np.deg2rad(np.asarray(frame["position_deg"]))
    left_ug = 1e6 * (done.accel_compensated_g - np.sin(theta))
    # 5 µg of noise and 3 µg of drift, and a tenth more for what the coefficients are known to
    assert np.std(left_ug) < 1.1 * np.hypot(5.0, 3.0)
    assert plain_ug.size == left_ug.size


RIG_PROGRAMME = """
latitude_deg = 55.75
height_m = 150.0
acceleration_deg_s2 = 10.0
{cycles}
[recording]
rate_hz = 20.0
angle = true

[noise]
gyro_deg_h_rthz = 0.1
accel_m_s2_rthz = 0.001
angle_arcsec_rthz = 15.0

[errors]
{errors}
"""


def test_a_rig_effect_is_simulated_calibrated_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = written(tmp_path, RIG)
    true = {
        f"accel_cubed_{a}": size * 1e-6 / 9.80665**2
        for a, size in zip("xyz", (900, -700, 800), strict=True)
    }
    segments = ", ".join(
        f"{{ rate_deg_s = {rate}, duration_s = 60.0 }}" for rate in (12.0, -12.0, 24.0, -24.0)
    )
    cycles = "".join(f'[[cycles]]\naxis = "{a}"\nsegments = [{segments}]\n' for a in "xyz")
    errors = "\n".join(f"{name} = {value!r}" for name, value in true.items())
    text = RIG_PROGRAMME.format(cycles=cycles, errors=errors)
    programme = written(tmp_path, text, "programme.toml")
    run, result, model = (tmp_path / n for n in ("run.csv", "result.json", "model.toml"))
    said(capsys, "rig", "simulate", programme, "--library", own, "--out", run)
    made = said(
        capsys, "rig", "calibrate", run, "--mode", "precise", "--groups", "accel_cubed",
        "--library", own, "--out", result,
    )  # fmt: skip
    for name, value in true.items():
        one = made["parameters"][name]
        assert 0.0 < one["sigma"] < made["prior"][name]["sigma"]
        assert abs(one["value"] - value) < 4.0 * one["sigma"], name
    assert "K3·f³" in made["formula"]
    assert [one["name"] for one in made["library"]] == ["own.py"]
    assert "--library" in refused(
        capsys, "rig", "compensate", run, "--calibration", result, "--out", tmp_path / "c.csv"
    )
    found = said(capsys, "discrepancy", "rig", run, "--library", own, "--out", model)
    assert [e["name"] for e in found["effects"]] == ["accel_cubed"]
    assert "accel_cubed" in model.read_text(encoding="utf-8")
    assert "accel_cubed" not in rig_library().groups


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x = 1", "defines none of TERMS, SIGNALS, GROUPS, EFFECTS"),
        ("1 / 0", "ZeroDivisionError"),
        ("TERMS = {'k0': None}", "expected a mapping of names to functions"),
        ("TERMS = {'k0': lambda: None}", "k0 is in the library already"),
        ("TERMS = {'mine': lambda: None}", "mine: expected a term of that name"),
        ("EFFECTS = [1]", "expected a ThermalEffect or a RigEffect"),
        ("GROUPS = [1]", "expected a sequence of sinscal.library.groups.Group"),
        (CHAMBER.replace('name="supply_v"', 'name="temp_c"'), "is in use or not a valid name"),
        (RIG.replace("prior_sigma=1e-3 / STANDARD_G**2,", ""), "prior_sigma"),
        (RIG.replace('name="accel_cubed"', 'name="lever_arm"'), "lever_arm is in the library"),
    ],
)
def test_a_file_that_is_no_member_is_refused_and_leaves_the_library_as_it_was(
    tmp_path: Path, text: str, complaint: str
) -> None:
    before = thermal_library(), rig_library(), recorded_signals()
    with pytest.raises(InputError) as refusal, library(written(tmp_path, text)):
        pass
    assert complaint in str(refusal.value)
    assert "own.py" in str(refusal.value)
    assert (thermal_library(), rig_library(), recorded_signals()) == before
