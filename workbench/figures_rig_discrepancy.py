"""The pictures of a verdict on a rig run: innovations over a factor, and the gap by cycle."""

from typing import Any

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.consistency import FORCES
from sinscal.discrepancy import RigDiscrepancy
from sinscal.discrepancy_factors import history
from sinscal.discrepancy_source import FilterProblem
from sinscal.earth import ARCSEC
from sinscal.rig_effects import PHASE, RATE, TEMPERATURE
from workbench.console import number
from workbench.plotting import (
    COLOURS,
    Picture,
    cell_means,
    dress,
    legend_below,
    new_figure,
    picture,
    thinned,
)

CELLS = 36
CYCLE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def _along(one: FilterProblem, name: str) -> tuple[FloatArray, str, float]:
    """Return a factor at every step, how its axis is called, and the width of a cell."""
    phase, rate, temp_c = history(one.cycles, one.found)
    if name == PHASE:
        return np.rad2deg(phase) % 360.0, "rotation phase, °", 360.0 / CELLS
    if name == RATE:
        return np.rad2deg(rate), "rate of rotation, °/s", 1.0
    if name == TEMPERATURE:
        return temp_c, "temperature, °C", max(float(np.ptp(temp_c)) / CELLS, 1e-6)
    minutes = one.elapsed_s / 60.0
    return minutes, "time from the start of the run, min", float(np.ptp(minutes)) / CELLS


def draw_innovations(d: RigDiscrepancy) -> Picture:
    """Draw innovations before and after over the factor that shows the excess best."""
    before = d.source.filter_with(())
    after = d.source.filter_with([s.choice for s in d.result.slots] if d.effects else ())
    name = d.places[0].name if d.places else RATE
    x, label, width = _along(before, name)
    channel = d.channel or "force_u"
    row = before.rows.names.index(channel)
    unit, size = ("mm/s²", 1e-3) if channel in FORCES else ("″", ARCSEC)
    figure = new_figure(10.0, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    handles: dict[str, Any] = {}
    shown: list[FloatArray] = []
    for axes, one, title in zip(
        panels, (before, after), ("present model", "with the effect"), strict=True
    ):
        settled = one.settled[:, row]
        y = np.where(settled, one.found.filtered.innovation[:, row], np.nan) / size
        shown.append(y[settled])
        _draw(axes, one, x, y, width, handles)
        rms = float(np.sqrt(np.mean(shown[-1] ** 2)))
        y_label = f"innovation of {channel}, {unit}" if axes is panels[0] else ""
        dress(axes, title=f"{title}: {number(rms, 3)} {unit} rms", x=label, y=y_label)
    limit = 1.1 * float(np.quantile(np.abs(np.concatenate(shown)), 0.999))
    panels[0].set_ylim(-limit, limit)
    legend_below(figure, list(handles.values()), list(handles))
    caption = (
        f"Innovations of {channel} over the {label.partition(',')[0]}, with the present model and "
        "with the effects found; lines are means of cells."
    )
    return picture(figure, "innovations.png", caption)


def _draw(
    axes: Any,
    one: FilterProblem,
    x: FloatArray,
    y: FloatArray,
    width: float,
    handles: dict[str, Any],
) -> None:
    for k in range(len(one.cycles)):
        mine = np.flatnonzero((one.found.cycle_of_step == k) & np.isfinite(y))
        if not mine.size:
            continue
        colour = CYCLE_COLOURS[k % len(CYCLE_COLOURS)]
        few = mine[thinned(mine.size)]
        axes.plot(x[few], y[few], ".", color=colour, markersize=2.5, alpha=0.25)
        centres, means = cell_means(x[mine], y[mine], width)
        full = np.isfinite(means)
        (line,) = axes.plot(
            centres[full], means[full], "-", color=colour, linewidth=1.6, marker=".", markersize=4
        )
        handles.setdefault(f"cycle {k + 1}, mean of cells", line)


def draw_cycles(d: RigDiscrepancy) -> Picture:
    """Draw the gap before and after in every cycle held out, against what noise leaves."""
    held = d.heldout
    labels = [f"{h.cycle}" for h in held] or ["all, in the fit"]
    before, after = (
        [h.before for h in held] or [d.rms_before],
        [h.after for h in held] or [d.rms_after],
    )
    panels: list[tuple[str, tuple[str, ...], str, float]] = [("forces", FORCES, "mm/s²", 1e-3)]
    if any(n not in FORCES for n in d.floor):
        others = tuple(n for n in d.floor if n not in FORCES)
        panels.append(("attitude by the rig", others, "″", ARCSEC))
    figure = new_figure(4.6 * len(panels) + 1.0, 3.6)
    drawn = np.atleast_1d(figure.subplots(1, len(panels)))
    at = np.arange(len(labels))
    handles: list[Any] = []
    for axes, (title, names, unit, size) in zip(drawn, panels, strict=True):

        def rms(one: dict[str, float], names: tuple[str, ...] = names, size: float = size) -> float:
            return float(np.sqrt(np.mean([one[n] ** 2 for n in names if n in one]))) / size

        first = axes.bar(at - 0.2, [rms(b) for b in before], 0.38, color=COLOURS[6])
        second = axes.bar(at + 0.2, [rms(a) for a in after], 0.38, color=COLOURS[2])
        line = axes.axhline(rms(d.floor), color=COLOURS[0], linestyle="--", linewidth=1.2)
        axes.set_xticks(at, labels)
        how = "held out, sizes from the others" if held else "in the fit"
        dress(axes, title=f"{title}: {how}", x="cycle", y=f"innovations, rms, {unit}")
        handles = [first, second, line]
    legend_below(figure, handles, ["present model", "with the effect", "noise alone"], enlarge=1)
    caption = "Innovations of every cycle before and after, against what the noise stated leaves."
    return picture(figure, "cycles.png", caption)
