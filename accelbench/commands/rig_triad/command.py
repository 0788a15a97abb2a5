"""`accelbench rig triad`: an accelerometer triad from rests in many positions."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.inputs import trust_option
from accelbench.shell.outputs import force_option, json_option, report_options

UNITS = ("count", "m/s2", "g", "V", "mA")  # as sinscal.triad.rests has them


@click.command()
@click.argument("file", type=Path)
@click.option(
    "--columns", metavar="X,Y,Z", help="Columns of a plain log: numbers from 1, or names."
)
@click.option(
    "--gravity", type=float, help="Gravity, m/s²; for a rig run that of its site if not given."
)
@click.option("--rate-hz", type=float, help="Rows per second of a plain log.")
@click.option(
    "--time-column", metavar="COLUMN", help="Time column of a plain log, s; in place of the rate."
)
@click.option(
    "--unit", type=click.Choice(UNITS), default="count", help="Unit of the readings of a plain log."
)
@click.option("--means", is_flag=True, help="Each row of the log is the mean over a position.")
@click.option(
    "--sigma",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Sigma of such a mean, in its unit.",
)
@click.option(
    "--form",
    type=click.Choice(["lower", "upper"]),
    default="lower",
    help="Triangle of the misalignments.",
)
@click.option("--temperature", is_flag=True, help="Fit slopes over the temperature of a rig run.")
@click.option("--out", type=Path, help="JSON file to write.")
@report_options
@trust_option
@force_option
@json_option
def triad(**given: Any) -> int:
    """Calibrate an accelerometer triad from rests in many positions.

    FILE is a recorded rig run, or with --columns and --gravity any delimited log. In Python:
    accelbench.rig.triad.
    """
    from accelbench.commands.rig_triad.work import triad as work

    return work(**given)
