"""Pictures of a rig test before there is one: its motion, and how its sigmas come down."""

from typing import Any

import numpy as np

from accelbench.commands.rig_plan.text import groups_in, main_sources
from accelbench.shell.console import in_words
from accelbench.shell.plotting import (
    COLOURS,
    FEW_LINES,
    STYLES,
    Picture,
    draw_largest,
    dress,
    legend_below,
    new_figure,
    picture,
    thinned,
)
from errormodel.arrays import FloatArray
from sinscal.planning.covariance import RigCovariance
from sinscal.recording.run import AXES
from sinscal.twin.motion import CycleMotion, RigMotion, rig_motion
from sinscal.twin.programme import Programme

MOTION_RATE_HZ = 10.0
CLOSE_S = 120.0  # of each cycle's start are shown closely
MAX_CLOSE = 3
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")
# of the sources of error, in the order of the budget; priors come after the noises
SOURCE_COLOURS = (*COLOURS[1:5], "#0072B2", "#D55E00", "#F0E442", *COLOURS[5:], "#444444")
MIN_SHARE = 0.005  # sources below it in every group are drawn together


def draw_programme(programme: Programme) -> Picture:
    """Draw a programme's rates, angle, and the vertical in the body at each cycle's start."""
    true = rig_motion(programme, MOTION_RATE_HZ)
    figure = new_figure(10.0, 7.6)
    grid = figure.add_gridspec(3, MAX_CLOSE)
    rates, turns = (figure.add_subplot(grid[k, :]) for k in (0, 1))
    turns.sharex(rates)
    lines: dict[str, Any] = {}
    for start_s, cycle in zip(true.start_s.tolist(), true.cycles, strict=True):
        rows = thinned(len(cycle.motion), 3000)
        minutes = (start_s + cycle.motion.time_s[rows]) / 60.0
        for j, axis in enumerate(AXES):
            (line,) = rates.plot(
                minutes,
                np.rad2deg(cycle.motion.w[rows, j]),
                STYLES[j],
                color=AXIS_COLOURS[j],
                linewidth=1.3,
            )
            lines.setdefault(axis, line)
        turns.plot(minutes, cycle.angle[rows] / (2.0 * np.pi), color=COLOURS[0], linewidth=1.3)
    dress(rates, title="rates of the body", y="rate, °/s")
    dress(turns, title="angle of the platform", x="time, min", y="turns")
    for k, cycle in enumerate(true.cycles[:MAX_CLOSE]):
        _draw_vertical(figure.add_subplot(grid[2, k]), true, cycle, k)
    legend_below(figure, list(lines.values()), [f"body axis {axis}" for axis in lines])
    left = len(true.cycles) - MAX_CLOSE
    caption = (
        "Rates of the body's axes (with the earth's rotation), angle of the platform, and the "
        f"specific force in the body's axes in the first {CLOSE_S:g} s of each cycle."
    )
    caption += f" {left} further cycles are not shown in detail." if left > 0 else ""
    return picture(figure, "programme.png", caption)


def _draw_vertical(axes: Any, true: RigMotion, cycle: CycleMotion, k: int) -> None:
    early = cycle.motion.time_s <= CLOSE_S
    for j in range(3):
        axes.plot(
            cycle.motion.time_s[early],
            cycle.motion.f[early, j] / true.site.gravity_m_s2,
            STYLES[j],
            color=AXIS_COLOURS[j],
            linewidth=1.1,
        )
    title = f"cycle {k + 1}, about {true.axes[k]}"
    dress(axes, title=title, x="time in the cycle, s", y="force, g" if k == 0 else "")


def draw_planned_sigmas(one: RigCovariance, mode: str) -> Picture:
    """Draw how much of each group's prior sigma is left over time."""
    figure = new_figure(10.0, 4.6)
    axes = figure.subplots()
    minutes = one.time_s / 60.0
    left = {
        in_words(group): np.median(one.history[:, places] / one.prior_sigmas[places], axis=1)
        for group, places in groups_in(one).items()
    }
    lines = draw_largest(axes, dict.fromkeys(left, minutes), left)
    axes.set_yscale("log")
    for end in _cycle_ends(one)[:-1]:
        axes.axvline(end / 60.0, color="#999999", linestyle="--", linewidth=0.9)
    dress(axes, title=f"{mode}", x="time on the rig, min", y="sigma over its prior")
    legend_below(figure, list(lines.values()), list(lines), enlarge=1.3)
    caption = (
        f"{mode.capitalize()}: sigmas over time, the median of each group over its prior sigma; "
        f"named are the {FEW_LINES} largest at the end. "
        "Dashed: a cycle ends; the time between cycles is left out."
    )
    return picture(figure, f"sigmas_{mode}.png", caption)


def _cycle_ends(one: RigCovariance) -> FloatArray:
    """Return when each cycle ends on the time axis of the history, s."""
    return np.cumsum(one.cycle_s)


def draw_budget(one: RigCovariance, mode: str) -> Picture:
    """Draw each source's share of the variance of each group."""
    groups = list(groups_in(one))
    shares = {s: v for s, v in main_sources(one).items() if np.max(v) >= MIN_SHARE}
    rest = 1.0 - np.sum([*shares.values()], axis=0)
    if np.max(rest) > 1e-3:
        shares["all others"] = rest
    figure = new_figure(10.0, 1.4 + 0.36 * len(groups))
    axes = figure.subplots()
    left, bars = np.zeros(len(groups)), list[Any]()
    for k, part in enumerate(shares.values()):
        colour = SOURCE_COLOURS[k % len(SOURCE_COLOURS)]
        bars.append(
            axes.barh(
                [in_words(g) for g in groups],
                100.0 * part,
                left=100.0 * left,
                color=colour,
                height=0.7,
            )
        )
        left = left + part
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    dress(axes, title=mode, x="share of the variance, %")
    legend_below(figure, bars, list(shares), enlarge=1.0)
    caption = (
        f"{mode.capitalize()}: what each noise and each prior contributes to the final variance, "
        "mean over each group."
    )
    return picture(figure, f"budget_{mode}.png", caption)
