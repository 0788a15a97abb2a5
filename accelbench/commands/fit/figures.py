"""The pictures of a report: each function makes one, from fits and recorded runs."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from accelbench.commands.fit.figures_model import draw_coefficients, draw_orders
from accelbench.shell.console import number
from accelbench.shell.plotting import (
    COLOURS,
    DIRECTION_STYLE,
    MARKERS,
    STYLES,
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
from thermo.fitting.fit import AccelerometerFit
from thermo.recording.channel import Channel
from thermo.recording.files import RecordedRuns
from thermo.selection.residuals import CELL_C

MAX_RUNS, MAX_LINES = 8, 6  # shown in the picture of the runs
MAX_BRANCHES = 12  # named by their angles
MAX_ACCELEROMETERS = 12  # with pictures of their own
# coefficients that the positions of the head determine at one temperature
AT_POSITIONS = ("k0", "k1", "k2", "k3", "delta_o", "delta_p", "k_ip", "k_io")


def pictures(fits: Sequence[AccelerometerFit], runs: RecordedRuns) -> Iterator[Picture]:
    """Draw all pictures of a report, in its order."""
    yield draw_runs(runs)
    names: set[str] = set()
    for k, one in enumerate(fits[:MAX_ACCELEROMETERS]):
        part = file_part(one.serial)
        part = part if part not in names else f"{part}_{k}"
        names.add(part)
        yield draw_errors(one, f"error_{part}.png")
        yield draw_residuals(one, f"residual_{part}.png")
    yield draw_coefficients(fits)
    if any(one.selection for one in fits):
        yield draw_orders(fits[:MAX_ACCELEROMETERS])


def draw_runs(runs: RecordedRuns) -> Picture:
    """Draw temperature and positions over time, run by run."""
    shown = runs.run_ids[:MAX_RUNS]
    positioned = bool(np.any(np.isfinite(runs.position_deg)))
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    heights = [2.0, 1.0] if positioned else [2.0]
    figure = new_figure(10.0 if columns == 2 else 7.0, 0.8 + 1.35 * sum(heights) * rows)
    panels = figure.subplots(
        rows * len(heights), columns, squeeze=False, height_ratios=heights * rows
    )
    handles: dict[str, Any] = {}
    for k, run in enumerate(shown):
        row, column = len(heights) * (k // columns), k % columns
        one = runs.select(runs=[run])
        top = panels[row, column]
        _draw_temperatures(top, one, handles)
        dress(top, title=f"run {run}", y="temperature, °C", x="" if positioned else "time, h")
        if positioned:
            _draw_positions(panels[row + 1, column], one)
            top.sharex(panels[row + 1, column])
            top.tick_params(labelbottom=False)
    for k in range(len(shown), rows * columns):
        for extra in range(len(heights)):
            panels[len(heights) * (k // columns) + extra, k % columns].set_axis_off()
    legend_below(figure, list(handles.values()), list(handles))
    left = len(runs.run_ids) - len(shown)
    caption = "Temperature and positions of the indexing head over time, run by run."
    caption += f" {left} further runs are not shown." if left else ""
    return picture(figure, "temperature_and_positions.png", caption)


def _draw_temperatures(axes: Any, one: RecordedRuns, handles: dict[str, Any]) -> None:
    if np.any(np.isfinite(one.chamber_c)):
        order = np.argsort(one.time_s, kind="stable")
        order = order[np.isfinite(one.chamber_c[order])]
        order = order[thinned(order.size)]
        (line,) = axes.plot(
            one.time_s[order] / 3600, one.chamber_c[order], color="#BBBBBB", linewidth=3.5
        )
        handles.setdefault("chamber", line)
    for k, serial in enumerate(one.serials[:MAX_LINES]):
        rows = np.flatnonzero(one.serial.codes == k)
        rows = rows[thinned(rows.size, 3000)]
        (line,) = axes.plot(
            one.time_s[rows] / 3600,
            one.temp_c[rows],
            color=COLOURS[k % len(COLOURS)],
            linestyle=STYLES[k % len(STYLES)],
            linewidth=1.2,
        )
        handles.setdefault(serial, line)


def _draw_positions(axes: Any, one: RecordedRuns) -> None:
    rows = np.flatnonzero(one.serial.codes == 0)  # the head turns all of them together
    rows = rows[thinned(rows.size, 3000)]
    axes.plot(
        one.time_s[rows] / 3600, one.position_deg[rows], ".", color=COLOURS[0], markersize=2.0
    )
    dress(axes, x="time, h", y="position, °")


def draw_errors(one: AccelerometerFit, name: str) -> Picture:
    """Draw the error against the input over temperature, before and after, by direction."""
    figure = new_figure(10.0, 4.3)
    panels = figure.subplots(1, 2)
    handles: dict[str, Any] = {}
    known = "known input" if one.channel.has_input else "mean"
    titles = (
        (one.raw_ug, f"as measured, constants only: {number(one.raw.rms_ug)} µg rms"),
        (one.residual_ug, f"compensated: {number(one.summary.rms_ug)} µg rms"),
    )
    # as measured, each position is a branch of its own: a mean over them would say nothing
    fanned = bool(one.summary.by_position)
    for axes, (values, title), lines in zip(panels, titles, (not fanned, True), strict=True):
        unit = _draw_by_direction(axes, one.channel, values, handles, lines=lines)
        dress(axes, title=title, x="temperature, °C", y=f"output less {known}, {unit}")
        if not lines:
            _name_branches(axes, one.channel, values, unit)
    figure.suptitle(plain(one.serial), fontsize=11)
    legend_below(figure, list(handles.values()), list(handles))
    branches = " (a branch for each position)" if fanned else ""
    return picture(
        figure,
        name,
        f"{one.serial}: error of the output over temperature, left with a constant bias and "
        f"scale factor only{branches}, right with the model. The two scales differ; lines are "
        f"means "
        f"over {CELL_C:g} °C.",
    )


def _name_branches(axes: Any, channel: Channel, values_ug: FloatArray, unit: str) -> None:
    """Write each position's angle at the warm end of its branch."""
    divisor = 1e3 if unit == "mg" else 1.0
    positions = np.unique(channel.position_deg[np.isfinite(channel.position_deg)])
    if positions.size > MAX_BRANCHES:
        return
    for angle in positions:
        mine = np.flatnonzero(channel.position_deg == angle)
        last = mine[int(np.argmax(channel.temp_c[mine]))]
        at = (channel.temp_c[last], values_ug[last] / divisor)
        axes.annotate(
            f"{angle:g}°", at, xytext=(4, 0), textcoords="offset points", fontsize=7, va="center"
        )


