"""`accelbench discrepancy thermal`: the effect that an accelerometer's model lacks."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.discrepancy.options import RUNS, SEED
from accelbench.shell.inputs import trust_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option, report_options


@click.command("thermal")
@RUNS
@click.option(
    "--model", type=Path, help="The present model: TERMS.toml, MODEL.json of a fit, or bare."
)
@click.option(
    "--out",
    type=Path,
    help="MODEL.toml, the larger model; MODEL.json beside it, MODEL.py of what has no name.",
)
@report_options
@click.option("--experiment-out", type=Path, help="SEQUENCE.toml of the proposed experiment.")
@click.option("--max-hours", type=float, help="Longest experiment to propose, h.")
@click.option(
    "--temperatures",
    type=(float, float),
    metavar="LO HI",
    help="Temperatures of a proposed experiment, °C; by default those recorded.",
)
@click.option(
    "--angles", metavar="A,B,…", help="Positions that the head can take, °; by default any."
)
@SEED
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of threads for them; it does not change the verdict.",
)
@click.option(
    "--no-shape",
    is_flag=True,
    help="Build no effect without a name for what repeats and has none.",
)
@trust_option
@force_option
@library_option("--effects")
@json_option
def discrepancy_thermal(**given: Any) -> int:
    """Find where runs and model disagree, and name the missing effect.

    Without --model the present model is the equation that fit would choose, with --model bare k0
    and k1, each quadratic in temperature. What repeats and has no name in the library gets a shape,
    an effect of your own. Columns of numbers that you recorded are looked at as well. In Python:
    accelbench.discrepancy.
    """
    from accelbench.commands.discrepancy.thermal_work import discrepancy_thermal as work

    return work(**given)
