"""Columns of a user's own that no library declares: which of them a reading can be held against."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.io.tables import PARQUET_SUFFIXES, column_names
from thermo.recording.runs import GOOD_FLAGS, number_columns
from thermo.recording.signals import RESERVED, Signal, signals

# What `compensate` adds to a recorded run: made of the output, not a condition of it.
MADE_OF_OUTPUT = frozenset({"accel_g", "accel_compensated_g", "accel_sigma_g"})
# More would take so many degrees of freedom that the noise could not be told beside them.
MOST_COLUMNS = 6
LARGEST = 1e12  # as `Signal.within`
# Of a column's variance, that its straight line over the output leaves, if it is no copy of it.
OWN_VARIANCE = 1e-4
KEYS = ("run", "serial", "output")


def further_columns(
    paths: Sequence[Path | str], tell: Callable[[str], None] = lambda line: None
) -> tuple[Signal, ...]:
    """Return the columns that every file has and no library declares, as recorded signals.

    Taken are columns of numbers with a value in every good reading, which rise and fall within a
    run: a clock or a counter is time, and what is constant in a run belongs to the run. A copy of
    the output is left out.

    Parameters
    ----------
    paths : sequence of path
        Recorded runs, CSV or Parquet.
    tell : callable
        Told in a line which columns are taken, and why others are not.
    """
    tables = [_candidates(Path(path)) for path in paths]
    first = [str(n) for n in tables[0].columns] if tables else []
    names = [n for n in first if all(n in table for table in tables)]
    taken: list[str] = []
    for name in (n for n in names if n not in (*KEYS, "flag")):
        problem = next(filter(None, (_problem(table, name) for table in tables)), "")
        if not problem and len(taken) == MOST_COLUMNS:
            problem = (
                f"{MOST_COLUMNS} are looked at; declare it by --library to have it before them"
            )
        if problem:
            tell(f"column {name} is not looked at: {problem}")
        else:
            taken.append(name)
    if taken:
        tell(f"columns looked at beside those of every run: {', '.join(taken)}")
    return tuple(Signal(name=n, unit="", sentence=_sentence(n), recorded=True) for n in taken)


def signal_of_column(name: str) -> Signal:
    """Return the signal that is a recorded column: the one declared, or one of its name."""
    declared = {one.name: one for one in signals()}
    return declared.get(name) or Signal(name=name, unit="", sentence=_sentence(name), recorded=True)


def _sentence(name: str) -> str:
    return f"Recorded column {name}."


def _candidates(path: Path) -> pd.DataFrame:
    """Return the columns that nothing declares, with those that rows are told by.

    What cannot be read is left to the reader of the runs to refuse.
    """
    try:
        known = {*number_columns(), *(one.name for one in signals()), *RESERVED, *MADE_OF_OUTPUT}
        present = column_names(path)
        further = [n for n in present if n.isidentifier() and n not in known]
        unique = [n for n in further if present.count(n) == 1]
        if not unique or not set(KEYS) <= set(present):
            return pd.DataFrame()
        wanted = [*unique, *KEYS, *(["flag"] if "flag" in present else [])]
        return _read(path, wanted).rename(columns=str.strip)[wanted]
    except (InputError, OSError, ValueError, KeyError):
        return pd.DataFrame()


def _read(path: Path, names: Sequence[str]) -> pd.DataFrame:
    reader: Any = pd  # its readers have too many types
    if path.suffix.lower() in PARQUET_SUFFIXES:
        return reader.read_parquet(path, columns=list(names))

    def wanted(name: str) -> bool:
        return name.strip() in names

    return reader.read_csv(path, usecols=wanted, low_memory=False)


def _problem(table: pd.DataFrame, name: str) -> str:
    """Say why a column is no condition that a residual could follow; empty if it is one."""
    if table[name].dtype.kind not in "iuf" or table["output"].dtype.kind not in "iuf":
        return "it holds more than numbers"
    good = _good(table)
    values = table[name].to_numpy(dtype=float)[good]
    if not (values.size and np.all(np.isfinite(values)) and np.all(np.abs(values) < LARGEST)):
        return "a good reading has no value of it"
    rows = table.take(np.flatnonzero(good))
    if not any(_rises_and_falls(part) for part in _runs_of(rows, values)):
        return "it does not rise and fall within a run"
    if _is_copy(values, rows["output"].to_numpy(dtype=float)):
        return "it is the output over again"
    return ""


def _good(table: pd.DataFrame) -> Any:
    if "flag" not in table.columns:
        return np.ones(len(table), dtype=bool)
    flags = table["flag"].fillna("").astype(str).str.strip().str.lower()
    return flags.isin(sorted(GOOD_FLAGS)).to_numpy()


def _runs_of(rows: pd.DataFrame, values: FloatArray) -> Iterator[FloatArray]:
    grouped: Any = rows.groupby(["run", "serial"], sort=False)
    for index in grouped.indices.values():
        yield values[index]


def _rises_and_falls(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool(np.any(steps > 0.0) and np.any(steps < 0.0))


def _is_copy(values: FloatArray, output: FloatArray) -> bool:
    if not np.all(np.isfinite(output)) or np.ptp(output) == 0.0:
        return False
    about, other = values - values.mean(), output - output.mean()
    left = about - other * (about @ other) / (other @ other)
    return bool(left @ left < OWN_VARIANCE * (about @ about))