def _draw_by_direction(
    axes: Any,
    channel: Channel,
    values_ug: FloatArray,
    handles: dict[str, Any],
    *,
    lines: bool = True,
) -> str:
    unit, divisor = panel_unit(values_ug)
    rows = thinned(values_ug.size)
    for code, (label, colour, marker) in DIRECTION_STYLE.items():
        mine = rows[channel.direction[rows] == code]
        if mine.size:
            points = axes.scatter(
                channel.temp_c[mine],
                values_ug[mine] / divisor,
                s=5,
                marker=marker,
                color=colour,
                alpha=0.3,
                linewidths=0,
                rasterized=True,
            )
            points.set_label(label)
    for code, (label, colour, marker) in DIRECTION_STYLE.items():
        mine = np.flatnonzero(channel.direction == code)
        if mine.size < 2 or not lines:
            continue
        x, y = cell_means(channel.temp_c[mine], values_ug[mine] / divisor, CELL_C)
        (line,) = axes.plot(
            x, y, color=colour, marker=marker, markersize=3.5, markeredgecolor="white",
            markeredgewidth=0.4, linewidth=0.0 if label == "hold" else 1.4,
        )  # fmt: skip
        handles.setdefault(label, line)
    return unit


def draw_residuals(one: AccelerometerFit, name: str) -> Picture:
    """Draw what the model leaves: over temperature, over time, by position, and as a loop."""
    # means over so few positions are zero in any fit with these coefficients: they show nothing
    positioned = len(one.summary.by_position) > sum(n in AT_POSITIONS for n in one.fit.names)
    figure = new_figure(10.0, 7.2)
    panels = figure.subplots(2, 2).ravel()
    handles: dict[str, Any] = {}
    unit = _draw_by_direction(panels[0], one.channel, one.residual_ug, handles)
    dress(panels[0], title="by direction", x="temperature, °C", y=f"residual, {unit}")
    _draw_over_time(panels[1], one)
    _draw_loop(panels[2], one)
    if positioned:
        _draw_by_position(panels[3], one)
    else:
        _draw_distribution(panels[3], one)
    figure.suptitle(plain(f"{one.serial}: residual with the model"), fontsize=11)
    legend_below(figure, list(handles.values()), list(handles))
    last = "by position of the head" if positioned else "as a distribution"
    return picture(
        figure,
        name,
        f"{one.serial}: residuals over temperature by direction, over time by run, as heating "
        f"minus cooling at equal temperature, and {last}.",
    )


