"""`accelbench stability`: the same accelerometers, run after run."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.inputs import trust_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option, report_options


@click.command()
@click.argument("files", nargs=-1, metavar="RUN.csv…")
@click.option("--store", help="Take the runs of a test in this store instead.")
@click.option("--test", "test_id", metavar="ID", help="The test in the store.")
@click.option("--model", "terms", type=Path, help="TERMS.toml: the terms to fit.")
@click.option(
    "--at-c", type=float, multiple=True, metavar="°C…", help="Reference temperature; several."
)
@click.option(
    "--limits", type=Path, help="LIMITS.toml: limits, grades, conditions between the runs."
)
@click.option(
    "--between", type=Path, help="File of the same format with the conditions between the runs."
)
@report_options
@trust_option
@force_option
@library_option()
@json_option
def stability(**given: Any) -> int:
    """Compare runs: repeatability, curves, variance components, verdict.

    Needs two runs or more of each accelerometer. Exit code 1 when one exceeds a limit beyond
    chance. In Python: accelbench.stability.
    """
    from accelbench.commands.stability.work import stability as work

    return work(**given)
