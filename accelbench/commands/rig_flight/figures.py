"""Pictures of a flight: position error over time with what it is made of, and the trajectory."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from accelbench.commands.rig_flight.text import FlownCalibration, group_title, trajectory
from accelbench.shell.plotting import (
    COLOURS,
    STYLES,
    Picture,
    dress,
    legend_below,
    new_figure,
    picture,
)
from errormodel.arrays import FloatArray
from sinscal.flight.covariance import NOISE
from sinscal.flight.navigation_errors import DV, PHI
from sinscal.flight.trajectory import Flight, FlightPlan, fly
from sinscal.frames.attitude import angles_from_c_nb
from sinscal.frames.earth import ARCMIN

SHOWN_SHARE = 0.005  # of ρ² at some time
FEW_PERIODS = 3.5


PICTURES = ("flight-error.png", "flight-sigmas.png", "flight-trajectory.png")


def draw_flight(
    plan: FlightPlan, flown: Sequence[FlownCalibration]
) -> tuple[Picture, Picture, Picture]:
    """Draw the position's error, the sigmas of attitude and velocity, and the trajectory."""
    position, sigmas, way = PICTURES
    drawn = _errors(plan, flown, position), _sigmas(flown, sigmas)
    return *drawn, _trajectory(fly(plan, 1.0), way)


def _sigmas(flown: Sequence[FlownCalibration], name: str) -> Picture:
    figure = new_figure(11.0, 3.8)
    tilt, heading, velocity = figure.subplots(1, 3)
    handles: dict[str, Any] = {}
    for k, one in enumerate(flown):
        minutes, colour = one.found.time_s / 60.0, COLOURS[k % len(COLOURS)]
        attitude, speed = one.found.sigma[:, PHI] / ARCMIN, one.found.sigma[:, DV]
        for j, axis in enumerate(("east", "north")):  # up is the heading, and the height is held
            style = STYLES[j]
            (line,) = tilt.plot(minutes, attitude[:, j], color=colour, linestyle=style)
            handles[f"{one.name}, {axis}"] = line
            velocity.plot(minutes, speed[:, j], color=colour, linestyle=style)
        (line,) = heading.plot(minutes, attitude[:, 2], color=colour, linestyle=STYLES[2])
        handles[f"{one.name}, heading"] = line
    dress(tilt, title="tilt about east and north", x="time, min", y="σ, arcmin")
    dress(heading, title="heading", x="time, min", y="σ, arcmin")
    dress(velocity, title="velocity east and north", x="time, min", y="σ, m/s")
    for axes in (tilt, heading, velocity):
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
    legend_below(figure, list(handles.values()), list(handles), enlarge=1.0)
    caption = "Standard deviations of attitude and velocity over the flight, by axis."
    return picture(figure, name, caption)


def _errors(plan: FlightPlan, flown: Sequence[FlownCalibration], name: str) -> Picture:
    figure = new_figure(4.2 * max(len(flown), 2), 4.2)
    panels = figure.subplots(1, len(flown), squeeze=False, sharey=True)[0]
    groups = [
        group
        for group in dict.fromkeys(g for one in flown for g in one.found.share)
        if any(np.abs(one.found.share[group]).max() > SHOWN_SHARE for one in flown)
    ]
    handles: dict[str, Any] = {}
    for axes, one in zip(panels, flown, strict=True):
        minutes = one.found.time_s / 60.0
        (line,) = axes.plot(minutes, one.found.rho_m, color=COLOURS[0], linewidth=2.2)
        handles.setdefault("all together", line)
        for k, group in enumerate(groups):
            part = one.found.rho_m * np.sqrt(np.maximum(one.found.share[group], 0.0))
            style = ":" if group == NOISE else STYLES[k % 3]
            colour = COLOURS[1 + k % (len(COLOURS) - 1)]
            (line,) = axes.plot(minutes, part, color=colour, linestyle=style)
            handles.setdefault(group_title(group), line)
        title = f"{one.name}: {one.found.rho_end_m:.0f} m at the end"
        dress(axes, title=title, x="time, min", y="ρ, m" if axes is panels[0] else "")
        axes.set_xlim(0.0, minutes[-1])
        axes.set_ylim(bottom=0.0)
    legend_below(figure, list(handles.values()), list(handles), enlarge=1.0)
    return picture(
        figure,
        name,
        f"Standard deviation ρ of the position of autonomous navigation, {trajectory(plan)}. The "
        f"squares of the parts add up to that of the whole.",
    )


def _trajectory(flight: Flight, name: str) -> Picture:
    plan = flight.plan
    figure = new_figure(9.0, 3.4)
    way, near = figure.subplots(1, 2)
    ahead, right = _along_and_across(flight)
    way.plot(ahead / 1e3, right / 1e3, color=COLOURS[0], linewidth=1.0)
    dress(way, title=trajectory(plan).partition(",")[0], x="ahead, km", y="to the right, km")
    way.margins(y=0.15)
    roll, _, heading = angles_from_c_nb(flight.c_nb)
    turned = np.rad2deg(np.angle(np.exp(1j * (heading - plan.heading_rad))))
    until = flight.time_s <= plan.takeoff_s + FEW_PERIODS * plan.period_s
    minutes = flight.time_s[until] / 60.0
    (first,) = near.plot(minutes, turned[until], color=COLOURS[0])
    (second,) = near.plot(minutes, np.rad2deg(roll)[until], color=COLOURS[1], linestyle="--")
    dress(near, title="take-off and the first oscillations", x="time, min", y="angle, °")
    labels = ["heading less its mean", "bank, positive to the right"]
    legend_below(figure, [first, second], labels, enlarge=1.0)
    caption = (
        f"The flight: {trajectory(plan)}; the axes of the path have different scales, and its "
        f"mean line is offset from the starting line."
    )
    return picture(figure, name, caption)


def _along_and_across(flight: Flight) -> tuple[FloatArray, FloatArray]:
    """Return the way made along the mean heading and to its right, m: speeds summed."""
    plan = flight.plan
    mean = 0.5 * (flight.velocity[1:] + flight.velocity[:-1]) * flight.step_s
    east, north = (np.concatenate([[0.0], np.cumsum(mean[:, k])]) for k in (0, 1))
    s, c = np.sin(plan.heading_rad), np.cos(plan.heading_rad)
    return east * s + north * c, east * c - north * s