def _draw_over_time(axes: Any, one: AccelerometerFit) -> None:
    channel = one.channel
    unit, divisor = panel_unit(one.residual_ug)
    shown = channel.run_ids[:MAX_RUNS]
    for k, run in enumerate(shown):
        mine = np.flatnonzero(channel.record.run == k)
        mine = mine[thinned(mine.size, max(200, 6000 // len(shown)))]
        axes.scatter(
            channel.record.time_s[mine] / 3600,
            one.residual_ug[mine] / divisor,
            s=4,
            color=COLOURS[k % len(COLOURS)],
            # colours and marks come round after different numbers of runs
            marker=MARKERS[(k + k // len(COLOURS)) % len(MARKERS)],
            alpha=0.4,
            linewidths=0,
            label=plain(run if len(run) <= 24 else f"…{run[-22:]}"),
            rasterized=True,
        )
    dress(axes, title="by run", x="time from the run's start, h", y=f"residual, {unit}")
    _legend_above_points(axes, -(-len(shown) // 2))


def _legend_above_points(axes: Any, rows: int) -> None:
    """Make room for so many rows at the top of the axes and put the legend there."""
    lo, hi = axes.get_ylim()
    share = min(0.03 + 0.06 * rows, 0.6)  # of the axes' height, in letters of its size
    axes.set_ylim(lo, lo + (hi - lo) / (1.0 - share))
    axes.legend(loc="upper center", ncols=2, fontsize=7, frameon=False, markerscale=2.0)


def _draw_loop(axes: Any, one: AccelerometerFit) -> None:
    cells = one.summary.loop
    dress(axes, title="heating minus cooling", x="temperature, °C")
    if not cells:
        axes.text(
            0.5, 0.5, "one direction only", ha="center", va="center", transform=axes.transAxes
        )
        return
    temp_c = np.array([c.temp_c for c in cells])
    values = np.array([c.heating_minus_cooling_ug for c in cells])
    unit, divisor = panel_unit(values)
    axes.bar(temp_c, values / divisor, width=0.8 * CELL_C, color="#999999")
    median = one.summary.heating_minus_cooling_ug or 0.0
    axes.axhline(median / divisor, color=COLOURS[0], linestyle="--", linewidth=1.2)
    axes.axhline(0.0, color=COLOURS[0], linewidth=0.8)
    axes.set_title(
        f"heating minus cooling, median {number(median / divisor, 3)} {unit}", fontsize=10
    )
    axes.set_ylabel(f"difference of residuals, {unit}", fontsize=9)


def _draw_by_position(axes: Any, one: AccelerometerFit) -> None:
    """Draw means with the sigma of a mean of independent readings: a rms would hide them."""
    groups = one.summary.by_position
    angle = np.array([float(g.name.rstrip("°")) for g in groups])
    mean, rms = (np.array([getattr(g, n) for g in groups]) for n in ("mean_ug", "rms_ug"))
    sigma = rms / np.sqrt(np.array([g.n for g in groups]))
    unit, divisor = panel_unit(mean, sigma)
    axes.errorbar(
        angle, mean / divisor, yerr=sigma / divisor, fmt="o", color=COLOURS[0], ecolor="#999999",
        elinewidth=2.0, markersize=4.0,
    )  # fmt: skip
    axes.axhline(0.0, color=COLOURS[0], linewidth=0.8)
    dress(axes, title="by position: mean ± rms/√n", x="position, °", y=f"residual, {unit}")


def _draw_distribution(axes: Any, one: AccelerometerFit) -> None:
    unit, divisor = panel_unit(one.residual_ug)
    axes.hist(one.residual_ug / divisor, bins=60, color="#999999")
    dress(axes, title="distribution", x=f"residual, {unit}", y="readings")
