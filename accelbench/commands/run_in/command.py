"""`accelbench runin`: whether the accelerometers of recorded cycles have settled."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.fit.command import RUNS
from accelbench.shell.inputs import trust_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option, report_options

WINDOW = 4  # as thermo.run_in.judge has it, which takes its second to import


@click.command()
@RUNS
@click.option("--sequence", type=Path, help="SEQUENCE.toml with the limits in [run_in].")
@click.option("--k0-limit-ug", type=float, help="Acceptable change of K0, µg; 15 if not given.")
@click.option("--k1-limit-ppm", type=float, help="Acceptable change of K1, ppm; 15 if not given.")
@click.option("--confidence", type=float, help="Confidence of the verdict; 0.95 if not given.")
@click.option(
    "--t-ref-c",
    type=float,
    help="Temperature at which K0 and K1 are compared, °C; 25 if not given.",
)
@click.option(
    "--nothing-slow",
    is_flag=True,
    default=None,
    help="Assume that there is no process slower than the relaxation; the verdict then says so.",
)
@click.option(
    "--window",
    type=click.IntRange(min=2),
    default=WINDOW,
    help=f"Cycles at either end for the instability before and after; {WINDOW} by default.",
)
@report_options
@trust_option
@force_option
@library_option()
@json_option
def runin(**given: Any) -> int:
    """Test whether recorded run-in cycles have settled, or how many more are needed.

    Each run is a cycle, in the order of their starts, or of the files where those are not
    recorded. Exit code 1: an accelerometer has not settled. In Python:
    accelbench.runin.
    """
    from accelbench.commands.run_in.work import runin as work

    return work(**given)
