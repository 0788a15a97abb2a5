"""The pictures of a verdict: the residual over the factor that shows it, and the gap run by run."""

from typing import Any

import numpy as np

from accelbench.shell.console import number
from accelbench.shell.plotting import (
    COLOURS,
    COOLING_COLOUR,
    HEATING_COLOUR,
    Picture,
    cell_means,
    dress,
    file_part,
    legend_below,
    new_figure,
    panel_unit,
    picture,
    plain,
    thinned,
)
from errormodel.arrays import FloatArray
from thermo.discrepancy.factors import factor_kind
from thermo.discrepancy.find import Discrepancy
from thermo.recording.channel import COOLING, HEATING

CELLS = 40
LEVELS = frozenset({"position", "last_move", "position_before"})  # few values, nothing between
MOST_LETTERS = 80  # of all runs' names, that stand beside one another on the axis


def draw_factor(d: Discrepancy) -> Picture:
    """Draw the residual before and after over the factor that shows it best."""
    name = d.where.name if d.where else "temperature"
    x, label = _along(d, name)
    before, after = d.plain_before.residual, d.plain_after.residual
    unit, divisor = panel_unit(before, after)
    figure = new_figure(10.0, 4.2)
    shown = [(before, "present model"), (after, "with the effect")]
    shown = shown if d.effects else shown[:1]
    panels = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    handles: dict[str, Any] = {}
    for axes, (values, title) in zip(panels, shown, strict=True):
        _draw(axes, d, name, x, values / divisor, handles)
        rms = float(np.sqrt(np.mean(values**2))) / divisor
        left = f"residual, {unit}" if axes is panels[0] else ""
        dress(
            axes,
            title=f"{title}: {number(rms, 3)} {unit} rms of block means",
            x=label,
            y=left,
        )
    legend_below(figure, list(handles.values()), list(handles))
    models = "the present model and with the effects found" if d.effects else "the present model"
    caption = f"{d.serial}: residual of block means over {label.partition(',')[0]}, with {models}."
    return picture(figure, f"residual_{file_part(d.serial)}.png", caption)


def _along(d: Discrepancy, name: str) -> tuple[FloatArray, str]:
    """Return a factor's values by block, and the label of their axis."""
    seen = d.source.seen
    if name in ("temperature", "direction"):
        return seen.temp + d.t_ref_c, "temperature, °C"
    kind = factor_kind(seen, name)
    x, unit = kind.values_in(seen), kind.quantity.unit
    if unit == "s":
        x, unit = x / 3600.0, "h"
        if float(np.ptp(x)) < 2.0:
            x, unit = 60.0 * x, "min"
    return x, f"{kind.quantity.axis}, {unit}" if unit not in ("", "1") else kind.quantity.axis


def _draw(
    axes: Any, d: Discrepancy, name: str, x: FloatArray, y: FloatArray, handles: dict[str, Any]
) -> None:
    side = d.source.seen.side()
    groups = [
        ("heating", side == HEATING, HEATING_COLOUR),
        ("cooling", side == COOLING, COOLING_COLOUR),
    ]
    if name != "direction":
        groups = [("", np.ones(x.size, dtype=bool), COLOURS[0])]
    width = max(float(np.ptp(x)) / CELLS, 1e-9)
    for label, rows, colour in groups:
        if not rows.any():
            continue
        shown = np.flatnonzero(rows)
        shown = shown[thinned(shown.size)]
        (points,) = axes.plot(x[shown], y[shown], ".", color=colour, markersize=2.5, alpha=0.25)
        centres, means = cell_means(x[rows], y[rows], width)
        # positions lie apart, and a line is drawn over what is between; rests are left open
        full = np.isfinite(means) if name in LEVELS else np.ones(means.size, dtype=bool)
        (line,) = axes.plot(centres[full], means[full], "-", color=colour, linewidth=1.8)
        handles.setdefault(f"block mean{label and ', '}{label}", points)
        handles.setdefault(f"mean of cells{label and ', '}{label}", line)


def draw_gap(d: Discrepancy) -> Picture:
    """Draw the gap before and after on each run that was held out, against the floor."""
    runs = d.heldout.runs if d.heldout else ()
    labels = [r.run for r in runs] or ["all runs, in the fit"]
    before = np.array([r.before_ug for r in runs] or [d.rms_before_ug])
    after = np.array([r.after_ug for r in runs] or [d.rms_after_ug])
    unit, divisor = panel_unit(before, after)
    figure = new_figure(7.5, 3.4)
    axes = figure.subplots()
    at = np.arange(len(labels))
    bars = [(before, "present model", COLOURS[6]), (after, "with the effect", COLOURS[2])]
    bars = bars if d.effects else bars[:1]
    handles = {
        name: axes.bar(at + 0.4 * k - 0.2 * (len(bars) - 1), values / divisor, 0.38, color=colour)
        for k, (values, name, colour) in enumerate(bars)
    }
    line = axes.axhline(d.floor_ug / divisor, color=COLOURS[0], linestyle="--", linewidth=1.2)
    handles["noise alone"] = line
    crowded = sum(len(label) for label in labels) > MOST_LETTERS
    turned = {"rotation": 20, "ha": "right", "rotation_mode": "anchor"} if crowded else {}
    axes.set_xticks(at, [plain(label) for label in labels], **turned)
    title = "runs held out, predicted from the others" if runs else "in the fit: a single run"
    if d.heldout and not d.heldout.predictive:
        title = "runs held out: the effect belonged to its moment, and is not predicted"
    dress(axes, title=title, x="run", y=f"residual rms, {unit}")
    legend_below(figure, list(handles.values()), list(handles), enlarge=1)
    caption = f"{d.serial}: residual of every run, against what noise leaves."
    return picture(figure, f"gap_{file_part(d.serial)}.png", caption)
