"""`accelbench rig flight`: what calibrations are worth in metres after an hour of flight."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from accelbench.commands.rig_flight.given import read_calibrations
from accelbench.commands.rig_flight.text import (
    FlownCalibration,
    flight_document,
    flight_text,
    fly_calibration,
)
from accelbench.shell.outputs import Results, check_results
from accelbench.shell.progress import Work, working
from errormodel.progress import track
from sinscal.flight.covariance import FlightNoise
from sinscal.flight.trajectory import FlightPlan
from sinscal.frames.earth import DEG_PER_H

FAILED = 1
POSITIVE = click.FloatRange(min=0.0, min_open=True)
NOT_NEGATIVE = click.FloatRange(min=0.0)


def flight(
    files: tuple[Path, ...], report: Path | None, force: bool, as_json: bool, **given: Any
) -> int:
    """Carry out `accelbench flight`; the arguments are its options."""
    check_results(None, report, [], force=force)
    calibrations = read_calibrations(files)
    plan, noise = _plan(given), _noise(given)
    runs, seed = given["runs"], given["seed"]
    with working("flying") as work:
        flown = [
            fly_calibration(
                one, plan, noise, runs=runs, seed=seed, progress=_teller(one.name, work)
            )
            for one in track(calibrations)
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


def _teller(name: str, work: Work) -> Callable[[int, int], None]:
    def tell(done: int, of: int) -> None:
        if done % max(1, of // 10) == 0:
            work.tell(f"{name}: {done} of {of} runs flown")

    return tell
