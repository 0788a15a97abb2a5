"""`accelbench combine`: a SINS calibrated on the rig with its accelerometers' chamber models."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    force_option,
    json_option,
    report_options,
)


@click.command()
@click.option("--thermal", type=Path, required=True, help="MODEL.json of fit.")
@click.option("--rig", type=Path, required=True, help="DATA.csv: the rig run, with temperatures.")
@click.option("--accelerometers", metavar="SX,SY,SZ",
              help="Serial numbers on x, y, z; by default the model file's three, in order.",
              )  # fmt: skip
@click.option("--mode", type=click.Choice(["coarse", "precise"]), default="coarse",
              help="Raw sensors; raw sensors and the rig's angle.")  # fmt: skip
@click.option(
    "--groups", multiple=True, metavar="NAME", help="Also estimate, e.g. lever_arm; repeatable."
)
@click.option("--priors", type=Path, help="PRIORS.toml: other prior sigmas and means.")
@click.option("--turn-on-ug", type=click.FloatRange(min=0.0), default=0.0,
              help="Change of K0 since the chamber test, 1 sigma, µg.")  # fmt: skip
@click.option("--turn-on-ppm", type=click.FloatRange(min=0.0), default=0.0,
              help="Change of K1 since the chamber test, 1 sigma, ppm.")  # fmt: skip
@click.option("--out", type=Path, help="RESULT.json to write: the compensation file for flight.")
@report_options
@force_option
@library_option()
@json_option
def combine(**given: Any) -> int:
    """Calibrate a SINS that warms up, with its rig run and its chamber models together.

    Exit code 1 when rig and chamber contradict each other or the iteration does not come to rest.
    In Python: accelbench.combine.
    """
    from accelbench.commands.combine.work import combine as work

    return work(**given)
