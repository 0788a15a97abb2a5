"""Advice when a file is not what a command expects, from a look at the file itself."""

import csv
import tomllib
from collections.abc import Sequence
from pathlib import Path

IMPORT = "`accelbench import --map MAP.toml` converts such a log into a recorded run"
HEAD = 4096  # characters of a file that are looked at
SPREADSHEET = (";", "\t", "|")
RUN_SUFFIXES = (".csv", ".txt", ".log")


def advice(source: str, argv: Sequence[str]) -> str:
    """Return what helps, in a few words; empty when nothing is known.

    Parameters
    ----------
    source : str
        What the complaint is about: mostly a file.
    argv : sequence of str
        The command that was refused.
    """
    path = Path(source)
    try:
        if path.is_dir():
            return "it is a folder, expected a file"
        if not path.is_file():
            return ""
        text = path.read_text(encoding="utf-8-sig", errors="replace")[:HEAD]
    except (OSError, ValueError):
        return ""
    if path.suffix.lower() == ".toml":
        return _of_sidecar(text, for_rig=bool(argv) and argv[0] in ("rig", "combine"))
    if path.suffix.lower() in RUN_SUFFIXES and argv[:1] != ["import"]:
        return _of_table(text)
    return ""


def _of_sidecar(text: str, *, for_rig: bool) -> str:
    """Tell a rig run from a chamber's by the keys beside it."""
    try:
        keys = set(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValueError, RecursionError):
        return ""
    of_rig, of_chamber = "latitude_deg" in keys, "output_unit" in keys
    if of_rig and not of_chamber and not for_rig:
        return "this is a rig run: `accelbench rig calibrate` takes it"
    if of_chamber and not of_rig and for_rig:
        return "this is a chamber run: `accelbench fit` takes it"
    return ""


def _of_table(text: str) -> str:
    """Tell what a spreadsheet or another program writes by its separators and its times."""
    first, *rest = text.splitlines() or ["-"]
    if "," not in first and any(mark in first for mark in SPREADSHEET):
        return f"{IMPORT} (file.delimiter, file.decimal)"
    names, *below = [*csv.reader([first, *rest[:1]])]
    cells = below[0] if below else []
    if "time_s" in names and len(cells) == len(names):
        try:
            float(cells[names.index("time_s")])
        except ValueError:
            return f"{IMPORT} (time.format)"
    return ""
