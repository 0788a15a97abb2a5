"""Reading recorded runs for a command: what is doubtful is said, and makes the exit code 1."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from thermo.recording.files import RecordedRuns

trust_option = click.option(
    "--trust-units",
    is_flag=True,
    help="Accept units and signs as stated, even if unlikely; the exit code is then 1.",
)


def read_with_doubts(
    paths: Sequence[Path],
    *,
    trust_units: bool,
    more_columns: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> tuple["RecordedRuns", tuple[str, ...]]:
    """Read recorded runs, and say what is doubtful about their units.

    The parameters are those of `thermo.recording.files.read_runs`.

    Raises
    ------
    InputError
        As `thermo.recording.files.read_runs`; for a doubt unless `trust_units`.
    """
    from thermo.recording.files import read_runs  # pandas takes its second
    from thermo.recording.units_check import checked_units

    record = read_runs(paths, trust_units=trust_units, more_columns=more_columns, tell=tell)
    return record, checked_units(record, trust_units=True) if trust_units else ()


def add_reading_counts(
    document: dict[str, Any], record: "RecordedRuns", doubts: Sequence[str]
) -> None:
    """Add to a result how many readings were left out by which flag, and what is doubtful."""
    flags = record.flag.text()
    document["readings"] = {
        "total": len(record),
        "left_out": {name: int((flags == name).sum()) for name in record.flag.names if name},
    }
    document["doubtful_units"] = list(doubts)
