"""A model file carries everything needed to apply the model, and refuses to be half of it."""

import json

import numpy as np
import pytest

from errormodel.errors import InputError
from tests.thermo.examples import TRUTH, runs_of
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import ModelFile, dump_model, make_model_file, read_model
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import make_runs


@pytest.fixture(scope="module")
def runs():
    return runs_of(11)


@pytest.fixture(scope="module")
def models(runs) -> ModelFile:
    return make_model_file(fit_runs(runs, terms=TermsFile(terms=tuple(TRUTH)), holdout=("3",)))


def test_it_survives_the_disk(models, tmp_path) -> None:
    path = tmp_path / "model.json"
    path.write_text(dump_model(models), encoding="utf-8")
    assert read_model(path) == models


def test_it_can_be_traced(models, runs) -> None:
    one = models.of("A")
    assert one.source_runs == {r: runs.digest(r) for r in ("1", "2")}
    assert one.valid_c[0] == pytest.approx(-40.0, abs=0.02)  # the thermistor's noise
    assert one.valid_c[1] == pytest.approx(70.0, abs=0.2)  # the turning point between readings
    assert one.coefficients["k1"].unit == "mA/g"
    assert one.coefficients["k0"].unit == "µg"
    sigmas = np.sqrt(np.diag(one.covariance))
    assert sigmas == pytest.approx([one.coefficients[n].sigma for n in one.names])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["accelerometers"][0].update(t_ref_c=20.0), "changed by hand"),
        (lambda d: d.update(format="other"), "format"),
        (lambda d: d["accelerometers"][0]["terms"].append("k9"), "no term 'k9'"),
        (lambda d: d["accelerometers"][0]["coefficients"].pop("k0"), "coefficients and names"),
        (lambda d: d["accelerometers"][0].update(covariance=[[1.0]]), "covariance"),
        (lambda d: d.update(surprise=1), "surprise"),
        (lambda d: d.update(accelerometers=[]), "accelerometers"),
        (lambda d: d["accelerometers"].append(d["accelerometers"][0]), "listed twice"),
    ],
)
def test_a_damaged_file_is_refused_by_name(models, tmp_path, change, message) -> None:
    data = json.loads(dump_model(models))
    change(data)
    path = tmp_path / "model.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError, match=message) as refused:
        read_model(path)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_text_that_is_not_json_is_refused(tmp_path) -> None:
    path = tmp_path / "model.json"
    path.write_text("{")
    with pytest.raises(InputError, match="not JSON"):
        read_model(path)


def test_a_run_that_was_not_fitted_is_compensated_to_the_noise(models, runs) -> None:
    unseen = runs.select(runs=["3"])
    done = compensate(unseen, models)
    truth = np.sin(np.deg2rad(unseen.position_deg))
    left_ug = 1e6 * (done.accel_compensated_g - truth)
    # one run of four drift correlation times: its own drift's rms is 3 µg to some 50 %, and what
    # the two fitted runs' drift did to the model adds half its variance again
    assert np.sqrt(np.mean(left_ug**2)) < np.hypot(5.0, 1.5 * np.hypot(3.0, 3.0 / np.sqrt(2)))
    raw_ug = 1e6 * (done.accel_g - truth)
    assert np.sqrt(np.mean(raw_ug**2)) > 1000.0
    assert not done.outside_range.any() or np.mean(done.outside_range) < 0.1


def test_terms_in_the_input_are_undone_without_knowing_the_input(models, runs) -> None:
    """Apply the model forwards, compensate backwards: the input comes back."""
    one = models.of("A")
    part = runs.select(runs=["1"])
    angle = np.deg2rad(part.position_deg)
    x = part.temp_c - 25.0
    c = {n: one.coefficients[n].value * 1e-6 for n in one.names if n != "k1"}
    k0 = c["k0"] + sum(c[f"k0_t{k}"] * x**k for k in (1, 2, 3))
    k1 = one.coefficients["k1"].value * (1 + c["k1_t1"] * x + c["k1_t2"] * x**2)
    a_i, a_p = np.sin(angle), np.cos(angle)
    bracket = k0 + a_i + c["k2"] * a_i**2 + c["k3"] * a_i**3
    bracket += c["delta_o"] * a_p + c["k_ip"] * a_i * a_p
    frame = part.frame()
    frame["output"] = k1 * bracket
    clean = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    left = compensate(clean, models).accel_compensated_g - a_i
    inside = (part.temp_c >= one.valid_c[0]) & (part.temp_c <= one.valid_c[1])
    assert np.max(np.abs(left[inside])) < 1e-12


def test_temperature_outside_the_range_is_clipped_and_said(models, runs) -> None:
    frame = runs.select(runs=["1"]).frame().iloc[:50].copy()
    frame["temp_c"] = 95.0
    hot = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    assert compensate(hot, models).outside_range.all()
    frame["temp_c"] = models.of("A").valid_c[1]
    edge = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    expected = compensate(edge, models)
    assert not expected.outside_range.any()
    np.testing.assert_allclose(
        compensate(hot, models).accel_compensated_g, expected.accel_compensated_g, atol=1e-15
    )


def test_another_unit_or_serial_is_refused(models, runs) -> None:
    frame = runs.select(runs=["1"]).frame()
    volts = make_runs(frame, output_unit="V", gravity_m_s2=9.80665, nominal_scale=1.3)
    with pytest.raises(InputError, match="output in V, the model is for mA"):
        compensate(volts, models)
    frame["serial"] = "Z"
    other = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    with pytest.raises(InputError, match="no model for serial 'Z'"):
        compensate(other, models)
