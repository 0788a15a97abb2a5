"""What is fuzzed. To add a kind of file, append a `Target`."""

import contextlib
import io
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from accelbench.cli import main
from errormodel.errors import InputError
from sinscal.recording.files import read_nav_run, read_rig_run
from sinscal.triad.plain_log import read_plain_log
from thermo.compensation.model_file import dump_model, make_model_file, read_model
from thermo.fitting.fit import TermsFile, fit_runs, read_terms
from thermo.launch.real import load_station
from thermo.planning.sequence import load_sequence
from thermo.recording.files import make_runs, read_runs
from thermo.recording.foreign.read import import_log

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """A kind of file: `call` reads the folder in which `files` lie, one of which was damaged.

    `cost` says how many calls of another target one of this takes; so many fewer are made.
    """

    name: str
    files: Mapping[str, bytes]
    damaged: str
    call: Callable[[Path], object]
    cost: int = 1


CSV = b"""run,serial,time_s,temp_c,position_deg,output,chamber_c,flag
night-1,QA-1,0,-40.125,0,0.0012,-40,
night-1,QA-2,0.25,-40.5,0,-0.0034,-40,
night-1,QA-1,10,-39.875,90,1.2512,-39.9,ok
night-1,QA-2,10.25,-39.5,90,1.2434,-39.9,
night-1,QA-1,20,-39.25,180,,-39.8,overload
night-1,QA-2,20.25,-39,180,0.0021,-39.8,0
night-2,QA-1,0,20.5,270,-1.25e0,21.5,
night-2,QA-1,10,21.5,270,-1.2506,22.5,moving
"""
FORCES = b"""run,serial,time_s,temp_c,output,a_i_g,a_p_g,note
1,A,0,20,0.1,0,1,start
1,A,1,21,0.2,0.5,0.8660254,
1,A,2,22,0.3,1,0,"a, b"
"""
SIDECAR = b"""# recorded with three accelerometers
output_unit = "mA"
gravity_m_s2 = 9.80665
nominal_scale = 1.25

[run_start_utc]
night-1 = 2026-11-22T22:15:00Z
night-2 = "2026-11-23T22:15:00+01:00"
"""
LOG = b"""# logger 7
stamp;temp;ch1;ch2;state
1700000000000;-40,5;0,0012;1,25;0
1700000001000;-40,4;0,0013;1,26;0
1700000002000;-40,3;0,0014;1,27;3
1700000009000;-40,2;0,0015;1,28;0
"""
MAP = b"""on_bad_row = "error"
[file]
delimiter = ";"
comment = "#"
encoding = "utf-8"
decimal = ","
[time]
column = "stamp"
unit = "ms"
[run]
gap_s = 5.0
[temperature]
column = "temp"
unit = "C"
[[accelerometers]]
serial = "QA-1"
column = "ch1"
unit = "A"
sign = -1
position_deg = 90.0
[[accelerometers]]
serial = "QA-2"
column = 4
a_i_g = 0.5
[output]
output_unit = "mA"
gravity_m_s2 = 9.81
nominal_scale = 1.25
[[flag]]
column = "state"
good = 0
[rows]
first = 1
"""
FORGIVING = MAP.replace(b'"error"', b'"flag"')

