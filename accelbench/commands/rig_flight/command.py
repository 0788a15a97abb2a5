"""`accelbench rig flight`: what calibrations are worth in metres after an hour of flight."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from accelbench.commands.rig_flight.text import (
    FlownCalibration,
    flight_document,
    flight_text,
    fly,
    read_calibrations,
)
from accelbench.shell.library import library_option
from accelbench.shell.outputs import Results, check_results, force_option, json_option
from sinscal.flight.covariance import FlightNoise
from sinscal.flight.trajectory import FlightPlan
from sinscal.frames.earth import DEG_PER_H

FAILED = 1
POSITIVE = click.FloatRange(min=0.0, min_open=True)
NOT_NEGATIVE = click.FloatRange(min=0.0)


@click.command()
@click.option(
    "--calibration",
    "files",
    type=Path,
    multiple=True,
    metavar="FILE.json",
    help="What rig calibrate or rig covariance wrote; the article's sigmas if not given.",
)
@click.option(
    "--trajectory",
    type=click.Choice(["straight", "snake"]),
    default="snake",
    show_default=True,
    help="Straight, or with a heading that swings.",
)
@click.option("--speed-m-s", type=POSITIVE, default=200.0, help="Cruising speed.")
@click.option("--amplitude-m", type=NOT_NEGATIVE, default=3300.0, help="Half the snake's width.")
@click.option("--period-s", type=POSITIVE, default=300.0, help="The snake's period.")
@click.option("--duration-s", type=click.FloatRange(min=60.0), default=3600.0, help="Of flight.")
@click.option("--latitude-deg", type=click.FloatRange(-85, 85), default=55.75, help="Of the start.")
@click.option("--heading-deg", type=float, default=90.0, help="Mean heading from north clockwise.")
@click.option("--height-m", type=click.FloatRange(-1e3, 5e4), default=0.0, help="Kept throughout.")
@click.option("--flat", is_flag=True, help="Turn without banking.")
@click.option("--takeoff-s", type=NOT_NEGATIVE, default=100.0, help="Run from rest; 0: in the air.")
@click.option("--alignment-s", type=NOT_NEGATIVE, default=600.0, help="0: none of its noise.")
@click.option("--gyro-noise-deg-h-rthz", type=NOT_NEGATIVE, default=0.1, help="White noise.")
@click.option("--accel-noise-m-s2-rthz", type=NOT_NEGATIVE, default=0.001, help="White noise.")
@click.option(
    "--monte-carlo",
    "runs",
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    help="Fly N runs of the full navigator and hold them against the covariance.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the Monte Carlo.")
@click.option("--report", type=Path, help="Folder for the report and its figures.")
@force_option
@library_option()
@json_option
def flight(
    files: tuple[Path, ...], report: Path | None, force: bool, as_json: bool, **given: Any
) -> int:
    """Say what calibrations are worth in flight: position error of autonomous navigation.

    The system is aligned at rest, takes off and navigates by itself; its errors are those that
    calibration left, and the sensors' noise. In Python: accelbench.rig.flight.
    """
    check_results(None, report, [], force=force)
    calibrations = read_calibrations(files)
    plan, noise = _plan(given), _noise(given)
    flown = [
        fly(
            name,
            one,
            plan,
            noise,
            runs=given["runs"],
            seed=given["seed"],
            progress=_teller(name),
        )
        for name, one in calibrations
    ]
    results = Results(flight_document(plan, noise, flown), flight_text(plan, noise, flown))
    results.add_report(report, lambda: _report(plan, noise, flown))
    results.write(as_json=as_json)
    agrees = all(one.agreement is None or one.agreement.agrees for one in flown)
    return 0 if agrees else FAILED


def _report(
    plan: FlightPlan, noise: FlightNoise, flown: Sequence[FlownCalibration]
) -> dict[str, bytes]:
    from accelbench.commands.rig_flight.page import render_flight  # matplotlib takes its second

    return render_flight(plan, noise, flown)


def _plan(given: dict[str, Any]) -> FlightPlan:
    straight = given["trajectory"] == "straight"
    try:
        return FlightPlan(
            speed_m_s=given["speed_m_s"],
            heading_rad=math.radians(given["heading_deg"]),
            duration_s=given["duration_s"],
            latitude_rad=math.radians(given["latitude_deg"]),
            height_m=given["height_m"],
            amplitude_m=0.0 if straight else given["amplitude_m"],
            period_s=given["period_s"],
            banked=not given["flat"],
            takeoff_s=given["takeoff_s"],
        )
    except ValueError as err:
        raise click.UsageError(str(err)) from err


def _noise(given: dict[str, Any]) -> FlightNoise:
    try:
        return FlightNoise(
            gyro=given["gyro_noise_deg_h_rthz"] * DEG_PER_H,
            accel=given["accel_noise_m_s2_rthz"],
            alignment_s=given["alignment_s"],
        )
    except ValueError as err:
        raise click.UsageError(str(err)) from err


def _teller(name: str) -> Callable[[int, int], None]:
    def tell(done: int, of: int) -> None:
        if done % max(1, of // 10) == 0:
            click.echo(f"{name}: {done} of {of} runs flown", err=True)

    return tell
