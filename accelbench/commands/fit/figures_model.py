"""Pictures of the fitted models themselves: coefficients with error bars, orders tried."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator

from accelbench.shell.plotting import (
    COLOURS,
    MARKERS,
    Picture,
    dress,
    legend_below,
    new_figure,
    picture,
)
from accelbench.shell.plotting import plain as text_of
from thermo.compensation.model_file import reported
from thermo.fitting.fit import AccelerometerFit

MAX_SHOWN = 40  # accelerometers side by side
PANELS_ABREAST = 4
SIGMAS = 3.0  # length of an error bar


def draw_coefficients(fits: Sequence[AccelerometerFit]) -> Picture:
    """Draw each coefficient of all accelerometers side by side, a panel a coefficient.

    K1 is drawn as its difference from the nominal scale factor, so that panels of different
    accelerometers compare.
    """
    shown = fits[:MAX_SHOWN]
    values = [reported(f.fit, f.channel.nominal_scale, f.channel.output_unit) for f in shown]
    names = list(dict.fromkeys(name for v in values for name in v))
    columns = min(PANELS_ABREAST, len(names))
    rows = -(-len(names) // columns)
    figure = new_figure(2.7 * max(columns, 2), 0.5 + 2.1 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        _draw_one(axes, name, shown, values)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    left = len(fits) - len(shown)
    caption = (
        f"Coefficients of all accelerometers; bars are ± {SIGMAS:g} sigma; where none is "
        f"visible, it is smaller than the marker."
    )
    caption += f" {left} further accelerometers are not shown." if left else ""
    return picture(figure, "coefficients.png", caption)


def _draw_one(
    axes: Any,
    name: str,
    fits: Sequence[AccelerometerFit],
    values: Sequence[dict[str, dict[str, float | str]]],
) -> None:
    unit = next(str(v[name]["unit"]) for v in values if name in v)
    for k, (one, v) in enumerate(zip(fits, values, strict=True)):
        if name not in v:
            continue
        value, sigma = float(v[name]["value"]), float(v[name]["sigma"])
        if name == "k1":
            nominal = one.channel.nominal_scale
            value, sigma, unit = 1e6 * (value / nominal - 1.0), 1e6 * sigma / abs(nominal), "ppm"
        axes.errorbar(
            k,
            value,
            yerr=SIGMAS * sigma,
            fmt=MARKERS[k % len(MARKERS)],
            color=COLOURS[k % len(COLOURS)],
            markersize=4.5,
            capsize=3.0,
        )
    axes.ticklabel_format(style="plain", axis="y", useOffset=False)
    labels = [f.serial if len(f.serial) <= 10 else f"…{f.serial[-9:]}" for f in fits]
    axes.set_xlim(-0.5, len(fits) - 0.5)
    axes.set_xticks(range(len(fits)), [text_of(t) for t in labels], rotation=_slant(labels))
    title = "k1 less nominal" if name == "k1" else name
    dress(axes, title=f"{title}, {unit}")
    axes.axhline(0.0, color="#BBBBBB", linewidth=0.8, zorder=0)
    axes.tick_params(labelsize=7)
    axes.margins(y=0.2)


def _slant(labels: Sequence[str]) -> float:
    """Return the angle at which labels side by side do not run into each other, °."""
    room = 24 / max(len(labels), 1)  # characters
    if max(len(t) for t in labels) <= room:
        return 0.0
    return 30.0 if len(labels) <= 6 else 90.0


def draw_orders(fits: Sequence[AccelerometerFit]) -> Picture:
    """Draw how the polynomial orders tried predict readings that were not fitted."""
    chosen = [f for f in fits if f.selection is not None]
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = new_figure(3.6 * max(columns, 2), 0.8 + 3.0 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    handles: dict[str, Any] = {}
    for axes, one in zip(panels, chosen, strict=False):
        _draw_trials(axes, one, handles)
    for axes in panels[len(chosen) :]:
        axes.set_axis_off()
    legend_below(figure, list(reversed(handles.values())), list(reversed(handles)), enlarge=0.9)
    return picture(
        figure,
        "orders.png",
        "Residual rms over the order of the bias's polynomial (K0), a line for each order of the "
        "scale factor's (K1): solid on held-out readings, dotted in the fit. The ring is the "
        "selected pair: the simplest within 1 % of the best.",
    )


def _draw_trials(axes: Any, one: AccelerometerFit, handles: dict[str, Any]) -> None:
    selection = one.selection
    assert selection is not None
    best = selection.trial(selection.k0_order, selection.k1_order)
    assert best is not None
    (ring,) = axes.plot(
        best.k0_order, best.heldout_ug, "o", markersize=18, markerfacecolor="none",
        markeredgecolor="#D55E00", markeredgewidth=2.0, linestyle="none",
    )  # fmt: skip
    handles.setdefault("chosen", ring)
    # markers grow with the order: where two do equally well both can be seen
    for j in sorted({t.k1_order for t in selection.trials}, reverse=True):
        mine = sorted((t for t in selection.trials if t.k1_order == j), key=lambda t: t.k0_order)
        orders = np.array([t.k0_order for t in mine])
        colour, marker = COLOURS[j % len(COLOURS)], MARKERS[j % len(MARKERS)]
        (line,) = axes.plot(
            orders,
            [t.heldout_ug for t in mine],
            color=colour,
            marker=marker,
            markersize=4.0 + 1.6 * j,
        )
        axes.plot(orders, [t.residual_ug for t in mine], color=colour, linestyle=":")
        handles.setdefault(f"K1 order {j}", line)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xticks(sorted({t.k0_order for t in selection.trials}))
    title = f"{one.serial}: K0 {selection.k0_order}, K1 {selection.k1_order}"
    dress(axes, title=title, x="order of K0", y="residual rms, µg")
