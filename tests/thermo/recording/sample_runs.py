"""A small recorded run, made and put into files."""

from pathlib import Path

import numpy as np
import pandas as pd

from thermo.recording.files import RecordedRuns, make_runs

SIDECAR = 'output_unit = "mA"\ngravity_m_s2 = 9.80665\nnominal_scale = 1.25\n'
HEADER = "run,serial,time_s,temp_c,position_deg,output\n"
LINES = "1,A,0,20.5,0,0.001\n1,A,10,20.6,90,1.25\n1,B,0,20.1,0,0.002\n"


def put(
    folder: Path, text: str | bytes, name: str = "run.csv", sidecar: str | None = SIDECAR
) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    if sidecar is not None:
        path.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
    return path


def sample(runs: int = 2, rows: int = 50, **columns: object) -> RecordedRuns:
    rng = np.random.default_rng(7)
    n = 3 * runs * rows
    frame = pd.DataFrame(
        {
            "run": np.repeat([f"r{i}" for i in range(runs)], 3 * rows),
            "serial": np.tile(["A", "B", "C"], runs * rows),
            "time_s": np.tile(np.repeat(10.0 * np.arange(rows), 3), runs)
            + rng.uniform(0, 1, n) * 0.3,
            "temp_c": rng.uniform(-40, 70, n),
            "position_deg": rng.choice([0.0, 90.0, 180.0, 270.0], n),
            "output": rng.standard_normal(n) * 1e-3 + 1 / 3,
            **columns,
        }
    )
    return make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.25)
