"""The pictures of a run-in: how each coefficient converges, and what it was worth."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import NullLocator

from accelbench.shell.console import value_and_sigma
from accelbench.shell.plotting import (
    COLOURS,
    COOLING_COLOUR,
    HEATING_COLOUR,
    Picture,
    dress,
    file_part,
    legend_below,
    new_figure,
    picture,
)
from errormodel.arrays import FloatArray
from thermo.run_in.verdict import Relaxation, RunInVerdict, Spread

AHEAD = 10  # cycles shown of the future
BAND = "#BFD7EA"
MAX_PICTURES = 12
SQUASHED = 8.0  # a relaxation of so many limits leaves too little room for the end of it


def run_in_pictures(verdicts: Sequence[RunInVerdict]) -> Iterator[Picture]:
    """Draw instability before and after, then each accelerometer's convergence."""
    if any(v.coefficients[0].before for v in verdicts):
        yield draw_before_and_after(verdicts)
    for k, one in enumerate(verdicts[:MAX_PICTURES]):
        yield draw_convergence(one, f"convergence_{k + 1}_{file_part(one.serial)}.png")


def draw_convergence(one: RunInVerdict, name: str) -> Picture:
    """Draw estimates, fit and likely future of every coefficient of one accelerometer."""
    count = len(one.coefficients)
    figure = new_figure(5.2 * count, 4.2)
    panels = figure.subplots(1, count, squeeze=False)[0]
    handles: dict[str, Any] = {}
    for axes, coefficient in zip(panels, one.coefficients, strict=True):
        _draw_coefficient(axes, coefficient, one, handles)
    legend_below(figure, list(handles.values()), list(handles), enlarge=1.0)
    caption = f"{one.sentence}. Values are differences from the last cycle's estimate; beyond "
    caption += "twice the limit the scale is logarithmic if the relaxation was large."
    return picture(figure, name, caption)


def _draw_coefficient(axes: Any, c: Relaxation, one: RunInVerdict, handles: dict[str, Any]) -> None:
    n, last = one.cycles, float(c.series.values[-1])
    cycle = np.arange(1, n + 1)
    ahead = np.arange(n, n + AHEAD + 1)
    future = c.draws.past[:, -1:] + c.draws.future[:, : AHEAD + 1] - last
    share = (1 - one.confidence, one.confidence)
    low, high = np.quantile(future, share, axis=0)
    percent = f"{100 * (share[1] - share[0]):.3g} %"
    made = axes.fill_between(ahead, low, high, color=BAND, linewidth=0)
    handles.setdefault(f"predicted value, {percent}", made)
    both = np.concatenate([np.median(c.draws.past, axis=0) - last, np.median(future, axis=0)[1:]])
    (line,) = axes.plot(np.arange(1, n + AHEAD + 1), both, color=COOLING_COLOUR, linewidth=1.3)
    handles.setdefault(f"fit, {one.law}", line)
    bars = axes.errorbar(
        cycle,
        c.series.values - last,
        yerr=2 * c.series.sigmas,
        fmt="o",
        color=COLOURS[0],
        markersize=4,
        elinewidth=1,
    )
    handles.setdefault("estimates, 2 σ", bars)
    here = float(np.median(c.draws.past[:, -1])) - last
    for side in (-1, 1):
        style = {"color": HEATING_COLOUR, "linestyle": "--", "linewidth": 1.0}
        (edge,) = axes.plot([n, n + AHEAD], [here + side * c.series.limit] * 2, **style)
        handles.setdefault(f"limit about cycle {n}", edge)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlim(0.5, n + AHEAD + 0.5)
    if np.ptp(c.series.values) > SQUASHED * c.series.limit:
        _stretch_about_limits(axes, c.series.limit)
    title = f"{one.serial} {c.series.name.upper()}, κ = {value_and_sigma(*c.kappa)} cycles"
    y = f"{c.series.name.upper()} − last, {c.series.unit}"
    dress(axes, title=title, x="cycle", y=y)


def _stretch_about_limits(axes: Any, limit: float) -> None:
    """Show what is within twice the limit in proportion, and what is beyond by its logarithm."""
    axes.set_yscale("symlog", linthresh=2.0 * limit, linscale=1.5)
    low, high = (1.3 * y if abs(y) > 2.0 * limit else y for y in axes.get_ylim())
    axes.set_ylim(low, high)
    ticks = [s * k * limit for k in (0, 1, 2, 4, 10, 20, 40, 100) for s in (-1, 1)]
    axes.set_yticks(sorted({t for t in ticks if low <= t <= high}), minor=False)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def draw_before_and_after(verdicts: Sequence[RunInVerdict]) -> Picture:
    """Draw the instability between runs before and after, side by side, with its limits."""
    names = list(dict.fromkeys(c.series.name for v in verdicts for c in v.coefficients))
    figure = new_figure(5.2 * len(names), 4.2)
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    handles: dict[str, Any] = {}
    for axes, name in zip(panels, names, strict=True):
        found = [(v.serial, c) for v in verdicts for c in v.coefficients if c.series.name == name]
        _draw_spreads(axes, name, found, handles)
    legend_below(figure, list(handles.values()), list(handles), enlarge=1.0)
    caption = "Instability between runs (1 σ, bars: 95 % limits for so few runs) before and after."
    return picture(figure, "before_and_after.png", caption)


def _draw_spreads(
    axes: Any, name: str, found: Sequence[tuple[str, Relaxation]], handles: dict[str, Any]
) -> None:
    place = np.arange(len(found), dtype=float)
    for label, shift, colour, marker in (
        ("before", -0.1, HEATING_COLOUR, "s"),
        ("after", 0.1, COOLING_COLOUR, "o"),
    ):
        spreads = [(p, s) for p, (_, c) in zip(place, found, strict=True) if (s := _of(c, label))]
        x = np.array([p for p, _ in spreads]) + shift
        sigma = np.array([s.sigma for _, s in spreads])
        bounds: FloatArray = np.array([s.ci95 for _, s in spreads]).reshape(-1, 2).T
        style = {"fmt": marker, "color": colour, "markersize": 6, "capsize": 3}
        made = axes.errorbar(x, sigma, yerr=np.abs(bounds - sigma), **style)
        handles.setdefault(label, made)
    noise = [c.estimate_sigma for _, c in found]
    (made,) = axes.plot(place, noise, "_", color="#8A8A8A", markersize=22)
    handles.setdefault("an estimate's own σ", made)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlim(-0.6, len(found) - 0.4)
    axes.set_xticks(place, [serial for serial, _ in found], rotation=0 if len(found) < 6 else 90)
    unit = found[0][1].series.unit
    dress(axes, title=f"{name.upper()} between runs", y=f"1 σ, {unit}")


def _of(c: Relaxation, label: str) -> Spread | None:
    return c.before if label == "before" else c.after
