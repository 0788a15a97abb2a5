"""`accelbench make-safe`: a chamber into its safe condition, for people and for units."""

from pathlib import Path

from accelbench.shell.console import emit
from thermo.launch.make_safe import make_station_safe
from thermo.launch.real import load_station

DONE, FAILED = 0, 1


def make_safe(station: Path, force: bool, interrupted: bool, as_json: bool) -> int:
    """Carry out `accelbench make_safe`; the arguments are its options."""
    config = load_station(station)
    made = make_station_safe(config, force=force, interrupted_only=interrupted)
    safe = made.safe
    document = {
        "station": config.name,
        "chamber": config.chamber.url,
        "verified": safe.verified,
        "commanded": safe.commanded,
        "needed": made.needed,
        "steps": list(safe.steps),
        "held_by": made.held_by or None,
        "interrupted_test": made.interrupted_test or None,
    }
    lines = list(safe.steps)
    if made.interrupted_test:
        lines.append(f"it was left by the interrupted test {made.interrupted_test}")
    if safe.verified:
        lines.append(f"chamber's safe condition verified: {config.chamber.safe_temp_c:g} °C")
    elif made.needed:
        how = "NOT VERIFIED" if safe.commanded else "NOT VERIFIED, not commanded"
        lines.append(f"chamber's safe condition {how}: check the chamber")
    if made.held_by:
        lines.append(f"held by {made.held_by}")
        if safe.verified:
            lines.append("it may be commanded again: end that process")
    emit(document, lines, as_json=as_json)
    return DONE if made.done else FAILED
