"""Pictures of a combined calibration: errors over temperature, what was moved, the flight."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from accelbench.joint.result_file import CombinedResult
from accelbench.shell.plotting import (
    COLOURS,
    Picture,
    dress,
    legend_below,
    new_figure,
    picture,
    thinned,
)
from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.model import ErrorModel
from errormodel.record import Record
from sinscal.combination.combine import Combination
from sinscal.model.chamber import ChamberModel
from sinscal.recording.run import AXES, RigRun
from thermo.recording.signals import Conditions, signals_of

SIGMAS = 3.0
POINTS = 60
MICRO = 1e6
BAND = "#DCE6F0"
CASES = {
    "no_thermal": "without thermal model",
    "before": "applied beforehand",
    "combined": "combined",
}


def combine_pictures(
    made: Combination, run: RigRun, chambers: Sequence[ChamberModel], result: CombinedResult
) -> list[Picture]:
    """Draw all pictures that are a combined calibration's own."""
    return [
        draw_temperature(run),
        draw_models(made, run, chambers),
        draw_moved(result),
        draw_flight_errors(result),
    ]


def draw_temperature(run: RigRun) -> Picture:
    """Draw how the accelerometers warmed while the SINS turned."""
    figure = new_figure(9.0, 3.0)
    axes = figure.subplots()
    assert run.temp_c is not None
    rows = thinned(len(run), 2000)
    handles: list[Any] = []
    for k in range(3):
        minutes = (run.time_s[rows] - run.time_s[0]) / 60.0
        handles += axes.plot(minutes, run.temp_c[rows, k], color=COLOURS[k])
    dress(axes, x="time from the start of the run, min", y="temperature, °C")
    legend_below(figure, handles, [f"accelerometer {a}" for a in AXES])
    return picture(
        figure, "temperature.png", "Temperatures of the accelerometers over the rig run."
    )


