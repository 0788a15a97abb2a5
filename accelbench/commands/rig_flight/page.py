"""The report of flights: one HTML file and its pictures."""

from collections.abc import Iterator, Sequence

import numpy as np

from accelbench.commands.rig_flight.figures import draw_flight
from accelbench.commands.rig_flight.given import COARSE, PRECISE
from accelbench.commands.rig_flight.text import (
    RHO,
    SHOWN_SHARE,
    FlownCalibration,
    bought_lines,
    distance_text,
    group_title,
    held_text,
    noise_text,
    trajectory,
)
from accelbench.shell.console import number
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import Banner, Page, ReportTable, Section, render_page
from sinscal.article.published import COARSE_M, PRECISE_M
from sinscal.flight.covariance import FlightNoise
from sinscal.flight.trajectory import FlightPlan

PUBLISHED_M = {COARSE: COARSE_M, PRECISE: PRECISE_M}
NOTHING = "–"
CONVENTIONS = (
    "Sigmas are standard deviations (1 σ). ρ is that of the horizontal position: the root of the "
    "sum of the variances north and east.",
    "Navigation is autonomous, its height held from outside. The system is aligned at rest before "
    "take-off by the same sensors: errors of the alignment follow from those of the calibration.",
    "A group's share of ρ² includes its correlations with the others; if errors cancel, it may "
    "be negative. Its part in metres is the root of that share, times ρ.",
)
OF_ARTICLE = (
    "The article states neither the trajectory nor the noise of the flight: this flight is one "
    "that reproduces both of its figures.",
)


def render_flight(
    plan: FlightPlan, noise: FlightNoise, flown: Sequence[FlownCalibration]
) -> dict[str, bytes]:
    """Return the report's files by name, without writing any.

    Parameters
    ----------
    plan : FlightPlan
    noise : FlightNoise
        Of the sensors, in flight and alignment.
    flown : sequence of FlownCalibration
    """
    errors, sigmas, way = draw_flight(plan, flown)
    parts = [f"{one.name}, {unit}" for one in flown for unit in ("%", "m")]
    article = of_article(flown)
    columns = (*ERROR_COLUMNS, *(PUBLISHED_COLUMNS if article else ()))
    sections = (
        Section(
            title="Position error",
            lines=(
                f"After {number(plan.duration_s / 3600.0, 3)} h, {trajectory(plan)}.",
                noise_text(noise),
            ),
            points=tuple(held_text(one.name, one.agreement) for one in flown if one.agreement),
            table=ReportTable(title="", columns=columns, rows=tuple(error_rows(flown))),
            after=RHO,
            pictures=(errors,),
        ),
        Section(
            title="Error budget at the end",
            table=ReportTable(
                title="",
                columns=("source", *parts),
                rows=tuple(budget_rows(flown)),
            ),
        ),
        Section(title="Attitude and velocity", pictures=(sigmas,)),
        Section(title="Trajectory", pictures=(way,)),
        Section(title="Conventions", points=(*CONVENTIONS, *(OF_ARTICLE if article else ()))),
    )
    names = ", ".join(one.name for one in flown)
    bought = tuple(Banner(text=line) for line in bought_lines(flown))
    ends = "; ".join(f"{one.name} {distance_text(one.found.rho_end_m)}" for one in flown)
    hours = f"position error after {number(plan.duration_s / 3600.0, 3)} h (1 σ): {ends}"
    page = Page(
        title=f"Flight after calibration: {names:.100}",
        verdicts=bought or (Banner(text=hours),),
        sections=sections,
    )
    return render_page(page, REPORT_NAME)


ERROR_COLUMNS = ("calibration", "ρ, m", "ρ uncalibrated, m", "ρ without noise, m")
PUBLISHED_COLUMNS = ("published ρ, m", "ratio")


def error_rows(flown: Sequence[FlownCalibration]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each calibration; of the article's with its figures beside ours."""
    article = of_article(flown)
    rho = {one.name: one.found.rho_end_m for one in flown}
    for one in flown:
        before = f"{one.before.rho_end_m:.0f}" if one.before else NOTHING
        row = (one.name, f"{rho[one.name]:.0f}", before, f"{one.alone.rho_end_m:.0f}")
        published = PUBLISHED_M.get(one.name)
        if not article or published is None:
            yield row
        else:
            yield (*row, f"{published:.0f}", f"{rho[one.name] / published:.3f}")
    if article and {COARSE, PRECISE} <= {*rho} and rho[PRECISE] > 0.0:
        ours, theirs = rho[COARSE] / rho[PRECISE], COARSE_M / PRECISE_M
        beside = f"{theirs:.3f}", f"{ours / theirs:.3f}"
        yield "coarse over precise", f"{ours:.3f}", NOTHING, NOTHING, *beside


def of_article(flown: Sequence[FlownCalibration]) -> bool:
    """Return whether all are the article's own calibrations, whose figures are published."""
    return all(one.is_article for one in flown)


def budget_rows(flown: Sequence[FlownCalibration]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each source of error, the largest first: its share of ρ² and its metres."""
    groups = dict.fromkeys(g for one in flown for g in one.found.share)
    last = [{g: float(one.found.share[g][-1]) if g in one.found.share else 0.0 for g in groups}
            for one in flown]  # fmt: skip
    for group in sorted(groups, key=lambda g: -max(abs(of[g]) for of in last)):
        if max(abs(of[group]) for of in last) < SHOWN_SHARE:
            continue
        cells: list[str] = []
        for one, of in zip(flown, last, strict=True):
            part = one.found.rho_end_m * np.sqrt(max(of[group], 0.0))
            cells += [f"{100.0 * of[group]:.1f}".replace("-", "−"), number(part)]
        yield group_title(group), *cells
