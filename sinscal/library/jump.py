"""Constant errors with a step or a drift within a run."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Term
from sinscal.library import accelerometer, gyro
from sinscal.library.groups import TIME, ChannelId, Group, Kind, RigEffect, needing, term_of

CONSTANT_ERRORS = {"gyro": gyro.BIAS, "accel": accelerometer.BIAS}
# Prior of the drift: the effect of this unrecorded temperature change, °C.
UNRECORDED_C = 5.0


def constant_error_step(kind: Kind, at_s: float) -> Group:
    """Return a step of the constant errors of a kind of sensor, at a time since the run began."""

    def after(record: Record) -> FloatArray:
        return (record["elapsed_s"] > at_s).astype(float)

    def make(c: ChannelId) -> Term:
        name = f"{kind}_bias_step_{c.letter}"
        part = (name, f"Δ{c.letter}", _unit(kind), after)
        return _passing(term_of(name, "The constant error has a step.", [part]))

    return _of_constant_error(kind, "step", make)


def fading(since_s: FloatArray, tau_s: float, span_s: float) -> FloatArray:
    """Return a function that rises by one over a run, linearly or decaying."""
    inside = np.clip(since_s, 0.0, span_s)
    if not np.isfinite(tau_s):
        return inside / span_s
    return np.expm1(-inside / tau_s) / np.expm1(-span_s / tau_s)


def constant_error_drift(kind: Kind, tau_s: float, span_s: float) -> Group:
    """Return a drift of the constant errors over a run, zero in its mean."""
    share = tau_s / span_s
    mean = 0.5 if not np.isfinite(tau_s) else -1.0 / np.expm1(-1.0 / share) - share

    def course(record: Record) -> FloatArray:
        return fading(record["elapsed_s"], tau_s, span_s) - mean

    def make(c: ChannelId) -> Term:
        name = f"{kind}_bias_drift_{c.letter}"
        part = (name, f"δ{c.letter}", _unit(kind), course)
        return _passing(term_of(name, "The constant error drifts.", [part]))

    return _of_constant_error(kind, "drift", make)


def _of_constant_error(kind: Kind, change: str, make: Callable[[ChannelId], Term]) -> Group:
    """Return the group of a change of the constant errors, with their prior and unit."""
    constant = CONSTANT_ERRORS[kind]
    return Group(
        name=f"{constant.name}_{change}",
        kinds=(kind,),
        make=make,
        prior_sigma=constant.prior_sigma,
        told=constant.told,
        family=constant.name,
    )


def _unit(kind: Kind) -> str:
    return "rad/s" if kind == "gyro" else "m/s²"


def _passing(term: Term) -> Term:
    return replace(needing(term, "elapsed_s"), predictive=False)


GROUPS: tuple[
    Group, ...
] = ()  # each belongs to a time: see `constant_error_step`, `constant_error_drift`
_SENSORS: tuple[tuple[Kind, str, Group], ...] = (
    ("gyro", "gyros", gyro.TEMPERATURE_DRIFT),
    ("accel", "accelerometers", accelerometer.TEMPERATURE_BIAS),
)
EFFECTS = tuple(
    RigEffect(
        name=f"{kind}_bias_step",
        sentence=f"The constant errors of the {sensors} jumped.",
        experiment="repeat the run: a step does not repeat at the same time",
        follows=TIME,
        step=kind,
    )
    for kind, sensors, _ in _SENSORS
)
JUMPS = tuple(e.name for e in EFFECTS)
# A calibration is tested for these beside the effects: drifts by any smooth course.
DRIFTS = tuple(
    RigEffect(
        name=f"{kind}_bias_drift",
        sentence=f"The constant errors of the {sensors} drift slowly.",
        experiment="record the temperature, repeat the run, and make the cycles shorter",
        follows=TIME,
        drift=kind,
        prior_sigma=UNRECORDED_C * warmth.prior_sigma,
    )
    for kind, sensors, warmth in _SENSORS
)
DRIFT_SIGMAS = {e.drift: float(e.prior_sigma or 0.0) for e in DRIFTS if e.drift}
