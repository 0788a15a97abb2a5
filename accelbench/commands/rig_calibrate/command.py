"""`accelbench rig calibrate` and `rig compensate`: a SINS's errors found, and taken out."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    force_option,
    json_option,
    report_options,
)

NAVIGATION = "navigation"


def _held(ctx: click.Context, param: click.Parameter, value: str) -> str | int:
    """Return which cycle to hold out, as a word or the cycle's number."""
    if value in ("last", "each", "none"):
        return value
    if not value.isdecimal():
        said = f"{value!r}: expected a cycle's number, last, each or none"
        raise click.BadParameter(said, ctx, param)
    return int(value)


@click.command()
@click.argument("files", nargs=-1, required=True, type=Path, metavar="DATA.csv…")
@click.option(
    "--mode",
    type=click.Choice(["coarse", "precise", NAVIGATION]),
    help="Raw sensors; raw sensors and the rig's angle; navigation outputs. By default as --model "
    "says, else coarse.",
)
@click.option("--model", type=Path, help="MODEL.toml of discrepancy rig: estimate its terms too.")
@click.option(
    "--groups", multiple=True, metavar="NAME", help="Also estimate, e.g. lever_arm; repeatable."
)
@click.option("--priors", type=Path, help="PRIORS.toml: other prior sigmas and means.")
@click.option("--interval-s", type=click.FloatRange(0.05, 60.0), default=1.0,
              help="Time between two measurements of the filter.")  # fmt: skip
@click.option("--gate", type=click.FloatRange(3.0, 100.0), default=7.0,
              help="Sigmas beyond which a measurement is refused.")  # fmt: skip
@click.option("--gyro-instability", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma of the gyros' slow drift, °/h.")  # fmt: skip
@click.option("--accel-instability", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma of the accelerometers' slow drift, m/s².")  # fmt: skip
@click.option("--instability-tau-s", type=click.FloatRange(min=1.0), default=3600.0,
              help="Correlation time of slow drift.")  # fmt: skip
@click.option("--axis-wobble", type=click.FloatRange(min=0.0, min_open=True),
              help="Bound of the movement of the rig axis, ″/√Hz; the noise of the angle if not "
              "given.",
              )  # fmt: skip
@click.option("--t-ref-c", type=float, help="Reference temperature; that of --model, else 25.")
@click.option("--holdout", callback=_held, default="last", metavar="N|last|each|none",
              help="Cycle to compare with the others.")  # fmt: skip
@click.option("--protect", multiple=True, metavar="GROUP=LIMIT",
              help="Pass only if the protection level of the group is below this limit, e.g. "
              "gyro_bias=0.05, in the reported unit of the group; the protection level is the "
              "largest error that an undetected missing effect can cause; repeatable.")  # fmt: skip
@click.option("--out", type=Path, help="RESULT.json to write.")
@report_options
@force_option
@library_option()
@json_option
def calibrate(**given: Any) -> int:
    """Calibrate a SINS from a run on a rig and test the result.

    Several files are cycles of one SINS that follow one another. Exit code 1 when the result is
    not consistent. In Python: accelbench.rig.calibrate.
    """
    from accelbench.commands.rig_calibrate.work import calibrate as work

    return work(**given)


@click.command()
@click.argument("file", type=Path, metavar="DATA.csv")
@click.option(
    "--calibration", type=Path, required=True, help="RESULT.json of rig calibrate or combine."
)
@click.option("--out", type=Path, required=True, help="The compensated run to write.")
@force_option
@library_option()
@json_option
def compensate(**given: Any) -> None:
    """Remove the calibrated errors from the readings of a rig run.

    Flags, times and the rig's angle stay as they are. A jump that the calibration found is taken
    out of the run it was found in; in any other it is over. A run that is compensated already is
    refused. In Python: accelbench.rig.compensate.
    """
    from accelbench.commands.rig_calibrate.work import compensate as work

    work(**given)
