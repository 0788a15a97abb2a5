"""The pictures of a stability report: the batch at a glance, and each accelerometer's runs."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator

from accelbench.commands.stability.text import (
    grade_text,
    largest_limits,
    marks_of,
    sigma_limits,
    sigma_text,
)
from accelbench.shell.plotting import (
    COLOURS,
    DIRECTION_STYLE,
    MARKERS,
    STYLES,
    Picture,
    dress,
    file_part,
    legend_below,
    new_figure,
    picture,
    plain,
)
from errormodel.arrays import FloatArray
from errormodel.statistics.variance import VarianceFit
from thermo.selection.residuals import DIRECTIONS
from thermo.stability.coefficients import CURVE, CoefficientStability
from thermo.stability.judge import AccelerometerStability, Stability

MAX_ROWS = 40  # accelerometers in the overview
MAX_ACCELEROMETERS = 12  # with a picture of their own
MAX_RUN_NAMES = 12
TICK_LETTERS = 8
VERDICT_COLOUR = {
    "pass": "#009E73",
    "undecided": "#E69F00",
    "fail": "#B00020",
    "not judged": "#7A7A7A",
}
VERDICT_MARK = {"pass": "o", "undecided": "D", "fail": "X", "not judged": "o"}
LIMIT_COLOUR = "#B00020"


def stability_pictures(result: Stability) -> Iterator[Picture]:
    """Draw all pictures of a stability report after the overview."""
    if result.components is not None:
        yield draw_components(result.components)
    names: set[str] = set()
    for k, one in enumerate(result.accelerometers[:MAX_ACCELEROMETERS]):
        part = file_part(one.serial)
        part = part if part not in names else f"{part}_{k}"
        names.add(part)
        yield draw_runs_of(one, f"runs_{part}.png")


Measure = Callable[[AccelerometerStability], tuple[float, tuple[float, float]] | None]


def _sigma(name: str) -> Measure:
    def measure(one: AccelerometerStability) -> tuple[float, tuple[float, float]] | None:
        found = one.coefficient(name)
        return (found.scatter.sigma_run, sigma_limits(one, found)) if found else None

    return measure


def _largest(one: AccelerometerStability) -> tuple[float, tuple[float, float]] | None:
    apart = one.k0_distance
    return (apart.largest, largest_limits(one, apart)) if apart else None


# title, unit, what is drawn, criterion whose limit is drawn
PANELS: tuple[tuple[str, str, Measure, str], ...] = (
    ("K0, 1 σ between runs", "µg", _sigma("k0"), "k0 sigma_run"),
    ("K1, 1 σ between runs", "ppm", _sigma("k1"), "k1 sigma_run"),
    ("K0 curves, largest distance", "µg", _largest, f"{CURVE} max"),
)


def draw_overview(result: Stability) -> Picture:
    """Draw the batch: an accelerometer a line, the best on top, its verdict beside it."""
    ranked = sorted(result.accelerometers, key=lambda a: a.rank)[:MAX_ROWS]
    panels = [p for p in PANELS if any(p[2](a) for a in ranked)]
    figure = new_figure(2.2 + 2.9 * len(panels), 1.7 + 0.32 * len(ranked))
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    handles: dict[str, Any] = {}
    for one_axes, panel in zip(axes, panels, strict=True):
        _draw_measure(one_axes, ranked, panel, handles)
    axes[0].set_ylim(len(ranked) - 0.4, -0.6)
    axes[0].set_yticks(range(len(ranked)), [_label(a) for a in ranked])
    _write_verdicts(axes[-1], ranked)
    figure.suptitle(plain(_headline(result)), fontsize=12)
    legend_below(figure, list(handles.values()), list(handles))
    left = len(result.accelerometers) - len(ranked)
    caption = (
        "The batch, the most stable on top, with verdict and grade at the right. Points are "
        "estimates (an open mark at 0: no difference is seen). Bars are their limits; if an "
        "acceptance limit is given, those of the verdict. An arrow means that they extend beyond "
        "the panel. The dashed line is the acceptance limit."
    )
    caption += f" {left} further accelerometers are not shown." if left else ""
    return picture(figure, "overview.png", caption)


def _label(one: AccelerometerStability) -> str:
    serial = one.serial if len(one.serial) <= 16 else f"…{one.serial[-15:]}"
    return plain(f"{one.rank}. {serial}, {len(one.runs.runs)} runs")


def _headline(result: Stability) -> str:
    verdicts = [a.verdict for a in result.accelerometers]
    if set(verdicts) == {"not judged"}:
        return f"{len(verdicts)} accelerometers, {len(result.order)} runs, no limits given"
    counts = [f"{verdicts.count(v)} {v}" for v in ("pass", "fail", "undecided") if v in verdicts]
    return f"{len(verdicts)} accelerometers, {len(result.order)} runs: {', '.join(counts)}"


def _draw_measure(
    axes: Any,
    ranked: Sequence[AccelerometerStability],
    panel: tuple[str, str, Measure, str],
    handles: dict[str, Any],
) -> None:
    title, unit, measure, criterion = panel
    found = [measure(a) for a in ranked]
    limit = next((c.limit for a in ranked for c in a.criteria if c.name == criterion), None)
    estimates = [f[0] for f in found if f]
    # one accelerometer's wide limits must not squeeze all others together
    end = 1.15 * max(1.6 * max(estimates), float(np.median([f[1][1] for f in found if f])))
    end = max(end, 1.3 * limit) if limit is not None else end
    for row, (one, values) in enumerate(zip(ranked, found, strict=True)):
        if values is None:
            continue
        value, (lo, hi) = values
        colour = VERDICT_COLOUR[one.verdict]
        axes.plot([lo, min(hi, end)], [row, row], color=colour, linewidth=2.4, alpha=0.45)
        if hi > end:
            axes.plot(end, row, ">", color=colour, markersize=5, clip_on=False, alpha=0.6)
        mark = VERDICT_MARK[one.verdict]
        face = "white" if value == 0.0 else colour
        axes.plot(
            value, row, mark, color=colour, markersize=7, clip_on=False, zorder=3,
            markerfacecolor=face,
        )  # fmt: skip
    if limit is not None:
        line = axes.axvline(limit, color=LIMIT_COLOUR, linestyle="--", linewidth=1.3)
        handles.setdefault("acceptance limit", line)
    axes.set_xlim(0.0, end or 1.0)
    dress(axes, title=title, x=unit)
    axes.grid(visible=False, axis="y")


def _write_verdicts(axes: Any, ranked: Sequence[AccelerometerStability]) -> None:
    """Write verdict and grade to the right of the last panel."""
    right = axes.secondary_yaxis("right")
    texts = [
        ", ".join([a.verdict, *([f"grade {grade_text(a)}"] if a.grade_best else []), *marks_of(a)])
        for a in ranked
    ]
    right.set_yticks(range(len(ranked)), [plain(t) for t in texts])
    right.tick_params(length=0, labelsize=9, pad=9)
    right.spines["right"].set_visible(False)
    for tick, one in zip(right.get_yticklabels(), ranked, strict=True):
        tick.set_color(VERDICT_COLOUR[one.verdict])
        tick.set_fontweight("bold")


def draw_components(found: VarianceFit) -> Picture:
    """Draw the variance components with their limits."""
    shown = found.components
    figure = new_figure(7.0, 1.0 + 0.38 * len(shown))
    axes = figure.subplots()
    least = 0.3 * min(c.sigma or c.ci95[1] for c in shown)
    for row, c in enumerate(shown):
        lo, hi = max(c.ci95[0], least), c.ci95[1]
        axes.plot([lo, hi], [row, row], color="#999999", linewidth=3.0)
        if c.ci95[0] < least:
            axes.plot(least, row, "<", color="#999999", markersize=6, clip_on=False)
        if c.sigma > least:
            axes.plot(c.sigma, row, "o", color=COLOURS[0], markersize=6)
    axes.set_xscale("log")
    axes.set_xlim(left=least)
    axes.xaxis.set_major_formatter("{x:g}")
    names = [f"{c.name.replace('_', ' × ')} ({c.dof})" for c in shown]
    axes.set_yticks(range(len(shown)), names)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    dress(axes, title="Variance components", x="1 σ, µg (logarithmic)")
    return picture(
        figure,
        "components.png",
        "Variance components of the error: points are estimates, bars 95 % limits, arrows to the "
        "left reach down to 0 (no point: the estimate is 0); in brackets the degrees of freedom.",
    )


def draw_runs_of(one: AccelerometerStability, name: str) -> Picture:
    """Draw one accelerometer: K0 and K1 run by run and as curves, and its holds."""
    pair = [c for c in (one.coefficient("k0"), one.coefficient("k1")) if c]
    has_k1 = len(pair) == 2
    figure = new_figure(10.0, 7.4)
    panels = figure.subplots(2, 3 if has_k1 else 2, width_ratios=None).ravel()
    handles: dict[str, Any] = {}
    columns = 3 if has_k1 else 2
    for k, coefficient in enumerate(pair):
        _draw_chart(panels[k], coefficient)
        _draw_curves(panels[columns + k], one, coefficient.name, handles)
    _draw_ranges(panels[columns - 1], pair[0])
    _draw_allan(panels[2 * columns - 1], one)
    figure.suptitle(plain(f"{one.serial}: {len(one.runs.runs)} runs, {one.verdict}"), fontsize=11)
    named = sorted(handles, key=lambda n: n not in DIRECTIONS.values())
    legend_below(figure, [handles[n] for n in named], named, enlarge=1.2)
    limits = "3 σ limits of the chart dashed" if pair[0].chart.limits else "no limits: under 8 runs"
    return picture(
        figure,
        name,
        f"{one.serial}: above, coefficients at {one.runs.joint.t_ref_c:g} °C run by run (bars ± 1 "
        f"σ of the estimation) and moving ranges, {limits}; below, each run's curve less the mean "
        "of the runs, by direction, and the Allan deviation of the holds.",
    )


def _draw_chart(axes: Any, c: CoefficientStability) -> None:
    at = np.arange(c.values.size)
    axes.axhline(c.chart.centre, color="#999999", linewidth=1.0)
    for limit in c.chart.limits or ():
        axes.axhline(limit, color=LIMIT_COLOUR, linestyle="--", linewidth=1.0)
    axes.errorbar(
        at, c.values, yerr=c.sigmas, fmt="-o", color=COLOURS[0], ecolor="#999999",
        linewidth=0.8, markersize=4.0, capsize=2.5,
    )  # fmt: skip
    outside = list(c.chart.outside)
    axes.plot(at[outside], c.values[outside], "o", color=LIMIT_COLOUR, markersize=6.0)
    axes.ticklabel_format(style="plain", axis="y", useOffset=False)
    axes.margins(y=0.15)
    _run_ticks(axes, c.run_ids)
    name = "K0" if c.name == "k0" else "K1 less nominal"
    sigma = sigma_text(c.scatter.sigma_run, c.scatter.ci95)
    dress(axes, title=f"{name}: 1 σ {sigma} {c.unit}", x="run", y=f"{name}, {c.unit}")


def _run_ticks(axes: Any, run_ids: Sequence[str]) -> None:
    step = -(-len(run_ids) // MAX_RUN_NAMES)
    short = [plain(name) for name in short_names(run_ids)]
    slant = 0 if max(map(len, short)) * len(short) / step < 24 else 60
    axes.set_xticks(range(0, len(short), step), short[::step], rotation=slant)
    axes.set_xlim(-0.5, len(run_ids) - 0.5)


def short_names(run_ids: Sequence[str]) -> list[str]:
    """Return names for ticks: of long ones the part in which they differ, at most 8 characters."""
    if max(map(len, run_ids)) <= TICK_LETTERS:
        return list(run_ids)
    turned = [r[::-1] for r in run_ids]
    before, after = _in_common(run_ids), _in_common(turned)
    # not through the middle of a number
    while before and run_ids[0][before - 1].isdigit():
        before -= 1
    while after and turned[0][after - 1].isdigit():
        after -= 1
    parts = [r[before : len(r) - after] for r in run_ids]
    if min(map(len, parts)) == 0:
        parts = list(run_ids)
    return [p if len(p) <= TICK_LETTERS else f"…{p[1 - TICK_LETTERS :]}" for p in parts]


def _in_common(names: Sequence[str]) -> int:
    """Return with how many letters all names begin."""
    alike = [len(set(letters)) == 1 for letters in zip(*names, strict=False)]
    return [*alike, False].index(False)


def _draw_ranges(axes: Any, c: CoefficientStability) -> None:
    axes.plot(np.arange(1, c.values.size), c.chart.ranges, "-s", color=COLOURS[0], markersize=4.0)
    if c.chart.range_limit is not None:
        axes.axhline(c.chart.range_limit, color=LIMIT_COLOUR, linestyle="--", linewidth=1.0)
    _run_ticks(axes, c.run_ids)
    axes.set_ylim(bottom=0.0)
    dress(axes, title="K0: moving range", x="run", y=f"|change from the run before|, {c.unit}")


def _draw_curves(
    axes: Any, one: AccelerometerStability, family: str, handles: dict[str, Any]
) -> None:
    unit = "µg" if family == "k0" else "ppm"
    for s in one.curves:
        curves: FloatArray = s.k0_ug if family == "k0" else s.k1_ppm
        label, colour, _ = DIRECTION_STYLE[s.direction]
        mean = curves.mean(axis=0)
        for k, run in enumerate(s.run_ids):
            number_ = [r.run_id for r in one.runs.runs].index(run)
            (line,) = axes.plot(
                s.temp_c,
                curves[k] - mean,
                color=colour,
                linestyle=STYLES[number_ % len(STYLES)],
                marker=MARKERS[number_ % len(MARKERS)],
                markevery=max(1, s.temp_c.size // 6),
                markersize=3.5,
                linewidth=1.1,
                label=label,
            )
            handles.setdefault(DIRECTIONS[s.direction], line)
            if len(one.runs.runs) <= MAX_RUN_NAMES:
                (key,) = axes.plot(
                    [], [], color="#555555", linestyle=line.get_linestyle(),
                    marker=line.get_marker(), markersize=3.5, linewidth=1.1,
                )  # fmt: skip
                handles.setdefault(run, key)
    axes.axhline(0.0, color="#999999", linewidth=0.8)
    name = family.upper()
    dress(
        axes,
        title=f"{name} curves less their mean",
        x="temperature, °C",
        y=f"{name} less mean of the runs, {unit}",
    )


def _draw_allan(axes: Any, one: AccelerometerStability) -> None:
    dress(axes, title="Allan deviation of the holds", x="averaging time, s", y="deviation, µg")
    found = one.allan
    if not found.tau_s.size:
        axes.set_axis_off()
        axes.set_title("no holds long enough for an Allan deviation", fontsize=9)
        return
    axes.loglog(found.tau_s, found.deviation, "-o", color=COLOURS[0], markersize=4.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
