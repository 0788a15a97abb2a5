"""`accelbench discrepancy`: the group of the searches for a missing effect."""

import click

from accelbench.shell.lazy import LazyGroup

# name: module, attribute, what it does
DISCREPANCY_COMMANDS = {
    "thermal": (
        "discrepancy.thermal_command",
        "discrepancy_thermal",
        "Name what the model of accelerometers over temperature lacks.",
    ),
    "rig": (
        "discrepancy.rig.command",
        "discrepancy_rig",
        "Name what the model of a SINS on a rig lacks.",
    ),
}


class _Discrepancy(LazyGroup):
    """The searches."""

    table = DISCREPANCY_COMMANDS


@click.group(cls=_Discrepancy)
def discrepancy() -> None:
    """Find where runs and model disagree, and name the missing effect.

    Every command takes --json: one JSON document on standard output and nothing else.
    """
