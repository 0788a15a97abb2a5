"""`accelbench make-safe`: a chamber into its safe condition, for people and for units."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.outputs import json_option


@click.command()
@click.argument("station", type=Path, metavar="STATION.toml")
@click.option(
    "--force",
    is_flag=True,
    help="End a running test on the chamber; continue after 30 s even if it does not end.",
)
@click.option(
    "--interrupted",
    is_flag=True,
    help="Do nothing unless a test of this user was interrupted on the chamber.",
)
@json_option
def make_safe(**given: Any) -> int:
    """Put a station's chamber into its safe condition and verify it.

    The profile is ended, the ramp switched off, the set point put to safe_temp_c, and each is read
    back. Refused while another process holds the chamber, with that one's name. Exit code 0: safe
    and verified, or nothing to do with --interrupted; 1: not verified, or still held by another.
    In Python: accelbench.make_station_safe.
    """
    from accelbench.commands.run.make_safe_work import make_safe as work

    return work(**given)
