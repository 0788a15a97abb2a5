"""Options that several commands of the rig share."""

import math

import click

from accelbench.commands.rig_calibrate.text import TOLD_IN
from sinscal.model.terms import GROUPS


def asked_groups(asked: tuple[str, ...]) -> tuple[str, ...]:
    """Return the groups asked for; a comma separates as well."""
    names = tuple(n.strip() for one in asked for n in one.split(",") if n.strip())
    for name in names:
        if name not in GROUPS:
            known = ", ".join(GROUPS)
            raise click.UsageError(f"--groups {name}: expected one of {known}")
    return names


def asked_limits(asked: tuple[str, ...]) -> dict[str, float]:
    """Return the limits of protection levels asked for as GROUP=LIMIT, by group, SI."""
    limits: dict[str, float] = {}
    for one in asked:
        group, _, said = one.partition("=")
        if group not in TOLD_IN:
            raise click.UsageError(f"--protect {one}: expected one of {', '.join(TOLD_IN)}")
        unit, size = TOLD_IN[group]
        try:
            limit = float(said)
        except ValueError:
            limit = math.nan
        if not 0.0 < limit < math.inf:
            raise click.UsageError(f"--protect {one}: expected {group}=LIMIT, > 0, in {unit}")
        limits[group] = limit * size
    return limits
