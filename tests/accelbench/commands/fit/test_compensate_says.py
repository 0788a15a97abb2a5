"""What compensated values do not say by themselves, compensate says with its size."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from accelbench.shell.console import micro_g
from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign
from thermo.compensation.model_file import dump_model, make_model_file
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import write_runs

SHORT = {"runs": 2, "rates": (2.0, 2.5), "step_s": 20.0, "drift_ug": 0.0}
ONE = {"runs": 1, "rates": (2.0,), "step_s": 20.0, "drift_ug": 0.0}


def model_of(folder: Path, setup: Setup, *more: str, terms: tuple[str, ...] = tuple(TRUE)) -> Path:
    fits = fit_runs(campaign(setup, 1), terms=TermsFile(terms=(*terms, *more)))
    path = folder / "model.json"
    path.write_text(dump_model(make_model_file(fits)), encoding="utf-8")
    return path


def compensated(call, folder: Path, model: Path, setup: Setup):
    write_runs(campaign(setup, 7, first=50), folder / "new.csv")
    asked = ("compensate", folder / "new.csv", "--model", model, "--out", folder / "out.csv")
    done = call(*asked, "--json")
    assert done.code == 0
    told = " ".join(call(*asked, "--force").out.split())
    return pd.read_csv(folder / "out.csv"), done.document["accelerometers"][0], told


def test_rates_beyond_those_fitted_are_flagged_and_counted(call, tmp_path):
    model = model_of(tmp_path, Setup(**SHORT), "temperature_rate_bias")
    fast = Setup(**{**ONE, "rates": (5.0,), "step_s": 5.0})
    frame, found, told = compensated(call, tmp_path, model, fast)
    flagged = frame["flag"] == "outside_rate"
    assert flagged.mean() > 0.9
    assert found["outside_rate"] == int(flagged.sum())
    assert f"{found['outside_rate']} rates; the readings are flagged" in told


def test_without_positions_what_misalignment_leaves_in_is_told_with_its_size(call, tmp_path):
    askew = Setup(**SHORT, truth={**TRUE, "delta_o": 50_000.0})
    model = model_of(tmp_path, askew)
    runs = campaign(Setup(**ONE, truth=askew.truth), 7)
    write_runs(runs, tmp_path / "whole.csv")
    pd.read_csv(tmp_path / "whole.csv").drop(columns="position_deg").to_csv(
        tmp_path / "new.csv", index=False
    )
    (tmp_path / "whole.toml").rename(tmp_path / "new.toml")
    out = tmp_path / "out.csv"
    asked = ("compensate", tmp_path / "new.csv", "--model", model, "--out", out)
    found = call(*asked, "--json").document["accelerometers"][0]
    told = " ".join(call(*asked, "--force").out.split())
    assert found["error_after_ug"] is None
    assert "without positions, misalignment and cross-coupling are not compensated, up to" in told
    angle = np.deg2rad(runs.position_deg)
    left_ug = 1e6 * (pd.read_csv(out)["accel_compensated_g"] - np.sin(angle))
    # δo·a_p, and half of Kip where a_i·a_p is largest
    assert np.abs(left_ug).max() == pytest.approx(found["left_in_ug"], abs=30.0)
    assert found["left_in_ug"] == pytest.approx(50_000.0 + 4.0, abs=5.0)


@pytest.mark.parametrize("up", [90.0, 270.0])
def test_a_scale_factor_taken_as_nominal_leaves_at_another_site_what_is_said(call, tmp_path, up):
    """One position gives no K1: 3 % and 80 ppm/°C of it are in K0, at the gravity of the fit."""
    nominal, here = 1.302 / 1.03, 9.8322
    setup = Setup(**SHORT, positions=(up,), nominal=nominal)
    model = model_of(tmp_path, setup, terms=("k0", "k0_t1", "k0_t2"))
    there = Setup(**ONE, positions=(up,), nominal=nominal, gravity=here)
    frame, found, told = compensated(call, tmp_path, model, there)
    assert found["scale_left_ug"] == pytest.approx(1e4 * (1.0 - 9.80665 / here))
    assert "K1 was taken as nominal at every temperature" in told
    size = micro_g(found["scale_left_ug"])
    assert f"each per cent of error or temperature change of K1 leaves {size}" in told
    sign = np.sin(np.deg2rad(up))
    left_ug = sign * (1e6 * (frame["accel_compensated_g"] - sign))
    slope, level = np.polyfit(frame["temp_c"] - 25.0, left_ug, 1)
    # 4 µg of noise in 330 readings of the fit's runs and here: 0.3 µg, 0.01 µg/°C; K1_t2 bends
    assert level == pytest.approx(3.0 * found["scale_left_ug"], abs=2.0)
    assert slope == pytest.approx(80e-4 * found["scale_left_ug"], abs=0.05)
    assert np.hypot(level, slope * 40.0) > 4.0 * found["sigma_ug"]  # no sigma allows for it
