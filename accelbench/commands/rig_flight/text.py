"""Flights told: as the JSON of `rig flight`, and in words."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType

from accelbench.commands.rig_flight.given import COARSE, PRECISE, GivenCalibration
from accelbench.shell.console import number, table
from errormodel.progress import track
from sinscal.article.published import COARSE_M, PRECISE_M
from sinscal.flight.covariance import (
    NOISE,
    FlightCovariance,
    FlightNoise,
    assess,
    flight_sensitivity,
)
from sinscal.flight.monte_carlo import Agreement, agreement, fly_runs
from sinscal.flight.navigation_errors import DV, PHI
from sinscal.flight.trajectory import FlightPlan
from sinscal.frames.earth import ARCMIN, DEG_PER_H
from sinscal.library.accelerometer import MICRO_G

SHOWN_SHARE = 0.005
EVERY_S = 10.0
RHO = (
    "ρ: 1 σ of the horizontal position, the root of the sum of the variances north and east; "
    "uncalibrated: with the prior sigmas; without noise: with the calibration errors alone",
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlownCalibration:
    """A calibration and what it left in flight: with the sensors' noise, and alone.

    `before` is the same flight without the calibration, where it is known what was known before.
    """

    name: str
    found: FlightCovariance
    alone: FlightCovariance
    before: FlightCovariance | None = None
    agreement: Agreement | None = None
    is_article: bool = False


def fly_calibration(
    given: GivenCalibration,
    plan: FlightPlan,
    noise: FlightNoise,
    *,
    every_s: float = EVERY_S,
    runs: int = 0,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> FlownCalibration:
    """Compute what a calibration leaves in flight, with the sensors' noise and alone.

    Parameters
    ----------
    given : GivenCalibration
    plan : FlightPlan
    noise : FlightNoise
    every_s : float
        Between two moments that are kept.
    runs, seed : int
        Of a Monte Carlo held against the covariance; none with 0 runs.
    progress : callable, optional
        Is told of the runs flown, and of how many.
    """
    one = given.calibration
    with_noise, without = (
        flight_sensitivity(plan, one.names, noise=each, every_s=every_s)
        for each in track((noise, FlightNoise()))
    )
    whole = assess(with_noise, one)
    held: Agreement | None = None
    if runs:
        flown = fly_runs(
            plan, one, runs, noise=noise, seed=seed, every_s=every_s, progress=progress
        )
        held = agreement(flown, whole)
    return FlownCalibration(
        name=given.name,
        found=whole,
        alone=assess(without, one),
        before=None if given.before is None else assess(with_noise, given.before),
        agreement=held,
        is_article=given.is_article,
    )


def flight_document(
    plan: FlightPlan, noise: FlightNoise, flown: Sequence[FlownCalibration]
) -> dict[str, Any]:
    """Return what `rig flight --json` writes."""
    return {
        **_figures({one.name: one.found.rho_end_m for one in flown}),
        "published": _figures({COARSE: COARSE_M, PRECISE: PRECISE_M}),
        "calibration_alone": _figures({one.name: one.alone.rho_end_m for one in flown}),
        "trajectory": {
            "shape": "snake" if plan.amplitude_m else "straight",
            "speed_m_s": plan.speed_m_s,
            "amplitude_m": plan.amplitude_m,
            "period_s": plan.period_s,
            "duration_s": plan.duration_s,
            "latitude_deg": math.degrees(plan.latitude_rad),
            "heading_deg": math.degrees(plan.heading_rad),
            "height_m": plan.height_m,
            "takeoff_s": plan.takeoff_s,
            "swing_deg": math.degrees(plan.swing_rad),
            "max_bank_deg": math.degrees(plan.max_bank_rad),
        },
        "noise": {
            "gyro_deg_h_rthz": noise.gyro / DEG_PER_H,
            "accel_m_s2_rthz": noise.accel,
            "alignment_s": noise.alignment_s,
        },
        "calibrations": [_calibration_document(one) for one in flown],
    }


def _figures(rho_m: Mapping[str, float]) -> dict[str, float | None]:
    coarse, precise = rho_m.get(COARSE), rho_m.get(PRECISE)
    ratio = coarse / precise if coarse is not None and precise else None
    return {"coarse_m": coarse, "precise_m": precise, "ratio": ratio}


def _calibration_document(one: FlownCalibration) -> dict[str, Any]:
    start, end, held = one.found.sigma[0], one.found.sigma[-1], one.agreement
    return {
        "name": one.name,
        "rho_m": one.found.rho_end_m,
        "rho_calibration_alone_m": one.alone.rho_end_m,
        "rho_without_calibration_m": one.before.rho_end_m if one.before else None,
        "share": {group: float(v[-1]) for group, v in one.found.share.items()},
        "sigma_start": {"attitude_arcmin": (start[PHI] / ARCMIN).tolist()},
        "sigma_end": {
            "attitude_arcmin": (end[PHI] / ARCMIN).tolist(),
            "velocity_m_s": end[DV].tolist(),
        },
        "time_s": one.found.time_s.tolist(),
        "rho_over_time_m": one.found.rho_m.tolist(),
        "monte_carlo": None
        if held is None
        else {
            "runs": held.runs,
            "rho_m": held.rho_m,
            "rho_interval_m": list(held.rho_interval_m),
            "chi2_per_dof": held.chi2_per_dof,
            "dof": held.dof,
            "p_value": held.p_value,
            "agrees": held.agrees,
        },
    }


def flight_text(
    plan: FlightPlan, noise: FlightNoise, flown: Sequence[FlownCalibration]
) -> list[RenderableType]:
    """Return the same for people."""
    columns = ("ρ m", "ρ uncalibrated m", "ρ without noise m")
    made = table("calibration", *columns, "of ρ², %", right=columns, words=("of ρ², %",))
    for one in flown:
        parts = [
            f"{group.replace('_', ' ')} {100.0 * v[-1]:.0f}"
            for group, v in one.found.share.items()
            if abs(v[-1]) >= SHOWN_SHARE
        ]
        rho = [number(r.rho_end_m if r else None) for r in (one.found, one.before, one.alone)]
        made.add_row(one.name, *rho, ", ".join(parts))
    lines: list[RenderableType] = [
        f"ρ after {number(plan.duration_s / 3600.0, 3)} h, {trajectory(plan)}"
    ]
    lines.append(made)
    lines += [*RHO, *bought_lines(flown)]
    figures = _figures({one.name: one.found.rho_end_m for one in flown})
    if figures["ratio"] is not None and all(one.is_article for one in flown):
        lines.append(
            f"coarse to precise {number(figures['ratio'], 3)}; the article has "
            f"{COARSE_M:.0f} m and {PRECISE_M:.0f} m, {COARSE_M / PRECISE_M:.2f}"
        )
    lines.append(noise_text(noise))
    lines += [held_text(one.name, one.agreement) for one in flown if one.agreement]
    return lines


def bought_lines(flown: Sequence[FlownCalibration]) -> Iterator[str]:
    """Tell what each calibration buys, against the same flight without it."""
    for one in flown:
        if one.before is not None and one.found.rho_end_m > 0.0:
            times = one.before.rho_end_m / one.found.rho_end_m
            yield (
                f"{one.name}: the same flight uncalibrated, by what was known beforehand, ends "
                f"{distance_text(one.before.rho_end_m)} off (1 σ); the calibration makes it "
                f"{distance_text(one.found.rho_end_m)}, {number(times, 3)} times less"
            )


def distance_text(metres: float) -> str:
    """Write a distance in m, or in km when it is long."""
    return f"{number(metres / 1e3)} km" if metres >= 1e4 else f"{metres:.0f} m"


def noise_text(noise: FlightNoise) -> str:
    """Say the sensors' noise in one line."""
    gyro, accel = noise.gyro / DEG_PER_H, noise.accel / MICRO_G
    return (
        f"noise: gyros {number(gyro, 3)} °/h/√Hz, accelerometers {number(accel, 3)} µg/√Hz, "
        f"alignment of {number(noise.alignment_s)} s"
    )


def held_text(name: str, held: Agreement) -> str:
    """Say whether the full navigator's runs agree with the covariance."""
    low, high = held.rho_interval_m
    verdict = "agree with" if held.agrees else "CONTRADICT"
    return (
        f"{name}: {held.runs} runs of the full navigator {verdict} the covariance: ρ "
        f"{number(held.rho_m)} m (expected {number(low)} to {number(high)}), χ² per degree of "
        f"freedom {number(held.chi2_per_dof, 3)} (p {number(held.p_value, 2)})"
    )


def trajectory(plan: FlightPlan) -> str:
    """Say a flight in one line."""
    way = f"{plan.speed_m_s:g} m/s, heading {math.degrees(plan.heading_rad):g}°"
    if not plan.amplitude_m:
        return f"straight flight, {way}"
    return (
        f"snake of ±{plan.amplitude_m:g} m and {plan.period_s:g} s, {way} "
        f"± {math.degrees(plan.swing_rad):.0f}°, bank to {math.degrees(plan.max_bank_rad):.0f}°"
    )


def group_title(group: str) -> str:
    """Return a group's name for a legend."""
    return group if group == NOISE else group.replace("_", " ").replace("accel ", "accelerometer ")
