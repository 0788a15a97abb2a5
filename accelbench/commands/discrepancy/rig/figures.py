"""The pictures of a verdict on a rig run: innovations over a factor, and the gap by cycle."""

from typing import Any

import numpy as np

from accelbench.shell.console import number
from accelbench.shell.plotting import (
    COLOURS,
    Picture,
    cell_means,
    dress,
    legend_below,
    new_figure,
    picture,
    thinned,
)
from errormodel.arrays import FloatArray
from sinscal.calibration.consistency import ALONG, FORCES
from sinscal.discrepancy.find import RigDiscrepancy
from sinscal.frames.earth import ARCSEC
from sinscal.library.groups import PHASE, RATE, TEMPERATURE
from sinscal.sensitivity.factors import history
from sinscal.sensitivity.problem import FilterProblem

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


def draw_innovations_by_factor(d: RigDiscrepancy) -> Picture:
    """Draw innovations before and after over the factor that shows the excess best."""
    before = d.source.filter_with(())
    filters = [(before, "present model")]
    if d.effects:
        larger = d.source.filter_with([s.choice for s in d.result.slots])
        filters.append((larger, "with the effect"))
    name = d.places[0].name if d.places else RATE
    x, label, width = _along(before, name)
    channel = d.channel or "force_u"
    row = before.rows.names.index(channel)
    unit, size = ("mm/s²", 1e-3) if channel in FORCES else ("″", ARCSEC)
    figure = new_figure(5.0 * len(filters), 4.2)
    panels = np.atleast_1d(figure.subplots(1, len(filters), sharey=True))
    handles: dict[str, Any] = {}
    shown: list[FloatArray] = []
    for axes, (one, title) in zip(panels, filters, strict=True):
        settled = one.settled[:, row]
        y = np.where(settled, one.found.filtered.innovation[:, row], np.nan) / size
        shown.append(y[settled])
        _draw(axes, one, name, x, y, width, handles)
        rms = float(np.sqrt(np.mean(shown[-1] ** 2)))
        y_label = f"innovation of {channel}, {unit}" if axes is panels[0] else ""
        dress(axes, title=f"{title}: {number(rms, 3)} {unit} rms", x=label, y=y_label)
    limit = 1.1 * float(np.quantile(np.abs(np.concatenate(shown)), 0.999))
    panels[0].set_ylim(-limit, limit)
    legend_below(figure, list(handles.values()), list(handles), enlarge=1)
    models = "the present model and with the named effects" if d.effects else "the present model"
    caption = (
        f"Innovations of {channel} over the {label.partition(',')[0]}, with {models}; thick "
        f"lines are means of cells."
    )
    return picture(figure, "innovations.png", caption)


def _draw(
    axes: Any,
    one: FilterProblem,
    name: str,
    x: FloatArray,
    y: FloatArray,
    width: float,
    handles: dict[str, Any],
) -> None:
    # rates are few and apart: a line between them would say what was not measured
    style, mark = ("o", {"markersize": 5}) if name == RATE else ("-", {})
    for k in range(len(one.cycles)):
        mine = np.flatnonzero((one.found.cycle_of_step == k) & np.isfinite(y))
        if not mine.size:
            continue
        colour = CYCLE_COLOURS[k % len(CYCLE_COLOURS)]
        few = mine[thinned(mine.size)]
        axes.plot(x[few], y[few], ".", color=colour, markersize=2.5, alpha=0.25)
        # a cell's middle lies on a whole multiple of its width: so do rates
        centres, means = cell_means(x[mine] + 0.5 * width, y[mine], width)
        centres = centres - 0.5 * width
        full = np.isfinite(means)
        (line,) = axes.plot(centres[full], means[full], style, color=colour, linewidth=1.6, **mark)
        handles.setdefault(f"cycle {k + 1}, mean of cells", line)


def draw_cycles(d: RigDiscrepancy) -> Picture:
    """Draw the gap before and after in every cycle, in the filter and held out."""
    names, what, unit, size = FORCES, "forces", "mm/s²", 1e-3
    if d.channel == ALONG:
        names, what, unit, size = (ALONG,), "rig's angle", "″", ARCSEC
    panels = [
        (d.gaps, "in the filter"),
        (d.held_out_parts, "held out: selected and estimated by the other cycles"),
    ]
    panels = [(gaps, title) for gaps, title in panels if gaps]
    figure = new_figure(4.6 * len(panels) + 1.0, 3.6)
    drawn = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    handles: list[Any] = []

    def rms(one: dict[str, float]) -> float:
        return float(np.sqrt(np.mean([one[n] ** 2 for n in names if n in one]))) / size

    for axes, (gaps, title) in zip(drawn, panels, strict=True):
        at = np.arange(len(gaps))
        handles = [axes.bar(at - 0.2, [rms(g.before) for g in gaps], 0.38, color=COLOURS[6])]
        if d.effects:
            after = [rms(g.after) for g in gaps]
            handles.append(axes.bar(at + 0.2, after, 0.38, color=COLOURS[2]))
        handles.append(axes.axhline(rms(d.floor), color=COLOURS[0], linestyle="--", linewidth=1.2))
        axes.set_xticks(at, [f"{g.cycle}" for g in gaps])
        label = f"innovations of {what}, rms, {unit}" if axes is drawn[0] else ""
        dress(axes, title=title, x="cycle", y=label)
    labels = ["present model", *(["with the effect"] if d.effects else []), "noise alone"]
    legend_below(figure, handles, labels, enlarge=1)
    caption = (
        "Innovations of every cycle compared with noise alone: with the filter of each model, "
        "and with selection and sizes from the other cycles (combinations that only this cycle "
        "determines are left out of both)."
    )
    return picture(figure, "cycles.png", caption)
