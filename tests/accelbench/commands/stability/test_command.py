"""`accelbench stability` on small runs: keys, exit codes, report, refusals."""

import json
import sqlite3
from pathlib import Path

import pandas as pd
import pytest

from tests.accelbench.conftest import K0_UG, table, write_run

COEFFICIENT_KEYS = {"mean", "sigma_run", "ci95", "max_minus_min", "unit", "trend_p"}
COMPONENTS = {"accelerometer", "run", "direction", "position", "noise"}
LIMITS = """
[limits.k0]
sigma_run = 25.0
[curve_ug]
max = 200.0
[grades.A]
spread_ug = 15.0
[[between]]
after = "r1"
before = "r2"
power_off = true
remount = true
"""


def moved(frame: pd.DataFrame, by_ug: float) -> pd.DataFrame:
    return frame.assign(output=frame["output"] + 1.3e-6 * by_ug)


@pytest.fixture
def six_runs(tmp_path: Path) -> Path:
    """Two accelerometers, six runs: A repeats, B does not."""
    steps = (0.0, 90.0, -80.0, 120.0, -60.0, 40.0)
    return write_run(
        tmp_path / "six.csv",
        *(
            moved(table(f"r{k + 1}", serial, n=120, seed=100 * j + k), step * j)
            for k, step in enumerate(steps)
            for j, serial in enumerate("AB")
        ),
    )


def test_json_has_the_promised_keys(call, six_runs, tmp_path):
    limits = tmp_path / "limits.toml"
    limits.write_text(LIMITS)
    done = call("stability", six_runs, "--limits", limits, "--at-c", "25", "--at-c", "50", "--json")
    assert done.code == 1  # B fails
    found = done.document
    assert "IEEE Std 528" in found["definition"]
    assert "power off yes" in found["definition"]
    assert set(found["variance_components"]) >= COMPONENTS
    assert found["variance_components"]["run"]["dof"] == 10
    a, b = found["accelerometers"]
    assert (a["serial"], a["n_runs"], b["serial"]) == ("A", 6, "B")
    for one in (a, b):
        assert all(set(c) >= COEFFICIENT_KEYS for c in one["coefficients"].values())
        assert {"k0", "k1", "k0_at_50c", "k1_at_50c"} <= set(one["coefficients"])
        assert {"rms", "max"} <= set(one["curve_distance_ug"])
    assert (a["verdict"], b["verdict"]) == ("pass", "fail")
    assert (a["rank"], b["rank"], a["grade"], b["grade"]) == (1, 2, "A", None)
    k0 = b["coefficients"]["k0"]
    lo, hi = k0["ci95"]
    assert lo < 81.0 < hi  # the standard deviation of the six steps
    assert k0["max_minus_min"] == pytest.approx(200.0, abs=10.0)  # 5 µg of noise, 120 readings
    assert a["coefficients"]["k0"]["mean"] == pytest.approx(K0_UG, abs=3.0)
    assert a["coefficients"]["k0"]["chart"]["limits"] is None


def test_text_report_and_between_file(call, refused, six_runs, tmp_path):
    between, report = tmp_path / "between.toml", tmp_path / "report"
    between.write_text('[[between]]\nafter = "r3"\nrest_h = 12\nnote = "shelf"\n')
    arguments = ["stability", six_runs, "--between", between, "--report", report]
    done = call(*arguments)
    assert done.code == 0
    assert "rest 12 h" in done.out
    assert "shelf" in done.out
    assert "no limits given" in done.out
    assert "variance components" in done.out
    html = (report / "report.html").read_text(encoding="utf-8")
    assert "Definition of repeatability" in html
    assert html.count("data:image/png") == 4  # overview, components, two accelerometers
    assert "http" not in html
    names = {p.name for p in report.iterdir()}
    assert names == {
        "report.html",
        "overview.png",
        "components.png",
        "runs_A.png",
        "runs_B.png",
    }
    assert "--force" in refused(*arguments)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "no RUN.csv"),
        (["--store", "x.sqlite"], "--store and --test together"),
        (["a.csv", "--store", "x.sqlite", "--test", "t"], "no RUN.csv beside"),
    ],
)
def test_misuse_is_told(refused, arguments, said):
    assert said in refused("stability", *arguments)


def test_refusals(refused, six_runs, tmp_path):
    one = write_run(tmp_path / "one.csv", table("r1", "A"))
    assert "two or more" in refused("stability", one)
    bad = tmp_path / "bad.toml"
    bad.write_text("[limits.k0]\nsigma = 3\n")
    assert "limits.k0.sigma" in refused("stability", six_runs, "--limits", bad)
    bad.write_text("[limits.delta_p]\nsigma_run = 3\n")
    assert "delta_p" in refused("stability", six_runs, "--limits", bad)
    bad.write_text("[curve_ug]\nmax = 3\n")
    assert "[[between]] only" in refused("stability", six_runs, "--between", bad)


def test_a_single_run_is_left_out_and_a_sigma_that_is_not_shown_is_an_upper_limit(call, tmp_path):
    runs = [table(f"r{k}", "A", n=120, seed=k) for k in range(3)]
    file = write_run(tmp_path / "some.csv", *runs, table("r0", "B", n=120, seed=9))
    done = call("stability", file)
    assert done.code == 0, done.err
    assert "B: left out, 1 run" in done.out
    assert "< " in done.out
    assert "ppm from nominal" in done.out
    document = call("stability", file, "--json").document
    (left_out,) = document["left_out"]
    assert (left_out["serial"], left_out["run"]) == ("B", None)
    (one,) = document["accelerometers"]
    low, high = one["spread_ci95_ug"]
    assert low <= one["spread_ug"] <= high
    assert document["common_events"] == []


def test_a_test_of_a_store_is_compared_and_doubtful_units_are_refused(call, refused, tmp_path):
    sequence = Path(__file__).parents[2] / "mini.toml"
    store = tmp_path / "s.sqlite"
    ran = call("run", sequence, "--store", store, "--json")
    assert ran.code == 0, ran.err
    test_id = json.loads(ran.out)["test_id"]
    done = call("stability", "--store", store, "--test", test_id, "--json")
    assert done.code == 0, done.err
    found = done.document
    assert [a["serial"] for a in found["accelerometers"]] == ["QA-001", "QA-003"]
    assert found["runs"] == [f"{test_id}-1", f"{test_id}-2"]
    # 0.05 h of rest, and the minutes in which the chamber settles before the next run begins
    assert 0.05 <= found["between"][0]["rest_h"] < 0.5
    with sqlite3.connect(store) as opened:  # as if the sequence had said µA for mA
        (text,) = opened.execute("select sequence_toml from tests").fetchone()
        assert "nominal_scale = 1.3" in text
        opened.execute("update tests set sequence_toml = ?", (text.replace("= 1.3", "= 1300.0"),))
    opened.close()
    said = refused("stability", "--store", store, "--test", test_id)
    assert "is output_unit or nominal_scale a thousandth of what it should be?" in said
