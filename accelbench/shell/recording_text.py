"""A recording told in a line, and for JSON."""

from thermo.recording.summary import RecordingSummary


def recording_document(summary: RecordingSummary) -> dict[str, object]:
    """Return what is worth saying of a recording, for JSON."""
    return {
        "runs": list(summary.run_ids),
        "serials": list(summary.serials),
        "readings": summary.readings,
        "flagged": summary.flagged,
        "input_known": summary.has_input,
        "digests": dict(summary.digests),
    }


def recording_text(summary: RecordingSummary) -> str:
    """Say the same in a line."""
    return (
        f"{summary.readings} readings of {', '.join(summary.serials):.200} in "
        f"{len(summary.run_ids)} run(s), {summary.flagged} flagged"
        + ("" if summary.has_input else "; the input is not recorded")
    )
