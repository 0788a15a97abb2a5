"""`accelbench rig simulate` and `rig covariance`: a rig test before there is one."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    force_option,
    json_option,
    report_options,
)

priors_option = click.option("--priors", type=Path, help="PRIORS.toml: prior sigmas and means.")

groups_option = click.option(
    "--groups",
    metavar="A,B",
    help="Groups of errors in addition to biases, scale errors and misalignments.",
)


@click.command()
@click.argument("programme", type=Path, metavar="PROGRAMME.toml")
@click.option("--out", type=Path, required=True, help="The recorded rig run to write.")
@click.option(
    "--errors",
    metavar="random|FILE",
    help="The sensors' errors; by default those of the programme.",
)
@click.option("--truth", type=Path, help="TRUTH.json to write: the true errors.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, help="Random seed of errors and noise; 1."
)
@click.option("--angle/--no-angle", default=None, help="Record the rig's angle.")
@click.option("--rate-hz", type=click.FloatRange(min=1, max=1000), help="Rows per second.")
@click.option("--increments/--rates", default=None, help="Sensor data to write.")
@click.option("--accelerometers", metavar="SX,SY,SZ",
              help="Serial numbers of emulated accelerometers on x, y, z.",
              )  # fmt: skip
@click.option("--self-heating", is_flag=True, help="The SINS warms up by 30 °C, τ 1500 s.")
@groups_option
@priors_option
@force_option
@library_option()
@json_option
def simulate(**given: Any) -> None:
    """Simulate the run of a rig programme.

    Attitude and forces are exact; errors, faults, noise and temperature are those of the
    programme's file, and the options stand above it. In Python: accelbench.rig.simulate.
    """
    from accelbench.commands.rig_plan.work import simulate as work

    work(**given)


@click.command()
@click.argument("programme", type=Path, required=False, metavar="PROGRAMME.toml")
@click.option(
    "--mode",
    type=click.Choice(["coarse", "precise", "both"]),
    default="both",
    show_default=True,
    help="Without the rig's angle, with it, or both.",
)
@groups_option
@priors_option
@report_options
@force_option
@library_option()
@json_option
def covariance(**given: Any) -> None:
    """Predict the sigmas of a calibration before the test.

    Without a programme: the article's two tables, computed and published side by side. With one:
    the sigma of every parameter, and what each noise and each prior contributes to it. In Python:
    accelbench.rig.covariance.
    """
    from accelbench.commands.rig_plan.work import covariance as work

    work(**given)
