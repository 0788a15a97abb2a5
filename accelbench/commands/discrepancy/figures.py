"""The pictures of a verdict: the residual over its factor, a shape, and the gap run by run."""

from typing import Any

import numpy as np

from accelbench.commands.discrepancy.text import larger
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
from thermo.discrepancy.shape.curve import readings_of_shape, shape_curve
from thermo.library.quantities import Quantity
from thermo.library.shape import HALF_RANGE_C, quantity_of
from thermo.recording.channel import COOLING, HEATING

CELLS = 40
LEVELS = frozenset({"position", "last_move", "position_before"})  # few values, nothing between
MOST_LETTERS = 80  # of all runs' names, that stand beside one another on the axis


def draw_verdict(d: Discrepancy) -> list[Picture]:
    """Draw all pictures of a verdict."""
    shape = [draw_shape(d)] if d.shape is not None else []
    return [*shape, draw_factor(d), draw_gap(d)]


def draw_factor(d: Discrepancy) -> Picture:
    """Draw the residual before and after over the factor that shows it best."""
    name = d.where.name if d.where else "temperature"
    x, label = _along(d, name)
    before, after = d.plain_before.residual, d.plain_after.residual
    unit, divisor = panel_unit(before, after)
    figure = new_figure(10.0, 4.2)
    shown = [(before, "present model"), (after, "with the effect")]
    shown = shown if larger(d) else shown[:1]
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
    models = "the present model and with the effects found" if larger(d) else "the present model"
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
    bars = bars if larger(d) else bars[:1]
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
        title = "runs held out: the effect does not repeat and is not predicted"
    dress(axes, title=title, x="run", y=f"residual rms, {unit}")
    legend_below(figure, list(handles.values()), list(handles), enlarge=1)
    caption = f"{d.serial}: residual of every run, compared with noise alone."
    return picture(figure, f"gap_{file_part(d.serial)}.png", caption)


def draw_shape(d: Discrepancy) -> Picture:
    """Draw an effect without a name over its quantity, with what the readings say of it."""
    assert d.shape is not None
    curve, shape = shape_curve(d), d.shape
    quantity = quantity_of(shape.pattern.quantity)
    x, y = readings_of_shape(d)
    grid = np.linspace(float(curve.x[0]), float(curve.x[-1]), 400)
    line, sigma = (np.interp(grid, curve.x, v) for v in (curve.values, curve.sigmas))
    unit, divisor = panel_unit(line, y) if curve.unit == "µg" else (curve.unit, 1.0)
    shift, scale, label = _axis_of(d, quantity)
    figure = new_figure(9.0, 4.4)
    axes = figure.subplots()
    shown = thinned(x.size)
    (points,) = axes.plot(
        shift + x[shown] / scale, y[shown] / divisor, ".", color=COLOURS[6], markersize=3, alpha=0.3
    )
    band = axes.fill_between(
        shift + grid / scale,
        (line - 2.0 * sigma) / divisor,
        (line + 2.0 * sigma) / divisor,
        color=COLOURS[4],
        alpha=0.45,
        linewidth=0.0,
    )
    (drawn,) = axes.plot(shift + grid / scale, line / divisor, color=COLOURS[0], linewidth=1.6)
    handles = {"its function": drawn, "± 2 sigma": band, "block mean": points}
    if shape.formula is not None:
        formula = _levelled(shape.formula.values(grid), line, grid, quantity.name)
        (dashed,) = axes.plot(
            shift + grid / scale, formula / divisor, "--", color=HEATING_COLOUR, linewidth=1.4
        )
        handles[f"short formula: {shape.formula.family}"] = dashed
    dress(
        axes, title=shape.sentence, x=label, y=f"effect{_TIMES_AXIS[shape.pattern.times]}, {unit}"
    )
    legend_below(figure, list(handles.values()), list(handles))
    caption = (
        f"{d.serial}: {shape.name}, the effect without a name, as fitted beside the whole model; "
        "the points are block means with all the model's other terms taken off."
    )
    return picture(figure, f"shape_{file_part(d.serial)}.png", caption)


_TIMES_AXIS = {
    "": "",
    "input": " per g of input",
    "direction": ", heating; cooling with the other sign",
    "temperature": f" at {HALF_RANGE_C:g} °C from the reference, in proportion to it",
    "last_move": ", after a turn forward; backward with the other sign",
}


def _axis_of(d: Discrepancy, quantity: Quantity) -> tuple[float, float, str]:
    """Return what is added to a quantity, what it is divided by, and the label of its axis."""
    if quantity.name == "temperature":
        return d.t_ref_c, 1.0, "temperature, °C"
    if quantity.unit == "s" and float(np.ptp(d.source.seen.of(quantity))) > 7200.0:
        return 0.0, 3600.0, f"{quantity.axis}, h"
    unit = f", {quantity.unit}" if quantity.unit not in ("", "1") else ""
    return 0.0, 1.0, f"{quantity.axis}{unit}"


def _levelled(
    formula: FloatArray, function: FloatArray, x: FloatArray, quantity: str
) -> FloatArray:
    """Return a formula with what the model has besides: a level, over temperature a parabola."""
    order = 2 if quantity == "temperature" else 0
    about = x - x.mean()
    powers = np.vander(about, order + 1)
    level = np.linalg.lstsq(powers, function - formula, rcond=None)[0]
    return formula + powers @ level
