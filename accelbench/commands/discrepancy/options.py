"""Options and lines of progress that the searches share."""

from pathlib import Path

import click

RUNS = click.argument("files", nargs=-1, required=True, metavar="RUN.csv…", type=Path)
SEED = click.option("--seed", type=int, default=1, help="Random seed of the simulated nulls.")


def tell(line: str) -> None:
    """Show a line of progress."""
    click.echo(line, err=True)
