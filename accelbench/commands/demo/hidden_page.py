"""The next run beside what two models say of it: its page and picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelbench.commands.discrepancy.page import render_discrepancy
from accelbench.shell.console import number
from accelbench.shell.page import Page, ReportTable, Section, render_page
from accelbench.shell.plotting import (
    COLOURS,
    Picture,
    cell_means,
    dress,
    file_part,
    legend_below,
    new_figure,
    panel_unit,
    picture,
    thinned,
)
from errormodel.arrays import FloatArray, rms
from thermo.discrepancy.find import Discrepancy
from thermo.recording.files import RecordedRuns

NEXT_RUN_NAME = "next_run.html"
CELLS = 60


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NextRun:
    """A new run of the accelerometer beside what its two models say of it.

    Attributes
    ----------
    serial : str
    time_h, temp_c : ndarray, shape (n,)
    before_ug, after_ug : ndarray, shape (n,)
        Measured less emulated by the present and by the larger model.
    floor_ug : float
        What noise alone leaves on a run that was not fitted, rms.
    predictive : bool
        False when the effect belonged to its moment, and no new run has it.
    """

    serial: str
    time_h: FloatArray
    temp_c: FloatArray
    before_ug: FloatArray
    after_ug: FloatArray
    floor_ug: float
    predictive: bool

    @property
    def gap_before_ug(self) -> float:
        """Rms over the readings; see `told`."""
        return rms(self.told(self.before_ug))

    @property
    def gap_after_ug(self) -> float:
        """Rms over the readings; see `told`."""
        return rms(self.told(self.after_ug))

    @property
    def over_noise(self) -> float:
        """The gap with the larger model over what noise alone leaves."""
        return self.gap_after_ug / self.floor_ug

    def told(self, values: FloatArray) -> FloatArray:
        """Return what a model could have told: all, or all but level and slope in time.

        A step, an offset, a drift or a run-in leave a new run a level, and perhaps a slope, that
        no model of earlier runs knows.
        """
        return values if self.predictive else values - np.polyval(self.line(values), self.time_h)

    def line(self, values: FloatArray) -> FloatArray:
        """Return slope, µg/h, and level at the start, µg, of a straight line in time."""
        return np.polyfit(self.time_h, values, 1)


def hidden_report(
    verdicts: Sequence[Discrepancy], runs: RecordedRuns, next_run: NextRun
) -> dict[str, bytes]:
    """Return the report on the verdicts and the page on the next run, files by name."""
    row = (
        next_run.serial,
        number(next_run.gap_before_ug),
        number(next_run.gap_after_ug),
        number(next_run.floor_ug),
    )
    section = Section(
        lines=next_run_lines(next_run),
        table=ReportTable(
            title="",
            columns=("accelerometer", "present model, µg", "larger model, µg", "noise alone, µg"),
            rows=(row,),
            note="Rms over readings of measured minus emulated"
            + ("." if next_run.predictive else ", level and slope in time apart."),
        ),
        pictures=(draw_next_run(next_run),),
    )
    page = Page(
        title=f"The next run of {next_run.serial}, measured and emulated", sections=(section,)
    )
    return {**render_discrepancy(verdicts, runs), **render_page(page, NEXT_RUN_NAME)}


def next_run_lines(one: NextRun) -> tuple[str, ...]:
    """Say how far measurement and emulation are apart."""
    text = (
        f"In the next run {one.serial} is {number(one.gap_before_ug)} µg from the present model in "
        f"the emulator and {number(one.gap_after_ug)} µg from the larger one; noise alone "
        f"{number(one.floor_ug)} µg, and the larger model {number(one.over_noise, 3)} times that."
    )
    if one.predictive:
        return (text,)
    slope, level_ug = one.line(one.after_ug).tolist()
    return (
        "The effect does not repeat: a model of earlier runs cannot predict the level and the "
        f"slope of a new run (here {number(level_ug, 3)} µg and {number(slope, 2)} µg/h).",
        f"These apart: {text[0].lower()}{text[1:]}",
    )


def draw_next_run(one: NextRun) -> Picture:
    """Draw measured less emulated over the run, with either model."""
    before_ug, after_ug = one.told(one.before_ug), one.told(one.after_ug)
    unit, divisor = panel_unit(before_ug, after_ug)
    figure = new_figure(10.0, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    handles: dict[str, Any] = {}
    apart = "" if one.predictive else "\n(level and slope apart)"
    for axes, values, name in zip(
        panels, (before_ug, after_ug), ("present model", "larger model"), strict=True
    ):
        y = values / divisor
        shown = thinned(y.size)
        (points,) = axes.plot(
            one.time_h[shown], y[shown], ".", color=COLOURS[6], markersize=2.5, alpha=0.35
        )
        centres, means = cell_means(one.time_h, y, float(np.ptp(one.time_h)) / CELLS)
        full = np.isfinite(means)
        (line,) = axes.plot(centres[full], means[full], color=COLOURS[0], linewidth=1.6)
        for side in (-1.0, 1.0):
            floor = axes.axhline(
                side * one.floor_ug / divisor, color=COLOURS[2], linestyle="--", linewidth=1.2
            )
        handles = {"reading": points, "mean of cells": line, "noise alone, ± its rms": floor}
        dress(
            axes,
            title=f"{name}: {number(rms(values) / divisor, 3)} {unit} rms",
            x="time in the run, h",
            y=f"measured less emulated{apart}, {unit}" if axes is panels[0] else "",
        )
    legend_below(figure, list(handles.values()), list(handles))
    caption = f"{one.serial}: the next run minus the output of the emulator with each model."
    return picture(figure, f"next_run_{file_part(one.serial)}.png", caption)
