"""Small recorded runs with a known truth, and the command line called in this process."""

import contextlib
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from accelbench.cli import main

K0_UG, K0_T1_UG, K1_T1_PPM = -400.0, 8.0, 80.0
NOISE_UG = 5.0
ANGLES = (0.0, 90.0, 180.0, 270.0, 45.0, 225.0)
SIDECAR = 'output_unit = "mA"\ngravity_m_s2 = 9.80665\nnominal_scale = 1.3\n'


def table(
    run: str,
    serial: str,
    *,
    n: int = 240,
    loop_ug: float = 0.0,
    seed: int = 1,
    low_c: float = -20.0,
) -> pd.DataFrame:
    """One run up and down again; `loop_ug` lies between heating and cooling."""
    rng = np.random.default_rng(seed)
    time_s = 30.0 * np.arange(n)
    phase = np.abs(2.0 * np.arange(n) / n - 1.0)
    temp_c = 60.0 + (low_c - 60.0) * phase
    heating = np.arange(n) < n // 2
    angle = np.array([ANGLES[k] for k in rng.integers(len(ANGLES), size=n)])
    x = temp_c - 25.0
    error = K0_UG + K0_T1_UG * x + np.where(heating, 0.5, -0.5) * loop_ug
    force = np.sin(np.deg2rad(angle)) + 1e-6 * (error + NOISE_UG * rng.standard_normal(n))
    return pd.DataFrame(
        {
            "run": run,
            "serial": serial,
            "time_s": time_s,
            "temp_c": temp_c,
            "position_deg": angle,
            "output": 1.3 * (1.0 + 1e-6 * K1_T1_PPM * x) * force,
        }
    )


def write_run(path: Path, *tables: pd.DataFrame, sidecar: str = SIDECAR) -> Path:
    pd.concat(tables).to_csv(path, index=False)
    path.with_suffix(".toml").write_text(sidecar)
    return path


def write_two_runs(folder: Path) -> Path:
    """Two runs of two accelerometers; B has a loop of 60 µg in both."""
    return write_run(
        folder / "two.csv",
        *(
            table(run, serial, loop_ug=loop, seed=10 * k + j)
            for k, run in enumerate(("r1", "r2"))
            for j, (serial, loop) in enumerate((("A", 0.0), ("B", 60.0)))
        ),
    )


@pytest.fixture
def two_runs(tmp_path: Path) -> Path:
    return write_two_runs(tmp_path)


@dataclass(frozen=True)
class Called:
    code: int
    out: str
    err: str

    @property
    def document(self) -> Mapping[str, object]:
        """Standard output is one JSON document and nothing else."""
        return json.loads(self.out)


@dataclass(frozen=True)
class Fitted:
    """The two runs fitted once for all tests; nothing may be written into its folder."""

    runs: Path
    model: Path
    report: Path
    document: dict[str, Any]
    text: str


@pytest.fixture(scope="session")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    folder = tmp_path_factory.mktemp("fitted")
    runs = write_two_runs(folder)
    model, report = folder / "model.json", folder / "report"
    said: list[str] = []
    for more in (["--out", str(model), "--report", str(report), "--json"], []):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            assert main(["fit", str(runs), *more]) == 0
        said.append(out.getvalue())
    return Fitted(runs, model, report, json.loads(said[0]), said[1])


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., Called]:
    def run(*args: str | Path) -> Called:
        capsys.readouterr()
        code = main([str(a) for a in args])
        captured = capsys.readouterr()
        return Called(code, captured.out, captured.err)

    return run


@pytest.fixture
def refused(call, tmp_path: Path) -> Callable[..., str]:
    """Call and hold it to the promise of a refusal; return what it said."""

    def contents() -> dict[Path, bytes]:
        return {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def run(*args: str | Path) -> str:
        before = contents()
        done = call(*args)
        assert done.code == 2, done
        if "--json" in args:
            said = done.err.removeprefix("accelbench: ").removesuffix("\n")
            assert done.document == {"error": said, "exit_code": 2}
        else:
            assert done.out == ""
        assert done.err.startswith("accelbench: ")
        assert done.err.count("\n") == 1, done.err
        assert "error of the program" not in done.err
        assert contents() == before
        return done.err

    return run
