"""`accelbench rig triad`, called as the group calls it."""

import gzip
import json
from pathlib import Path

import click
import numpy as np
import pytest

from accelbench.cli import main
from accelbench.commands.rig_triad.command import triad
from errormodel.errors import InputError
from sinscal.frames.earth import Site
from sinscal.recording.files import write_rig_run
from sinscal.recording.run import RigFacts, RigRun
from tests.sinscal.triad.example import COUNTS, G, recording

GAMMA = np.array([[3e-3, 0, 0], [1e-3, -2e-3, 0], [4e-4, -6e-4, 1e-3]])
BIAS = np.array([0.1, -0.05, 0.02])


def call(*arguments: str | Path) -> None:
    triad.main([str(a) for a in arguments], standalone_mode=False)


def log_file(folder: Path) -> Path:
    raw, _ = recording(seed=1, positions=18)
    raw[: raw.shape[0] // 2] = np.round(raw[: raw.shape[0] // 2])
    path = folder / "log.txt"
    np.savetxt(path, np.column_stack([0.01 * np.arange(raw.shape[0]), raw]), fmt="%.3f")
    return path


def rig_file(folder: Path, *, warm: bool = False) -> Path:
    """A rig run turned by hand: the forces of the example through Γ and Δf⁰."""
    ideal = np.array([1.0, 1.0, 1.0, 0, 0, 0, 0, 0, 0])
    force, _ = recording(seed=2, positions=20, noise=0.0, values=ideal)
    rng = np.random.default_rng(3)
    n = force.shape[0]
    temp = 25.0 + np.linspace(-10, 10, n)
    slope = 1e-3 * (temp - 25.0)[:, None] if warm else 0.0
    run = RigRun(
        time_s=0.01 * np.arange(1, n + 1),
        step_s=np.full(n, 0.01),
        cycle=np.zeros(n, dtype=int),
        gyro=1e-4 * rng.standard_normal((n, 3)),
        accel=force @ (np.eye(3) + GAMMA).T + BIAS + slope + 3e-3 * rng.standard_normal((n, 3)),
        temp_c=np.column_stack([temp] * 3),
        facts=RigFacts(site=Site(lat_rad=float(np.deg2rad(50.0)))),
    )
    write_rig_run(run, folder / "rig.csv")
    return folder / "rig.csv"


def test_a_plain_log_in_counts(tmp_path, capsys):
    path = log_file(tmp_path)
    given = ("--columns", "2,3,4", "--gravity", G, "--time-column", "1")
    out, report = tmp_path / "triad.json", tmp_path / "report"
    call(path, *given, "--out", out, "--report", report, "--json")
    document = json.loads(capsys.readouterr().out)
    values = np.array([document["parameters"][n]["value"] for n in document["names"]])
    e = values - COUNTS
    # F(9, 9) at p = 0.001 is 10.1
    assert e @ np.linalg.solve(np.array(document["covariance"]), e) / 9 < 10.1
    assert document["parameters"]["bias_x"]["unit"] == "count"
    assert document["rms_after_m_s2"] < 0.1 * document["rms_before_m_s2"]
    assert len(document["positions"]) == 18
    assert json.loads(out.read_text(encoding="utf-8"))["matrix"] == document["matrix"]
    assert (report / "triad.png").read_bytes().startswith(b"\x89PNG")
    assert "triad.png" in (report / "report.html").read_text(encoding="utf-8")


def test_the_formula_in_the_result_is_how_it_is_applied(tmp_path, capsys):
    path = log_file(tmp_path)
    call(path, "--columns", "2,3,4", "--gravity", G, "--rate-hz", "100", "--json")
    document = json.loads(capsys.readouterr().out)
    raw = np.loadtxt(path)[:, 1:]
    first, last = (document["positions"][0][k] for k in ("first_row", "last_row"))
    mean = raw[first - 1 : last].mean(axis=0)
    force = np.array(document["matrix"]) @ (mean - np.array(document["bias"]))
    residual = document["positions"][0]["residual_m_s2"]
    assert np.linalg.norm(force) - G == pytest.approx(residual, abs=1e-9)


def test_a_rig_run_gives_the_errors_of_the_contract(tmp_path, capsys):
    """Its gravity is another than the site's: the forces were made with that of the example."""
    call(rig_file(tmp_path), "--gravity", G, "--json")
    document = json.loads(capsys.readouterr().out)
    truth = {
        "accel_bias_x": BIAS[0],
        "accel_scale_y": GAMMA[1, 1],
        "accel_misalignment_zy": GAMMA[2, 1],
    }
    for name, value in truth.items():
        found = document["errors"][name]
        assert abs(found["value"] - value) < 5 * found["sigma"]
        assert found["sigma"] < 2e-3


def test_slopes_over_temperature(tmp_path, capsys):
    call(rig_file(tmp_path, warm=True), "--gravity", G, "--temperature", "--json")
    found = json.loads(capsys.readouterr().out)["parameters"]["bias_t_y"]
    assert abs(found["value"] - 1e-3) < 5 * found["sigma"]
    assert found["unit"] == "m/s2/°C"


def test_text_for_people(tmp_path, capsys):
    call(rig_file(tmp_path))
    text = capsys.readouterr().out
    assert "20 positions at rest" in text
    assert "f = T·K·(a − b)" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--columns", "2,3,4"), "needs --gravity"),
        (("--columns", "2,3", "--gravity", "9.8"), "expected three"),
        (("--columns", "2,3,4", "--gravity", "9.8"), "either --rate-hz or --time-column"),
        (("--columns", "2,3,4", "--gravity", "1", "--rate-hz", "9"), r"expected 9\.7 to 9\.9"),
        (("--columns", "2,3,4", "--gravity", "9.8", "--rate-hz", "0"), "expected 1 to 100000"),
        (("--rate-hz", "100"), "require --columns"),
    ],
)
def test_misuse_is_told(tmp_path, arguments, words):
    with pytest.raises(click.UsageError, match=words):
        call(log_file(tmp_path), *arguments)


