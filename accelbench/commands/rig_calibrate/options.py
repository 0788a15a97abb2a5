"""Options that several commands of the rig share."""

import math

import click

from sinscal.library import rig_library


def asked_groups(asked: tuple[str, ...]) -> tuple[str, ...]:
    """Return the groups asked for; a comma separates as well."""
    names = tuple(n.strip() for one in asked for n in one.split(",") if n.strip())
    groups = rig_library().groups
    for name in names:
        if name not in groups:
            known = ", ".join(groups)
            raise click.UsageError(f"--groups {name}: expected one of {known}")
    return names


def asked_limits(asked: tuple[str, ...]) -> dict[str, float]:
    """Return the limits of protection levels asked for as GROUP=LIMIT, by group, SI."""
    limits: dict[str, float] = {}
    for one in asked:
        group, _, said = one.partition("=")
        known = rig_library().told
        if group not in known:
            raise click.UsageError(f"--protect {one}: expected one of {', '.join(known)}")
        told = known[group].told_in
        try:
            limit = float(said)
        except ValueError:
            limit = math.nan
        if not 0.0 < limit < math.inf:
            raise click.UsageError(f"--protect {one}: expected {group}=LIMIT, > 0, in {told.unit}")
        limits[group] = limit * told.size
    return limits
