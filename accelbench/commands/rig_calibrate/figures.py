"""Pictures of a rig calibration: estimates, innovations, sigmas over time, motion."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from accelbench.shell.console import in_words
from accelbench.shell.plotting import (
    COLOURS,
    FEW_LINES,
    Picture,
    draw_largest,
    dress,
    legend_below,
    new_figure,
    picture,
    thinned,
)
from errormodel.arrays import FloatArray
from sinscal.calibration.consistency import ACROSS, ALONG, FORCES
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.integrate import attitudes
from sinscal.filter.layout import ENU
from sinscal.frames.attitude import angles_from_c_nb
from sinscal.frames.earth import ARCSEC
from sinscal.judgement.judge import Judged
from sinscal.judgement.result_file import ResultContent
from sinscal.model.compensate import compensate_run
from sinscal.recording.run import AXES, NavRun, RigRun

ABREAST = 3
SIGMAS = 3.0
BAND = "#DCE6F0"
BOUND = "#D55E00"
CLOCK = "time, cycles side by side, s"
GAP_S = 30.0  # drawn between cycles
EVERY_STEPS = 60  # of the filter between two entries of its sigmas
VELOCITIES = tuple(f"velocity_{a}" for a in ENU)


def calibration_pictures(
    judged: Judged, run: RigRun | NavRun, result: ResultContent
) -> list[Picture]:
    """Draw all pictures of a calibration."""
    return [
        draw_estimates(result),
        draw_innovations(judged),
        draw_sigmas(judged),
        draw_motion(judged, run),
    ]


def draw_estimates(result: ResultContent) -> Picture:
    """Draw each group's estimates with their sigmas, and what was expected beforehand."""
    groups: dict[str, list[str]] = {}
    for name in result.names:
        groups.setdefault(result.described(name).group, []).append(name)
    rows = -(-len(groups) // ABREAST)
    figure = new_figure(11.0, 0.6 + 2.6 * rows)
    panels = figure.subplots(rows, ABREAST, squeeze=False).ravel()
    for axes, (group, names) in zip(panels, groups.items(), strict=False):
        _draw_group(axes, group, names, result)
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    caption = (
        f"Estimates with ± {SIGMAS:g} sigma, which is often smaller than the marker; the band is "
        f"the prior sigma."
    )
    return picture(figure, "estimates.png", caption)


def _draw_group(axes: Any, group: str, names: list[str], result: ResultContent) -> None:
    told = result.described(names[0]).told_in
    unit, size = told.unit, told.size
    for k, name in enumerate(names):
        one, prior = result.parameters[name], result.prior[name]
        lo, hi = ((prior.mean + s * prior.sigma) / size for s in (-1.0, 1.0))
        axes.fill_between([k - 0.4, k + 0.4], lo, hi, color=BAND, linewidth=0)
        axes.errorbar(
            k, one.value / size, yerr=SIGMAS * one.sigma / size, fmt="o", color=COLOURS[0],
            markersize=3.5, capsize=3.0,
        )  # fmt: skip
    described = [result.described(name) for name in names]
    axes_of = [one.axis for one in described]
    by_axis = all(axes_of) and len(set(axes_of)) == len(axes_of)
    labels = axes_of if by_axis else [one.symbol for one in described]
    axes.set_xticks(range(len(names)), labels, rotation=90.0 if len(names) > 6 else 0.0)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.axhline(0.0, color="#BBBBBB", linewidth=0.8, zorder=0)
    axes.margins(y=0.1)
    dress(axes, title=f"{in_words(group)}, {unit}")


def _clock(judged: Judged) -> tuple[FloatArray, FloatArray]:
    """Return the time of each step with cycles side by side, s, and where cycles begin."""
    cycle, time_s = judged.found.cycle_of_step, judged.found.time_s
    out = np.full(time_s.shape, np.nan)
    starts: list[float] = []
    at = 0.0
    for k in range(int(cycle.max()) + 1):
        mine = cycle == k
        own = time_s[mine] - float(np.min(time_s[mine]))
        out[mine] = at + own
        starts.append(at)
        at += float(own.max()) + GAP_S
    return out, np.array(starts)


def draw_innovations(judged: Judged) -> Picture:
    """Draw innovations over time with their bounds, and what was refused."""
    found = judged.found
    filtered, names = found.filtered, judged.rows.names
    clock, starts = _clock(judged)
    figure = new_figure(11.0, 0.8 + 1.7 * len(names))
    panels = figure.subplots(len(names), 1, squeeze=False, sharex=True).ravel()
    handles: dict[str, Any] = {}
    for j, (axes, name) in enumerate(zip(panels, names, strict=True)):
        unit, size = _unit_of_row(name)
        values = filtered.innovation[:, j] / size
        bound = SIGMAS * np.sqrt(filtered.variance[:, j]) / size
        used = filtered.used[:, j]
        (dots,) = axes.plot(clock[used], values[used], ".", color=COLOURS[4], markersize=2.0)
        (line,) = axes.plot(clock, bound, color=BOUND, linewidth=1.0)
        axes.plot(clock, -bound, color=BOUND, linewidth=1.0)
        handles |= {"innovation": dots, f"± {SIGMAS:g} sigma": line}
        refused = np.isfinite(values) & ~used
        settled = np.nanpercentile(bound[used], 75) if used.any() else 1.0
        top = 2.0 * float(settled)
        if refused.any():
            shown = np.clip(values[refused], -0.95 * top, 0.95 * top)
            (cross,) = axes.plot(clock[refused], shown, "x", color=COLOURS[0], markersize=6.0)
            handles["refused (drawn at the edge where it lies beyond)"] = cross
        axes.set_ylim(-top, top)
        for start in starts[1:]:
            axes.axvline(start - 0.5 * GAP_S, color="#999999", linewidth=0.8, linestyle=":")
        dress(
            axes,
            y=f"{name}, {unit}",
            x=CLOCK if axes is panels[-1] else "",
        )
    legend_below(figure, list(handles.values()), list(handles))
    caption = (
        "Innovations with their expected bounds; dotted lines separate the cycles. The first "
        "innovations of a cycle have wide bounds beyond the plotted range."
    )
    return picture(figure, "innovations.png", caption)


def _unit_of_row(name: str) -> tuple[str, float]:
    if name in FORCES:
        return "mm/s²", 1e-3
    if name in (ALONG, *ACROSS):
        return "arcsec", ARCSEC
    return ("mm/s", 1e-3) if name in VELOCITIES else ("m", 1.0)


def draw_sigmas(judged: Judged) -> Picture:
    """Draw how each group's sigmas fall over time, against the prior's."""
    found = judged.found
    states = judged.found.layout.names
    clock, starts = _clock(judged)
    steps = np.arange(1, len(found.filtered.sigmas) + 1) * EVERY_STEPS - 1
    groups: dict[str, list[int]] = {}
    for name in found.names:
        groups.setdefault(found.described(name).group, []).append(states.index(name))
    figure = new_figure(11.0, 4.6)
    axes = figure.subplots()
    times: dict[str, FloatArray] = {}
    shares: dict[str, FloatArray] = {}
    for group, places in groups.items():
        prior = found.start.sigmas[places]
        kept = prior > 0
        if not kept.any():
            continue
        ratio = found.filtered.sigmas[:, np.array(places)[kept]] / prior[kept]
        mean = np.exp(np.mean(np.log(np.maximum(ratio, 1e-12)), axis=1))
        times[in_words(group)] = np.append(0.0, clock[steps])
        shares[in_words(group)] = np.append(1.0, mean)
    lines = draw_largest(axes, times, shares)
    axes.set_yscale("log")
    for start in starts[1:]:
        axes.axvline(start - 0.5 * GAP_S, color="#999999", linewidth=0.8, linestyle=":")
    dress(axes, x=CLOCK, y="sigma over that of the prior")
    legend_below(figure, list(lines.values()), list(lines))
    caption = (
        "Sigmas over time by group: the geometric mean of sigma over prior sigma; named are the "
        f"{FEW_LINES} largest at the end."
    )
    return picture(figure, "sigmas.png", caption)


def correlations_of(judged: Judged) -> tuple[list[str], FloatArray]:
    """Return the names of what was estimated, p of them, and their correlations, (p, p)."""
    found = judged.found
    sigma = found.sigmas
    free = np.flatnonzero(sigma > 0)
    names = [found.names[int(i)] for i in free]
    return names, found.cov[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])


