import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.accelbench.conftest import SIDECAR, table, write_run
from thermo.recording.files import read_runs


@pytest.fixture
def model(fitted, tmp_path):
    return Path(shutil.copy(fitted.model, tmp_path / "model.json"))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_adds_three_columns_and_the_error_falls_to_the_noise(
    call, two_runs, model, tmp_path, suffix
):
    out = tmp_path / f"out.{suffix}"
    done = call("compensate", two_runs, "--model", model, "--out", out, "--json")
    assert done.code == 0
    frame = pd.read_csv(out) if suffix == "csv" else pd.read_parquet(out)
    before = pd.read_csv(two_runs)
    assert list(frame.columns) == [
        *before.columns, "accel_g", "accel_compensated_g", "accel_sigma_g", "flag",
    ]  # fmt: skip
    np.testing.assert_array_equal(frame["output"], before["output"])
    np.testing.assert_array_equal(frame["accel_g"], before["output"] / 1.3)
    a = frame[frame["serial"] == "A"]
    error_ug = 1e6 * (a["accel_compensated_g"] - np.sin(np.deg2rad(a["position_deg"])))
    # 5 µg of noise were put in; ten percent is more than four sigma of an rms of 480 readings
    assert float(np.sqrt(np.mean(error_ug**2))) == pytest.approx(5.0, rel=0.1)
    shown = done.document["accelerometers"][0]
    assert shown["error_after_ug"] == pytest.approx(float(np.sqrt(np.mean(error_ug**2))), rel=1e-6)
    assert shown["error_before_ug"] > 100 * shown["error_after_ug"]
    assert len(read_runs([out])) == len(frame)  # it is a recorded run with its sidecar


def test_twice_is_refused(call, refused, two_runs, model, tmp_path):
    for suffix in ("csv", "parquet"):
        once = tmp_path / f"once.{suffix}"
        assert call("compensate", two_runs, "--model", model, "--out", once, "--force").code == 0
        again = ("compensate", once, "--model", model, "--out", tmp_path / "twice.csv")
        assert "already compensated" in refused(*again)


def test_readings_outside_the_range_are_flagged(call, model, tmp_path):
    cold = write_run(tmp_path / "cold.csv", table("r3", "A", low_c=-50.0, seed=5))
    out = tmp_path / "out.csv"
    done = call("compensate", cold, "--model", model, "--out", out, "--json")
    frame = pd.read_csv(out, keep_default_na=False)
    outside = frame["temp_c"].astype(float) < -20.0
    assert outside.sum() > 10
    assert (frame["flag"] == "outside_range").tolist() == outside.tolist()
    assert done.document["accelerometers"][0]["outside_range"] == int(outside.sum())


def test_flagged_readings_keep_their_flag(call, model, tmp_path):
    frame = table("r3", "A", low_c=-50.0, seed=5).assign(flag="")
    frame.loc[frame.index[:2], "flag"] = "moving"
    frame.loc[frame.index[5], ["flag", "output"]] = ["overload", np.nan]
    odd = write_run(tmp_path / "odd.csv", frame)
    out = tmp_path / "out.csv"
    assert call("compensate", odd, "--model", model, "--out", out).code == 0
    done = pd.read_csv(out, keep_default_na=False)
    assert done["flag"][0] == "moving+outside_range"
    assert done["flag"][5] == "overload"
    assert done["accel_compensated_g"][5] == ""


def test_what_does_not_fit_is_refused(call, refused, two_runs, model, tmp_path):
    out = tmp_path / "out.csv"
    other = write_run(tmp_path / "other.csv", table("r1", "C"))
    said = refused("compensate", other, "--model", model, "--out", out)
    assert "model.json" in said
    assert "'C'" in said
    volts = write_run(tmp_path / "volts.csv", table("r1", "A"), sidecar=SIDECAR.replace("mA", "V"))
    assert "output in V" in refused("compensate", volts, "--model", model, "--out", out)
    changed = tmp_path / "changed.json"
    changed.write_text(model.read_text().replace('"value": -', '"value": ', 1))
    assert "model_id" in refused("compensate", two_runs, "--model", changed, "--out", out)
    assert "not JSON" in refused("compensate", two_runs, "--model", two_runs, "--out", out)
    assert ".parquet" in refused(
        "compensate", two_runs, "--model", model, "--out", tmp_path / "o.x"
    )
    assert "is an input" in refused(
        "compensate", two_runs, "--model", model, "--out", two_runs, "--force"
    )


def test_does_not_write_over_a_sidecar_that_belongs_to_something_else(
    call, refused, two_runs, model, tmp_path
):
    (tmp_path / "out.toml").write_text("mine = 1\n")
    arguments = ("compensate", two_runs, "--model", model, "--out", tmp_path / "out.csv")
    assert "out.toml" in refused(*arguments)
    assert call(*arguments, "--force").code == 0
