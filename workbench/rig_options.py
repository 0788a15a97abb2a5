"""Options that several commands of the rig share."""

import click

from sinscal.terms import GROUPS


def asked_groups(asked: tuple[str, ...]) -> tuple[str, ...]:
    """Return the groups asked for; a comma separates as well."""
    names = tuple(n.strip() for one in asked for n in one.split(",") if n.strip())
    for name in names:
        if name not in GROUPS:
            known = ", ".join(GROUPS)
            raise click.UsageError(f"--groups {name}: expected one of {known}")
    return names