def draw_motion(judged: Judged, run: RigRun | NavRun) -> Picture:
    """Draw the rates and the attitude of the programme."""
    nav = isinstance(run, NavRun)
    figure = new_figure(11.0, 3.2 if nav else 5.4)
    panels = figure.subplots(1 if nav else 2, 1, squeeze=False, sharex=True).ravel()
    lines: Mapping[str, Any] = {}
    at = 0.0
    for rows, c_nb in _attitudes(judged, run):
        keep = rows.start + thinned(rows.stop - rows.start, 1500)
        clock = at + run.time_s[keep] - run.time_s[rows.start]
        if isinstance(run, RigRun):
            for k, axis in enumerate(AXES):
                rate = np.rad2deg(run.gyro[keep, k])
                (lines[f"rate {axis}"],) = panels[0].plot(  # type: ignore[index]
                    clock, rate, color=COLOURS[k], linewidth=1.1
                )
        angles = angles_from_c_nb(c_nb[keep - rows.start])
        for k, (name, values) in enumerate(zip(("roll", "pitch", "heading"), angles, strict=True)):
            (lines[name],) = panels[-1].plot(  # type: ignore[index]
                clock, np.rad2deg(values), ".", color=COLOURS[4 - k], markersize=1.5
            )
        at += float(run.time_s[rows.stop - 1] - run.time_s[rows.start]) + GAP_S
    if not nav:
        dress(panels[0], y="measured rate, °/s")
    dress(panels[-1], x=CLOCK, y="attitude, °")
    legend_below(figure, list(lines.values()), list(lines), enlarge=6.0)
    caption = "Measured rates and the attitude found, cycles side by side."
    return picture(figure, "motion.png", caption)


def _attitudes(judged: Judged, run: RigRun | NavRun) -> Iterator[tuple[slice, FloatArray]]:
    """Yield each cycle's rows and attitude."""
    found = judged.found
    if isinstance(run, NavRun) or not isinstance(found, RigCalibration):
        assert isinstance(run, NavRun)
        for rows in run.cycles:
            yield rows, run.c_nb[rows]
        return
    values = found.values[: len(found.sensors.names)]
    true = compensate_run(run, found.sensors, values)
    for k, rows in enumerate(run.cycles):
        _, end = attitudes(
            true.gyro[rows], run.step_s[rows], found.nominal.c_start[k], found.nominal.earth[k]
        )
        yield rows, end
