"""A small log of somebody else's with its mapping, read as a recorded run."""

from pathlib import Path

from thermo.recording.files import RecordedRuns
from thermo.recording.foreign.read import import_log

MAP = """
[time]
column = "t"
unit = "s"
[temperature]
column = "T"
[[accelerometers]]
serial = "A"
column = "u"
[output]
output_unit = "V"
gravity_m_s2 = 9.81
nominal_scale = 1.2
"""
LOG = "t,T,u,v,s\n5,20,0.1,1,ok\n6,21,0.2,2,ok\n7,22,0.3,3,warm\n"


def run(folder: Path, log: str | bytes = LOG, mapping: str = MAP) -> RecordedRuns:
    (folder / "log.txt").write_bytes(log.encode() if isinstance(log, str) else log)
    (folder / "map.toml").write_text(mapping, encoding="utf-8")
    return import_log(folder / "log.txt", folder / "map.toml")


def changed(*changes: tuple[str, str]) -> str:
    mapping = MAP
    for old, new in changes:
        assert old in mapping
        mapping = mapping.replace(old, new)
    return mapping
