"""`accelbench discrepancy rig`: the effect that the rig filter's model lacks."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.discrepancy.options import RUNS, SEED
from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option, report_options


@click.command("rig")
@RUNS
@click.option("--model", type=Path, help="MODEL.toml: the present model.")
@click.option("--out", type=Path, help="MODEL.toml to write: the larger model.")
@report_options
@SEED
@force_option
@library_option("--effects")
@json_option
def discrepancy_rig(**given: Any) -> None:
    """Find where a rig run and the filter's model disagree, and name the missing effect.

    Several files hold cycles that follow one another. Without --model the present model has biases,
    scale errors and misalignments. In Python: accelbench.rig.discrepancy.
    """
    from accelbench.commands.discrepancy.rig.work import discrepancy_rig as work

    work(**given)