RIG = "time_s,cycle,dtheta_x,dtheta_y,dtheta_z,accel_x,accel_y,accel_z,temp_c,rig_angle_rad,flag\n"
RIG_CSV = (  # it turns evenly about x
    RIG
    + "".join(
        f"{0.02 * k:.2f},{k // 40},0.05,1e-5,-2e-5,0.01,{9.81 * np.sin(0.05 * k - 0.025):.4f},"
        f"{9.81 * np.cos(0.05 * k - 0.025):.4f},25.{k % 9},{0.05 * k:.4f},\n"
        for k in range(80)
        if k not in (9, 10)
    )
).encode()
RIG_SIDECAR = b"""latitude_deg = 55.75
height_m = 150
axis_of_cycle = ["x", "x"]
azimuth_deg = 30.0
gyro_noise_deg_h_rthz = 0.1
"""
NAV_CSV = b"""time_s,cycle,lat_deg,lon_deg,height_m,ve_m_s,vn_m_s,vu_m_s,\
roll_deg,pitch_deg,heading_deg
0,1,55.75,37.6,150,0,0.01,0,1.5,-2.5,359.5
1,1,55.7501,37.6001,150,0.1,-0.01,0,-179.5,89.5,0.5
0,2,55.75,37.6,151,0,0,1e-3,0,0,180
"""
NAV_SIDECAR = b"""latitude_deg = 55.75
height_m = 150
body_axes = "forward-right-down"
"""
PLAIN = b"# x y z\nt;x;y;z\n" + b"".join(
    f"{k / 100};{k};{-k};{9.8 + k}\n".encode() for k in range(40)
)

SEQUENCE = (ROOT / "examples/sequences/short.toml").read_bytes()
STATION = (ROOT / "examples/stations/f4t.toml").read_bytes()
TERMS = b"""# what to fit
terms = ["k1", "k0", "k0_t1", "k1_t1"]
t_ref_c = 25.0
"""


def _fittable() -> pd.DataFrame:
    """As many readings as a fit needs, of two accelerometers."""
    k = np.arange(40.0)
    columns = {"run": "1", "time_s": k, "temp_c": 20 + k, "position_deg": 90 * (k % 4)}
    output = 1.25 * np.sin(np.deg2rad(90 * (k % 4))) + 1e-5 * np.sin(7 * k)
    parts = [pd.DataFrame(columns | {"serial": s, "output": output}) for s in ("QA-1", "QA-2")]
    return pd.concat(parts)


def _model() -> bytes:
    """A small model file of the accelerometers in CSV."""
    runs = make_runs(_fittable(), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.25)
    fits = fit_runs(runs, terms=TermsFile(terms=("k1", "k0")))
    return dump_model(make_model_file(fits)).encode()


def _runs(folder: Path) -> object:
    return read_runs([folder / "run.csv"])


def _log(folder: Path) -> object:
    return import_log(folder / "log.txt", folder / "map.toml")


def _rig(folder: Path) -> object:
    return read_rig_run(folder / "run.csv", physics=False)


def _rig_with_physics(folder: Path) -> object:
    return read_rig_run(folder / "run.csv")


def _nav(folder: Path) -> object:
    return read_nav_run(folder / "run.csv")


def _plain(folder: Path) -> object:
    return read_plain_log(folder / "log.txt", ["x", "y", "4"])


def _sequence(folder: Path) -> object:
    return load_sequence(folder / "s.toml")


def _station(folder: Path) -> object:
    return load_station(folder / "s.toml")


def _command(*arguments_and_folder: str | Path) -> object:
    """Call the command line: exit 0, or 2 with one line and nothing written.

    An argument that names a file of the folder, or NEW for one to be written, becomes its path.
    """
    *arguments, folder = arguments_and_folder
    folder, arguments = Path(folder), [str(a) for a in arguments]
    with tempfile.TemporaryDirectory() as new:
        given = [str(folder / a) if (folder / a).is_file() else a for a in arguments]
        given = [str(Path(new) / a.removeprefix("NEW/")) if "NEW/" in a else a for a in given]
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(given)
        if code == 0:
            return None
        written = list(Path(new).iterdir())
        text = err.getvalue()
        assert code == 2, f"exit code {code}: {text}"
        assert not written, f"wrote {written}"
        if "--json" in given:
            assert set(json.loads(out.getvalue())) == {"error", "exit_code"}
        else:
            assert out.getvalue() == ""
        assert text.startswith("accelbench: "), text
        assert "error of the program" not in text, text
        assert text.count("\n") == 1, text
        assert text.endswith("\n"), text
        raise InputError("", "", text.removeprefix("accelbench: ").removesuffix("\n"))


