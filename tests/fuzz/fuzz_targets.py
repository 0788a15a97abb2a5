"""What is fuzzed. To add a kind of file, append a `Target`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from thermo.importing import import_log
from thermo.recording import read_runs
from thermo.sequence import load_sequence
from thermo.station_shell import load_station

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """A kind of file: `call` reads the folder in which `files` lie, one of which was damaged."""

    name: str
    files: Mapping[str, bytes]
    damaged: str
    call: Callable[[Path], object]


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


def _runs(folder: Path) -> object:
    return read_runs([folder / "run.csv"])


def _log(folder: Path) -> object:
    return import_log(folder / "log.txt", folder / "map.toml")


def _sequence(folder: Path) -> object:
    return load_sequence(folder / "s.toml")


def _station(folder: Path) -> object:
    return load_station(folder / "s.toml")


TARGETS: list[Target] = [
    Target("csv", {"run.csv": CSV, "run.toml": SIDECAR}, "run.csv", _runs),
    Target("csv with forces", {"run.csv": FORCES, "run.toml": SIDECAR}, "run.csv", _runs),
    Target("sidecar", {"run.csv": CSV, "run.toml": SIDECAR}, "run.toml", _runs),
    Target("log", {"log.txt": LOG, "map.toml": MAP}, "log.txt", _log),
    Target("log, bad rows flagged", {"log.txt": LOG, "map.toml": FORGIVING}, "log.txt", _log),
    Target("mapping", {"log.txt": LOG, "map.toml": MAP}, "map.toml", _log),
    *(
        Target(f"sequence {p.stem}", {"s.toml": p.read_bytes()}, "s.toml", _sequence)
        for p in sorted((ROOT / "data/sequences").glob("*.toml"))
    ),
    *(
        Target(f"station {p.stem}", {"s.toml": p.read_bytes()}, "s.toml", _station)
        for p in sorted((ROOT / "data/stations").glob("*.toml"))
    ),
]
