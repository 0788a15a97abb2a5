import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
MEASURED = ROOT.parent / "shared/data/imu_thermal_loop/imu_raw_data.csv"
KEYS = {
    "serial",
    "t_ref_c",
    "valid_c",
    "coefficients",
    "residual_raw_ug",
    "residual_ug",
    "heldout_residual_ug",
    "heating_minus_cooling_ug",
    "n_samples",
}


def test_json_has_the_promised_keys_and_recovers_the_truth(fitted):
    a, b = fitted.document["accelerometers"]
    assert set(a) >= KEYS
    assert (a["serial"], b["serial"]) == ("A", "B")
    for name, truth in (("k0", -400.0), ("k0_t1", 8.0), ("k1_t1", 80.0)):
        found = a["coefficients"][name]
        assert set(found) == {"value", "sigma", "unit"}
        # 4 sigma: one in 16,000 for a true sigma; seeds are fixed
        assert found["value"] == pytest.approx(truth, abs=4 * found["sigma"])
    assert a["coefficients"]["k0"]["unit"] == "µg"
    assert a["coefficients"]["k1"]["unit"] == "mA/g"
    assert a["n_samples"] == 480
    # the noise is 5 µg; ten percent is five sigma of an rms of 480 readings less coefficients
    assert a["residual_ug"] == pytest.approx(5.0, rel=0.1)
    assert a["heldout_residual_ug"] == pytest.approx(5.0, rel=0.15)
    assert a["residual_raw_ug"] > 100 * a["residual_ug"]
    assert a["valid_c"] == pytest.approx([-20.0, 60.0], abs=1.0)
    assert a["higher_order_helps"] is False
    assert (a["k0_order"], a["k1_order"]) == (1, 1)
    assert not a["thermal_history_left"]
    assert "delta_p" in a["not_separable"]


def test_a_loop_in_both_runs_is_told_as_thermal_history(fitted):
    b = fitted.document["accelerometers"][1]
    # 60 µg were put in; the mean of 5 readings a cell and direction has 3 µg, the median less
    assert b["heating_minus_cooling_ug"] == pytest.approx(60.0, abs=5.0)
    assert b["heating_minus_cooling_at_40c_ug"] == pytest.approx(60.0, abs=15.0)
    assert b["thermal_history_left"] is True
    assert "no polynomial" in b["loop_sentence"]
    assert len(b["heating_minus_cooling_curve"]) > 10
    text = fitted.text
    assert "thermal-history effect is left" in text
    assert "a higher order does not help" in text


def test_text_says_the_numbers_in_words(fitted):
    out = fitted.text
    raw_ug = fitted.document["accelerometers"][0]["residual_raw_ug"]
    assert f"residual {raw_ug:.0f} µg ({raw_ug / 1e3:.2f} mg) with constants only" in out
    assert "these runs cannot determine: delta_p" in out
    assert "at 40 °C" in out
    assert "valid from -20" in out
    assert fitted.document["model_id"] in out


def test_writes_the_model_and_the_report(fitted):
    assert fitted.document["out"] == str(fitted.model)
    assert json.loads(fitted.model.read_text())["model_id"] == fitted.document["model_id"]
    assert fitted.document["report"] == str(fitted.report / "report.html")
    assert (fitted.report / "report.html").is_file()


def test_replaces_nothing_unless_told_so(call, refused, two_runs, tmp_path):
    model, report = tmp_path / "m.json", tmp_path / "report"
    model.write_text("old")
    report.mkdir()
    (report / "report.html").write_text("old")
    assert "--force" in refused("fit", two_runs, "--out", model)
    assert "--force" in refused("fit", two_runs, "--report", report)
    assert call("fit", two_runs, "--out", model, "--force").code == 0
    assert "model_id" in model.read_text()


def test_holdout_takes_one_run_or_several(call, refused, two_runs):
    one = call("fit", two_runs, "--holdout", "r2", "--json").document["accelerometers"][0]
    assert one["heldout_runs"] == ["r2"]
    assert one["n_samples"] == 240
    assert list(one["source_runs"]) == ["r1"]
    assert "no run" in refused("fit", two_runs, "--holdout", "nobody")
    # both: then nothing is left to fit
    assert "no run is left" in refused("fit", two_runs, "--holdout", "r1", "r2")


def test_terms_may_be_given(call, refused, two_runs, tmp_path):
    terms = tmp_path / "terms.toml"
    terms.write_text('terms = ["k1", "k0", "k0_t1"]\n')
    a = call("fit", two_runs, "--model", terms, "--json").document["accelerometers"][0]
    assert list(a["coefficients"]) == ["k1", "k0", "k0_t1"]
    assert a["higher_order_helps"] is None
    terms.write_text('terms = ["k1", "k0", "delta_o", "delta_p"]\n')
    assert "delta_p" in refused("fit", two_runs, "--model", terms)
    terms.write_text('terms = ["nonsense"]\n')
    assert "nonsense" in refused("fit", two_runs, "--model", terms)


@pytest.mark.parametrize("name", ["two.csv", "two.toml", "terms.toml"])
def test_never_writes_over_an_input_even_by_force(refused, two_runs, tmp_path, name):
    (tmp_path / "terms.toml").write_text("t_ref_c = 20.0\n")
    arguments = ("--model", tmp_path / "terms.toml", "--out", tmp_path / name, "--force")
    assert "is an input" in refused("fit", two_runs, *arguments)


def test_a_folder_that_is_not_there_is_no_place_for_a_model(refused, two_runs, tmp_path):
    assert "folder" in refused("fit", two_runs, "--out", tmp_path / "nowhere/m.json")
    assert "folder" in refused("fit", two_runs, "--out", tmp_path)
    assert "expected a folder" in refused("fit", two_runs, "--report", two_runs)


@pytest.fixture
def measured(call, tmp_path):
    if not MEASURED.is_file():
        pytest.skip("the measured data are not there: ../shared/data/imu_thermal_loop")
    out = tmp_path / "imu.csv"
    done = call(
        "import",
        MEASURED,
        "--map",
        ROOT / "examples/maps/imu_thermal_loop.toml",
        "--out",
        out,
        "--json",
    )
    assert done.code == 0
    assert done.document["serials"] == ["x", "y", "z"]
    return out


def test_measured_thermal_loop(call, measured):
    x, y, z = call("fit", measured, "--json").document["accelerometers"]
    # residual std of a cubic published with the data: 0.0064, 0.0173, 0.0443 m/s²
    for one, residual_mg in ((x, 0.65), (y, 1.76), (z, 4.52)):
        assert one["residual_ug"] == pytest.approx(1e3 * residual_mg, rel=0.01)
        assert one["higher_order_helps"] is False
        assert one["thermal_history_left"] is True
        assert one["input_known"] is False
        assert one["n_samples"] == 8399  # the first, from before the sensor was ready, is left out
    # heating minus cooling at equal temperature as published, m/s²
    for one, lo, hi in ((x, -0.014, -0.007), (y, 0.033, 0.042), (z, 0.051, 0.146)):
        assert lo < one["heating_minus_cooling_at_40c_ug"] * 9.80665e-6 < hi


def test_measured_thermal_loop_in_words(call, measured):
    out = call("fit", measured).out
    assert out.count("a higher order does not help") == 3
    assert out.count("m/s² at 40 °C") == 3
    assert out.count("no polynomial in temperature can describe") == 3
    assert "(4.52 mg) with the model" in out