def _bias_and_scale(
    model: ErrorModel, values: FloatArray, cov: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return bias, µg, and slope, ppm, over x = T − t_ref, and their sigmas, each (n, 2)."""
    names = dict(zip(model.names, values.tolist(), strict=True))
    out, sigma = np.zeros((x.size, 2)), np.zeros((x.size, 2))
    rest, loaded = _at(model, x, 0.0), _at(model, x, 1.0)
    by_rest, by_load = derivative(model, rest, names), derivative(model, loaded, names)
    low, high = model.simulate(rest, names), model.simulate(loaded, names)
    for k, (value, by) in enumerate(((low, by_rest), (high - low, by_load - by_rest))):
        out[:, k] = MICRO * value
        variance = np.einsum("np,pq,nq->n", by, cov, by)
        sigma[:, k] = MICRO * np.sqrt(np.maximum(variance, 0.0))
    return out, sigma


def _at(model: ErrorModel, x: FloatArray, force_g: float) -> Record:
    """Return a record at rest at temperatures, with a force along the input axis."""
    none, time_s = np.zeros(x.size), np.arange(x.size, dtype=float)
    at = Conditions(
        time_s=time_s,
        run=np.zeros(x.size, dtype=np.intp),
        temp_c=x,
        position_deg=none,
        force_g=(none + force_g, none, none),
        elapsed_h=none,
        t_ref_c=0.0,
        known_slow=(x, none),
        known_mounting=0.0,
    )
    return Record(time_s=time_s, signals=dict.fromkeys(model.needs, none) | signals_of(at))


def draw_models(made: Combination, run: RigRun, chambers: Sequence[ChamberModel]) -> Picture:
    """Draw each accelerometer's errors over temperature: by the chamber, and combined."""
    assert run.temp_c is not None
    found = made.calibration
    figure = new_figure(11.0, 9.0)
    panels = figure.subplots(4, 3, squeeze=False, sharex=True)
    handles: list[Any] = []
    for axis, given in enumerate(chambers):
        chamber = given.without_mounting()
        names = [f"{n}_{AXES[axis]}" for n in chamber.model.names]
        at = [found.names.index(n) for n in names]
        seen = run.temp_c[:, axis]
        temp_c = np.linspace(float(seen.min()), float(seen.max()), POINTS)
        x = temp_c - chamber.t_ref_c
        before, wide = _bias_and_scale(chamber.model, chamber.values, chamber.cov, x)
        cov = found.cov[np.ix_(at, at)]
        joint, narrow = _bias_and_scale(chamber.model, found.values[at], cov, x)
        zero, _ = _bias_and_scale(chamber.model, found.values[at], cov, np.zeros(2))
        for k, what in enumerate(("bias, µg", "scale, ppm")):
            whole, apart = panels[2 * k][axis], panels[2 * k + 1][axis]
            whole.plot(temp_c, joint[:, k] - zero[0, k], color=COLOURS[0])
            moved = before[:, k] - joint[:, k]
            edges = [moved + s * SIGMAS * wide[:, k] for s in (-1.0, 1.0)]
            band = apart.fill_between(temp_c, *edges, color=BAND, linewidth=0)
            (line,) = apart.plot(temp_c, moved, "--", color="#0072B2")
            (both,) = apart.plot(temp_c, 0.0 * moved, color=COLOURS[0])
            for s in (-1.0, 1.0):
                (edge,) = apart.plot(temp_c, s * SIGMAS * narrow[:, k], ":", color=COLOURS[0])
                handles = [both, edge, line, band]
            title = f"{given.serial} on {AXES[axis]}" if k == 0 else ""
            dress(whole, title=title, y=what if axis == 0 else "")
            label = "temperature, °C" if k == 1 else ""
            dress(apart, x=label, y=f"difference, {what[-3:].strip(', ')}" if axis == 0 else "")
    own = ["combined", f"combined ± {SIGMAS:g} sigma", "chamber", f"chamber ± {SIGMAS:g} sigma"]
    legend_below(figure, handles, own, enlarge=1.0)
    caption = (
        "Bias and scale factor over the temperatures of the run, minus those at the reference "
        "temperature; below each the difference between the chamber's model and the combined "
        "calibration. A combined line outside the chamber's band is a contradiction."
    )
    return picture(figure, "models.png", caption)


def draw_moved(result: CombinedResult) -> Picture:
    """Draw by how many of the chamber's sigmas the rig moved each of its coefficients."""
    names = list(result.prior_pull)
    pulls = np.array([result.prior_pull[n] for n in names])
    kept = np.array([result.prior_kept[n] for n in names])
    figure = new_figure(9.0, 0.9 + 0.2 * len(names))
    left, right = figure.subplots(1, 2, sharey=True)
    place = np.arange(len(names))
    colours = [COLOURS[AXES.index(n[-1])] for n in names]
    left.axvspan(-SIGMAS, SIGMAS, color=BAND, linewidth=0)
    left.barh(place, pulls, color=colours)
    left.set_xlim(*(s * max(4.0, 1.1 * float(np.max(np.abs(pulls)))) for s in (-1.0, 1.0)))
    right.barh(place, kept, color=colours)
    right.set_xlim(0.0, 1.05)
    left.set_yticks(place, names)
    left.invert_yaxis()
    dress(left, x="change, sigmas of the chamber")
    dress(right, x="sigma, share of the chamber's")
    caption = (
        f"Change of the chamber's coefficients due to the rig; the band is ± {SIGMAS:g} sigma. "
        "A coefficient that the rig does not determine keeps its value and its sigma."
    )
    return picture(figure, "moved.png", caption)


def draw_flight_errors(result: CombinedResult) -> Picture:
    """Draw the error of autonomous navigation after an hour for the three calibrations."""
    figure = new_figure(6.0, 2.4)
    axes = figure.subplots()
    values = [getattr(result.flight_m, case) for case in CASES]
    bars = axes.barh(list(CASES.values()), values, color=[COLOURS[6], COLOURS[4], COLOURS[2]])
    axes.bar_label(bars, [f"{v:.0f} m" for v in values], padding=3, fontsize=8)
    axes.set_xlim(0.0, 1.2 * max(values))
    axes.invert_yaxis()
    dress(axes, x="ρ after an hour of flight, m")
    caption = (
        "Standard deviation of the position of autonomous navigation after an hour, for a flight "
        "that warms up as the rig run did."
    )
    return picture(figure, "flight.png", caption)
