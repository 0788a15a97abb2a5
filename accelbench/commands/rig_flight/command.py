"""`accelbench rig flight`: what calibrations are worth in metres after an hour of flight."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option, report_options

POSITIVE = click.FloatRange(min=0.0, min_open=True)

NOT_NEGATIVE = click.FloatRange(min=0.0)


@click.command()
@click.option(
    "--calibration",
    "files",
    type=Path,
    multiple=True,
    metavar="FILE.json",
    help="Output of rig calibrate or rig covariance; the article's sigmas if not given.",
)
@click.option(
    "--trajectory",
    type=click.Choice(["straight", "snake"]),
    default="snake",
    show_default=True,
    help="Straight, or with an oscillating heading.",
)
@click.option("--speed-m-s", type=POSITIVE, default=200.0, help="Cruising speed.")
@click.option(
    "--amplitude-m",
    type=NOT_NEGATIVE,
    default=3300.0,
    help="Half the width of the snake trajectory.",
)
@click.option("--period-s", type=POSITIVE, default=300.0, help="The snake's period.")
@click.option(
    "--duration-s", type=click.FloatRange(min=60.0), default=3600.0, help="Duration of the flight."
)
@click.option(
    "--latitude-deg", type=click.FloatRange(-85, 85), default=55.75, help="Latitude of the start."
)
@click.option("--heading-deg", type=float, default=90.0, help="Mean heading from north clockwise.")
@click.option("--height-m", type=click.FloatRange(-1e3, 5e4), default=0.0, help="Constant height.")
@click.option("--flat", is_flag=True, help="Turn without banking.")
@click.option("--takeoff-s", type=NOT_NEGATIVE, default=100.0, help="Run from rest; 0: in the air.")
@click.option(
    "--alignment-s",
    type=NOT_NEGATIVE,
    default=600.0,
    help="Averaging time; 0 means no alignment noise.",
)
@click.option("--gyro-noise-deg-h-rthz", type=NOT_NEGATIVE, default=0.1, help="White noise.")
@click.option("--accel-noise-m-s2-rthz", type=NOT_NEGATIVE, default=0.001, help="White noise.")
@click.option(
    "--monte-carlo",
    "runs",
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    help="Simulate N runs of the full navigator and compare them with the covariance.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, help="Random seed of the Monte Carlo."
)
@report_options
@force_option
@library_option()
@json_option
def flight(**given: Any) -> int:
    """Compute the position error of autonomous navigation after calibration.

    The system is aligned at rest, takes off and navigates by itself; its errors are those that
    calibration left, and the sensors' noise. In Python: accelbench.rig.flight.
    """
    from accelbench.commands.rig_flight.work import flight as work

    return work(**given)
