"""A recording told in a line, and for JSON."""

from thermo.recording import RecordedRuns


def recording_document(record: RecordedRuns) -> dict[str, object]:
    """Return what is worth saying of a recording, for JSON."""
    return {
        "runs": list(record.run_ids),
        "serials": list(record.serials),
        "readings": len(record),
        "flagged": int((~record.good).sum()),
        "input_known": record.has_input,
        "digests": {run: record.digest(run) for run in record.run_ids},
    }


def recording_text(record: RecordedRuns) -> str:
    """Say the same in a line."""
    flagged = int((~record.good).sum())
    return (
        f"{len(record)} readings of {', '.join(record.serials):.200} in "
        f"{len(record.run_ids)} run(s), {flagged} flagged"
        + ("" if record.has_input else "; the input is not recorded")
    )