RUN_FILES = {"run.csv": CSV, "run.toml": SIDECAR}
LOG_FILES = {"log.txt": LOG, "map.toml": MAP}
TEST_FILES = {"sequence.toml": SEQUENCE, "station.toml": STATION}
FIT_FILES = {
    "run.csv": _fittable().to_csv(index=False).encode(),
    "run.toml": SIDECAR,
    "t.toml": TERMS,
}
MODEL = _model()
COMMANDS = (
    ("import", LOG_FILES, "log.txt", ("log.txt", "--map", "map.toml", "--out", "NEW/o.csv")),
    ("import", LOG_FILES, "map.toml", ("log.txt", "--map", "map.toml", "--out", "NEW/o.csv")),
    (
        "compensate",
        {**RUN_FILES, "model.json": MODEL},
        "run.csv",
        ("run.csv", "--model", "model.json", "--out", "NEW/o.csv", "--json"),
    ),
    (
        "compensate",
        {**RUN_FILES, "model.json": MODEL},
        "model.json",
        ("run.csv", "--model", "model.json", "--out", "NEW/o.csv"),
    ),
    ("fit", FIT_FILES, "run.csv", ("run.csv", "--out", "NEW/m.json")),
    ("fit", FIT_FILES, "run.toml", ("run.csv", "--model", "t.toml", "--out", "NEW/m.json")),
    ("fit", FIT_FILES, "t.toml", ("run.csv", "--model", "t.toml", "--json")),
    ("run", TEST_FILES, "sequence.toml", ("sequence.toml", "--dry-run", "--store", "NEW/s")),
    (
        "run",
        TEST_FILES,
        "station.toml",
        ("sequence.toml", "--station", "station.toml", "--dry-run", "--store", "NEW/s"),
    ),
)
TARGETS: list[Target] = [
    Target("csv", {"run.csv": CSV, "run.toml": SIDECAR}, "run.csv", _runs),
    Target("csv with forces", {"run.csv": FORCES, "run.toml": SIDECAR}, "run.csv", _runs),
    Target("sidecar", {"run.csv": CSV, "run.toml": SIDECAR}, "run.toml", _runs),
    Target("log", {"log.txt": LOG, "map.toml": MAP}, "log.txt", _log),
    Target("log, bad rows flagged", {"log.txt": LOG, "map.toml": FORGIVING}, "log.txt", _log),
    Target("rig run", {"run.csv": RIG_CSV, "run.toml": RIG_SIDECAR}, "run.csv", _rig),
    Target(
        "rig run held against physics",
        {"run.csv": RIG_CSV, "run.toml": RIG_SIDECAR},
        "run.csv",
        _rig_with_physics,
    ),
    Target("rig sidecar", {"run.csv": RIG_CSV, "run.toml": RIG_SIDECAR}, "run.toml", _rig),
    Target("navigation outputs", {"run.csv": NAV_CSV, "run.toml": NAV_SIDECAR}, "run.csv", _nav),
    Target("navigation sidecar", {"run.csv": NAV_CSV, "run.toml": NAV_SIDECAR}, "run.toml", _nav),
    Target("plain log", {"log.txt": PLAIN}, "log.txt", _plain),
    Target("mapping", {"log.txt": LOG, "map.toml": MAP}, "map.toml", _log),
    *(
        Target(f"sequence {p.stem}", {"s.toml": p.read_bytes()}, "s.toml", _sequence)
        for p in sorted((ROOT / "examples/sequences").glob("*.toml"))
    ),
    *(
        Target(f"station {p.stem}", {"s.toml": p.read_bytes()}, "s.toml", _station)
        for p in sorted((ROOT / "examples/stations").glob("*.toml"))
    ),
    Target("terms", {"t.toml": TERMS}, "t.toml", lambda folder: read_terms(folder / "t.toml")),
    Target("model", {"m.json": MODEL}, "m.json", lambda folder: read_model(folder / "m.json")),
    *(
        Target(
            f"accelbench {name}, {damaged}",
            files,
            damaged,
            partial(_command, name, *given),
            cost=6 if name == "fit" else 1,  # what is sound is fitted
        )
        for name, files, damaged, given in COMMANDS
    ),
]
