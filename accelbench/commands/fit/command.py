"""`accelbench import`, `fit` and `compensate`: from logs and runs to models and their use."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.inputs import trust_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    force_option,
    json_option,
    report_options,
)

RUNS = click.argument("files", nargs=-1, required=True, metavar="RUN.csv…")


@click.command("import")
@click.argument("file", type=Path)
@click.option(
    "--map",
    "map_file",
    type=Path,
    required=True,
    help="MAP.toml that describes the columns of the log.",
)
@click.option("--out", type=Path, required=True, help="The recorded run to write.")
@force_option
@library_option()
@json_option
def import_(**given: Any) -> None:
    """Convert a log recorded by others into a recorded run.

    FILE is delimited text; MAP.toml says which columns hold time, temperature and outputs, and in
    what units. In Python: accelbench.import_log.
    """
    from accelbench.commands.fit.work import import_ as work

    work(**given)


@click.command()
@RUNS
@click.option("--model", "terms", type=Path, help="TERMS.toml: the terms to fit.")
@click.option(
    "--holdout", multiple=True, metavar="RUN_ID…", help="Runs to predict instead of fitting."
)
@click.option("--out", type=Path, help="MODEL.json to write.")
@report_options
@trust_option
@force_option
@library_option()
@json_option
def fit(**given: Any) -> int:
    """Fit each accelerometer's error model over temperature.

    Without --model the data choose the terms and the polynomial orders. Exit code 1 when a model
    leaves more than constants alone. In Python: accelbench.fit.
    """
    from accelbench.commands.fit.work import fit as work

    return work(**given)


@click.command()
@RUNS
@click.option("--model", type=Path, required=True, help="MODEL.json from fit.")
@click.option("--out", type=Path, required=True, help="The compensated recording to write.")
@trust_option
@force_option
@library_option()
@json_option
def compensate(**given: Any) -> int:
    """Apply a model: adds accel_g, accel_compensated_g and accel_sigma_g to recorded runs.

    Readings that the model does not cover are flagged outside_range (temperature), outside_rate
    and outside_input. A recording that is compensated already is refused. In Python:
    accelbench.compensate.
    """
    from accelbench.commands.fit.work import compensate as work

    return work(**given)
