"""`accelbench make-safe`: a chamber into its safe condition, for people and for units."""

from pathlib import Path

import click

from accelbench.shell.console import emit
from accelbench.shell.outputs import json_option
from thermo.launch.make_safe import make_station_safe
from thermo.launch.real import load_station

DONE, FAILED = 0, 1


@click.command()
@click.argument("station", type=Path, metavar="STATION.toml")
@click.option(
    "--force",
    is_flag=True,
    help="Ask a test that runs on the chamber to end; go on after 30 s even if it does not.",
)
@click.option(
    "--interrupted",
    is_flag=True,
    help="Do nothing unless a test of this user was interrupted on the chamber.",
)
@json_option
def make_safe(station: Path, force: bool, interrupted: bool, as_json: bool) -> int:
    """Put a station's chamber into its safe condition, and verify that.

    The profile is ended, the ramp switched off, the set point put to safe_temp_c, and each is read
    back. Refused while another process holds the chamber, with that one's name. Exit code 0: safe
    and verified, or nothing to do with --interrupted; 1: not verified, or still held by another.
    In Python: accelbench.make_station_safe.
    """
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
        lines.append(f"it was left behind by test {made.interrupted_test}")
    if safe.verified:
        lines.append(f"chamber's safe condition verified: {config.chamber.safe_temp_c:g} °C")
    elif made.needed:
        how = "NOT VERIFIED" if safe.commanded else "NOT VERIFIED, not commanded"
        lines.append(f"chamber's safe condition {how}: see to the chamber")
    if made.held_by:
        lines.append(f"held by {made.held_by}")
        if safe.verified:
            lines.append("it may be commanded again: end that process")
    emit(document, lines, as_json=as_json)
    return DONE if made.done else FAILED