def test_too_few_rests_write_nothing(tmp_path):
    raw, _ = recording(seed=1, positions=7)
    path = tmp_path / "log.txt"
    np.savetxt(path, raw)
    given = ("--columns", "1,2,3", "--gravity", G, "--rate-hz", "100")
    with pytest.raises(InputError, match="7 rests of 1 s or more found in 40 s, expected 9"):
        call(path, *given, "--out", tmp_path / "o.json", "--report", tmp_path / "report")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.txt"]


def test_the_input_is_never_written_over(tmp_path):
    path = log_file(tmp_path)
    before = path.read_bytes()
    with pytest.raises(InputError, match="is an input"):
        call(path, "--columns", "2,3,4", "--gravity", G, "--rate-hz", "100", "--out", path)
    assert path.read_bytes() == before


CASES = Path(__file__).parents[3] / "cases"
SITE = ("--gravity", "9.80665", "--unit", "m/s2")


def case(folder: Path, name: str) -> Path:
    path = folder / f"{name}.csv"
    path.write_bytes(gzip.decompress((CASES / f"{name}.csv.gz").read_bytes()))
    return path


def test_a_converter_of_a_fiftieth_of_a_g_gives_its_24_positions(tmp_path, capsys):
    """Noise of 0.002 m/s², steps of 0.0383; sensors' scales 1.02, 0.99, 1.005 were put in."""
    path = case(tmp_path, "triad_coarse_adc")
    call(path, "--columns", "x,y,z", *SITE, "--rate-hz", "100", "--json")
    document = json.loads(capsys.readouterr().out)
    assert len(document["positions"]) == 24
    truth = {"scale_x": 1 / 1.02, "scale_y": 1 / 0.99, "scale_z": 1 / 1.005}
    truth |= {"bias_x": 0.12, "bias_y": -0.08, "bias_z": 0.2}
    for name, value in truth.items():
        found = document["parameters"][name]
        assert abs(found["value"] - value) < 3 * found["sigma"], name
        assert found["sigma"] < (0.001 if "scale" in name else 0.006)
    call(path, "--columns", "x,y,z", *SITE, "--rate-hz", "100")
    assert "the readings go in steps of 0.0383 m/s2" in capsys.readouterr().out


def test_times_in_microseconds_are_refused_or_told(tmp_path, capsys):
    path = case(tmp_path, "triad_microseconds")
    given = (path, "--columns", "x,y,z", *SITE, "--time-column", "us")
    with pytest.raises(InputError, match=r"us grows by 10000 .* are the times in µs\?"):
        call(*given, "--out", tmp_path / "o.json")
    assert not (tmp_path / "o.json").exists()
    assert main(["rig", "triad", *map(str, given), "--trust-units"]) == 1
    assert "are the times in µs?" in capsys.readouterr().out


def test_a_log_in_g_declared_as_m_s2_is_refused_or_told(tmp_path, capsys):
    values = np.loadtxt(case(tmp_path, "triad_microseconds"), delimiter=",", skiprows=1)[:, 1:]
    path = tmp_path / "g.txt"
    np.savetxt(path, values / 9.80665)
    given = ("rig", "triad", str(path), "--columns", "1,2,3", *SITE, "--rate-hz", "100")
    assert main([*given]) == 2
    assert "are they in g?" in capsys.readouterr().err
    assert main([*given, "--trust-units", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert "are they in g?" in document["doubtful_units"][0]
    # the same triad, its scales in (m/s²) per g
    assert document["parameters"]["scale_x"]["value"] == pytest.approx(9.80665 / 1.02, rel=3e-4)


def test_means_of_positions(tmp_path, capsys):
    raw, rests = recording(seed=3, positions=24)
    path = tmp_path / "means.csv"
    means = np.array([raw[a:b].mean(axis=0) for a, b in rests])
    np.savetxt(path, means, delimiter=";", header="x;y;z", comments="")
    given = (path, "--columns", "x,y,z", "--gravity", G, "--means")
    call(*given, "--sigma", "0.15", "--report", tmp_path / "report", "--json")
    document = json.loads(capsys.readouterr().out)
    e = np.array([document["parameters"][n]["value"] for n in document["names"]]) - COUNTS
    assert e @ np.linalg.solve(np.array(document["covariance"]), e) < 27.9  # χ², 9 dof, p = 0.001
    call(*given)
    assert "24 positions given, 24 fitted" in capsys.readouterr().out
    for more in (("--rate-hz", "9"), ("--time-column", "1")):
        with pytest.raises(click.UsageError, match="are not allowed with --means"):
            call(*given, *more)
    with pytest.raises(click.UsageError, match="--sigma requires --means"):
        call(path, "--columns", "x,y,z", "--gravity", G, "--rate-hz", "9", "--sigma", "1")
    with pytest.raises(click.UsageError, match="--means needs --columns"):
        call(path, "--means")
