"""`combine` through its command: right, with serial numbers swapped, with a thermistor offset."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from accelbench.commands.combine.command import combine
from accelbench.commands.rig_calibrate.command import compensate
from accelbench.joint.chambers import chamber_model
from accelbench.joint.result_file import read_calibration
from errormodel.errors import InputError
from sinscal.judgement.result_file import ResultContent
from sinscal.library import BASIC
from sinscal.model.chamber import combined_sensors, within_range
from sinscal.model.compensate import compensate_run
from sinscal.recording.files import read_rig_run, write_rig_run
from tests.sinscal.combination.example import NOISE, CombinedTwin, make_combined_twin
from thermo.compensation.model_file import (
    FORMAT,
    ModelFile,
    dump_model,
    model_digest,
    reported_units,
    reporting_factors,
)
from thermo.uncertainty.order_choice import with_next_orders

NOMINAL = 1.3


def model_file(twin: CombinedTwin) -> ModelFile:
    """Write the twin's chamber models as `fit` would."""
    out = []
    for one in twin.chambers:
        factors = reporting_factors(one.model, NOMINAL)
        units = reported_units(one.model, "mA")
        scale = np.array([factors[n] for n in one.model.names])
        sigmas = np.sqrt(np.diag(one.cov)) * abs(scale)
        rows = zip(one.model.names, one.values * scale, sigmas, strict=True)
        out.append(
            {
                "serial": one.serial, "output_unit": "mA", "nominal_scale": NOMINAL,
                "gravity_m_s2": one.gravity_m_s2, "has_input": True, "t_ref_c": one.t_ref_c,
                "valid_c": list(one.valid_c), "valid_rate_c_per_min": [-1.0, 1.0],
                "terms": [t.name for t in one.model.terms],
                "coefficients": {
                    n: {"value": float(v), "sigma": float(s), "unit": units[n]} for n, v, s in rows
                },
                "names": list(one.model.names),
                "covariance": (one.cov * np.outer(scale, scale)).tolist(),
                "noise": {}, "residual_ug": 5.0, "heldout_residual_ug": None, "source_runs": {},
                "n_samples": 1,
            }
        )  # fmt: skip
    return ModelFile.model_validate(
        {"format": FORMAT, "model_id": "", "created_utc": "", "software": "", "accelerometers": out}
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, CombinedTwin]:
    folder = tmp_path_factory.mktemp("combine")
    twin = make_combined_twin(1)
    model = model_file(twin)
    told = [a.model_dump(mode="json") for a in model.accelerometers]
    model = model.model_copy(update={"model_id": model_digest(told)})
    (folder / "m.json").write_text(dump_model(model), encoding="utf-8")
    write_rig_run(twin.run, folder / "rig.csv")
    return folder / "m.json", folder / "rig.csv", twin


def run(*words: object) -> Result:
    return CliRunner().invoke(combine, [str(w) for w in words], standalone_mode=False)


def test_combined_result_is_told_and_written(
    recorded: tuple[Path, Path, CombinedTwin], tmp_path: Path
) -> None:
    model, rig, twin = recorded
    out, report = tmp_path / "r.json", tmp_path / "report"
    told = run("--thermal", model, "--rig", rig, "--out", out, "--report", report, "--json")
    assert told.exception is None, told.output
    assert told.return_value == 0
    document = json.loads(told.stdout)
    assert "rig and chamber" in told.stderr
    assert {*ResultContent.model_fields} < {*document}  # the keys of rig calibrate, all of them
    truth = twin.at_reference()
    for name, one in document["parameters"].items():
        if name in truth and one["unit"] in ("m/s²", "1", "rad/s", "rad"):
            assert abs(one["value"] - truth[name]) < 5 * one["sigma"], name
    assert document["contradictions"] == []
    assert {*document["flight_m"]} == {"no_thermal", "before", "combined"}
    assert document["flight_m"]["combined"] < document["flight_m"]["no_thermal"]
    assert document["parameters"]["k0_t1_x"]["unit"] == "µg/°C"
    assert {"accel_bias_x", "accel_scale_z", "k1_t1_y"} < {*document["prior_pull"]}
    assert json.loads(out.read_text(encoding="utf-8"))["result_id"] == document["result_id"]
    page = (report / "report.html").read_text(encoding="utf-8")
    assert "rig against chamber" in page
    untested, clock, *_ = document["not_tested"]
    assert untested.startswith("missing effects, so there are no protection level")
    assert "clock" in clock
    assert f"not tested: {untested}" in page
    assert {"temperature.png", "models.png", "moved.png", "flight.png", "estimates.png"} < {
        p.name for p in report.iterdir()
    }


