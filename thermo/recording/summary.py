"""Summary of a recording, without its readings."""

from collections.abc import Mapping
from dataclasses import dataclass

from thermo.recording.runs import RecordedRuns


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSummary:
    """Runs and accelerometers of a recording, how many readings, and each run's digest."""

    run_ids: tuple[str, ...]
    serials: tuple[str, ...]
    readings: int
    flagged: int
    has_input: bool
    digests: Mapping[str, str]


def summary_of(record: RecordedRuns) -> RecordingSummary:
    """Return the summary of a recording in memory."""
    return RecordingSummary(
        run_ids=record.run_ids,
        serials=record.serials,
        readings=len(record),
        flagged=int((~record.good).sum()),
        has_input=record.has_input,
        digests={run: record.digest(run) for run in record.run_ids},
    )
