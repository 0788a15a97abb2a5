"""Pictures of a triad calibrated at rest: its residuals, and where its positions point."""

from typing import Any

import numpy as np

from accelbench.shell.plotting import COLOURS, Picture, dress, legend_below, new_figure, picture
from errormodel.arrays import FloatArray
from sinscal.recording.run import BoolArray
from sinscal.triad.rests import RestCalibration


def draw_triad(done: RestCalibration) -> Picture:
    """Draw |f| − g of each position before and after, and the positions on the sphere."""
    figure = new_figure(10.5, 6.6)
    grid = figure.add_gridspec(2, 4)
    before, after = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[1, :2])
    handles: dict[str, Any] = {}
    number = np.arange(1, len(done.intervals) + 1)
    used = np.isin(number - 1, done.fit.used)
    (handles["before"],) = before.plot(
        number, 1e3 * done.before_m_s2, "o", color=COLOURS[0], markersize=4
    )
    nominal = done.rests.unit in ("m/s2", "g")
    title = "nominal scale, no bias" if nominal else "one scale for all axes, biases subtracted"
    dress(before, title=f"Before: {title}", y="|f| − g, mm/s²")
    sigma = np.hypot(done.fit.within_m_s2, done.fit.pose_m_s2)
    residual = done.fit.residual_m_s2
    handles["after, ±1 σ"] = after.errorbar(
        number[used],
        1e3 * residual[used],
        yerr=1e3 * sigma[used],
        fmt="o",
        color=COLOURS[2],
        markersize=4,
        elinewidth=0.8,
    )
    if not used.all():
        (handles["left out"],) = after.plot(
            number[~used], 1e3 * residual[~used], "X", color="#D55E00", markersize=8
        )
    after.axhline(0.0, color="#888888", linewidth=0.8)
    dress(after, title="After", x="position", y="|f| − g, mm/s²")
    unit = done.forces / np.linalg.norm(done.forces, axis=1)[:, None]
    _hemisphere(figure.add_subplot(grid[0, 2:]), unit, used, 1.0, "z up")
    _hemisphere(figure.add_subplot(grid[1, 2:]), unit, used, -1.0, "z down")
    legend_below(figure, list(handles.values()), list(handles), enlarge=1.5)
    caption = (
        f"Left: |f| − g in the {number.size} positions at rest, before and after calibration. "
        "Right: direction of up in the triad's axes, seen along z, equal areas; rings are 30° "
        "and 60° from the z axis."
    )
    return picture(figure, "triad.png", caption)


def _hemisphere(axes: Any, unit: FloatArray, used: BoolArray, side: float, title: str) -> None:
    """Draw half of the sphere in Lambert's projection of equal areas."""
    turn = np.linspace(0, 2 * np.pi, 200)
    for angle in (30.0, 60.0, 90.0):
        ring = np.sqrt(2.0) * np.sin(np.deg2rad(angle) / 2.0)
        colour = "#888888" if angle == 90 else "#DDDDDD"
        axes.plot(ring * np.cos(turn), ring * np.sin(turn), color=colour, linewidth=0.8)
    here = side * unit[:, 2] >= 0
    radius = np.sqrt(1.0 / (1.0 + side * unit[:, 2]), where=here, out=np.zeros(here.size))
    for rows, marker, colour in ((here & used, "o", COLOURS[2]), (here & ~used, "X", "#D55E00")):
        place = radius[rows][:, None] * unit[rows, :2]
        axes.plot(place[:, 0], place[:, 1], marker, color=colour, markersize=5)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-1.35, 1.35)
    axes.set_ylim(-1.1, 1.25)
    axes.text(1.08, 0.0, "x", fontsize=9, va="center")
    axes.text(0.0, 1.08, "y", fontsize=9, ha="center")
    axes.set_title(f"up in the triad's axes: {title}", fontsize=10)