def test_the_flight_file_takes_all_errors_out_at_any_temperature(
    recorded: tuple[Path, Path, CombinedTwin], tmp_path: Path
) -> None:
    """Written by `combine`, applied by `rig compensate` to the run it was made of."""
    model, rig, twin = recorded
    out, corrected = tmp_path / "r.json", tmp_path / "corrected.csv"
    assert run("--thermal", model, "--rig", rig, "--out", out).return_value == 0
    told = CliRunner().invoke(
        compensate,
        [str(rig), "--calibration", str(out), "--out", str(corrected), "--json"],
        standalone_mode=False,
    )
    assert told.exception is None, told.output
    assert json.loads(told.stdout)["warnings"] == []
    done = read_rig_run(corrected)
    # within its sigmas the truth compensates alike: what is left is what the estimate is wrong by
    sensors = combined_sensors(twin.chambers, BASIC)
    exact = compensate_run(twin.run, sensors, np.array([twin.truth[n] for n in sensors.names]))
    g = twin.chambers[0].gravity_m_s2
    assert np.abs(done.accel - exact.accel).max() < 20e-6 * g  # sigmas of bias are 2 µg
    assert np.abs(twin.run.accel - exact.accel).max() > 1000e-6 * g
    noise = NOISE.accel * np.sqrt(50.0)
    left = np.linalg.norm(done.accel, axis=1) - g
    # |f| is g: with the errors gone noise alone is left, its mean known to noise / √n
    assert abs(left.std() / noise - 1.0) < 0.02
    assert abs(left.mean()) < 20e-6 * g
    assert done.temp_c is not None
    assert twin.run.temp_c is not None
    np.testing.assert_allclose(done.temp_c, twin.run.temp_c, atol=1e-5)


def test_a_flight_file_changed_by_hand_or_of_unknown_terms_is_refused(
    recorded: tuple[Path, Path, CombinedTwin], tmp_path: Path
) -> None:
    model, rig, _ = recorded
    out = tmp_path / "r.json"
    run("--thermal", model, "--rig", rig, "--out", out)
    text = out.read_text(encoding="utf-8")
    for old, new, said in (
        ('"t_ref_c": 25.0', '"t_ref_c": 24.0', "result_id"),
        ('"k0_t1"', '"k0_tt1"', "no term 'k0_tt1'"),
        ('"accelbench-combined-calibration"', '"accelbench-rig-calibration"', "r.json"),
    ):
        out.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(InputError, match=said):
            read_calibration(out)


def test_temperatures_beyond_the_chamber_s_are_told(
    recorded: tuple[Path, Path, CombinedTwin],
) -> None:
    twin = recorded[2]
    narrow = [replace(c, valid_c=(0.0, 26.0)) for c in twin.chambers]
    inside = within_range(twin.run, [c.valid_c for c in narrow])
    assert inside.temp_c is not None
    assert inside.temp_c.max() == 26.0
    assert [w.partition(":")[0] for w in inside.warnings] == ["outside_range"] * 3


@pytest.mark.slow  # a contradiction is told below; that of serial numbers found in tests/sinscal
def test_swapped_serial_numbers_are_reported(recorded: tuple[Path, Path, CombinedTwin]) -> None:
    model, rig, twin = recorded
    x, y, z = (c.serial for c in twin.chambers)
    told = run("--thermal", model, "--rig", rig, "--accelerometers", f"{y},{x},{z}", "--json")
    assert told.return_value == 1
    assert f"{x} is on x, not on y" in " ".join(json.loads(told.stdout)["contradictions"])


def test_a_thermistor_offset_is_reported(
    recorded: tuple[Path, Path, CombinedTwin], tmp_path: Path
) -> None:
    model, _, twin = recorded
    assert twin.run.temp_c is not None
    rig = tmp_path / "warm.csv"
    write_rig_run(replace(twin.run, temp_c=twin.run.temp_c + np.array([0.0, 3.0, 0.0])), rig)
    told = run("--thermal", model, "--rig", rig, "--json")
    assert told.return_value == 1
    assert "the thermistor of y reads 3." in " ".join(json.loads(told.stdout)["contradictions"])


def test_an_unknown_serial_number_is_refused(recorded: tuple[Path, Path, CombinedTwin]) -> None:
    model, rig, _ = recorded
    told = run("--thermal", model, "--rig", rig, "--accelerometers", "a,b,c")
    assert isinstance(told.exception, InputError)
    assert "no model for serial 'a'" in str(told.exception)


def test_the_covariance_comes_back_in_own_units(
    recorded: tuple[Path, Path, CombinedTwin],
) -> None:
    twin = recorded[2]
    for had, got in zip(twin.chambers, model_file(twin).accelerometers, strict=True):
        range_x = (had.valid_c[0] - had.t_ref_c, had.valid_c[1] - had.t_ref_c)
        _, _, cov = with_next_orders(had.model, had.values, had.cov, range_x)
        np.testing.assert_allclose(chamber_model(got).cov, cov, rtol=1e-12)
