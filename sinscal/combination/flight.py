"""Flight errors after three calibrations of a SINS that warms itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.gains import covariance_share
from errormodel.filter.kalman import State
from errormodel.filter.steps import run_filter
from sinscal.calibration.rig import RigCalibration
from sinscal.flight.covariance import flight_sensitivity
from sinscal.flight.navigation_errors import DLAT, DLON
from sinscal.flight.trajectory import FlightPlan
from sinscal.frames.earth import A_M
from sinscal.model.motion import Motion
from sinscal.model.priors import RigPrior
from sinscal.recording.run import AXES, RigRun


def flight_errors(
    run: RigRun,
    ended: RigCalibration,
    before: RigCalibration,
    plain: RigCalibration,
    known: RigPrior,
    plan: FlightPlan,
) -> dict[str, float]:
    """Return ρ at the end of a flight for the three calibrations.

    What the plain one leaves is taken from the combined one: how the two differ over the flight.
    The sensors are those of the calibration beforehand, which have all unknowns of the others.
    """
    sensors, count = before.sensors, len(before.sensors.names)
    at = [sensors.names.index(n) for n in ended.sensors.names]
    values = np.zeros(count)
    values[at] = ended.values[: len(at)]
    warm = _warming(run)

    def columns(motion: Motion) -> FloatArray:
        warmed = replace(motion, temp_c=warm(motion.time_s - motion.time_s[0]))
        out = np.zeros((len(motion), 6, count + 1))
        block = sensors.columns(warmed, values)
        for j in range(block.shape[1]):
            out[:, sensors.owner[j], j] = block[:, j]
        total = sensors.errors(warmed, values)
        by_plain = plain.sensors.errors(warmed, plain.values[: len(plain.sensors.names)])
        out[:, :, count] = total - by_plain
        return out

    names = (*sensors.names, "residual of the plain calibration")
    psi = flight_sensitivity(plan, names, columns=columns).psi[-1][[DLAT, DLON]]
    lat = plan.latitude_rad
    to_m = A_M * np.array([1.0, np.cos(lat)])
    psi = to_m[:, None] * psi
    own, left = psi[:, :count], psi[:, count]

    def rho(cov: FloatArray, more: FloatArray) -> float:
        return float(np.sqrt(np.trace(own @ cov @ own.T) + more @ more))

    zero = np.zeros(2)
    combined = np.zeros((count, count))
    combined[np.ix_(at, at)] = ended.cov[: len(at), : len(at)]
    return {
        "no_thermal": rho(combined, left),
        "before": rho(_true_cov(before, known), zero),
        "combined": rho(combined, zero),
    }


def _true_cov(before: RigCalibration, known: RigPrior) -> FloatArray:
    """Return the covariance of a calibration that took the chamber's model for exact.

    Its gains are what they are; the chamber's own covariance is sent through them.
    """
    layout = before.layout
    start: State = before.start
    gains = run_filter(start, before.steps, with_gains=True).gains
    cov = start.cov
    unknown = layout.unknowns
    fixed = np.flatnonzero(np.diag(start.cov)[unknown] == 0.0)
    at = fixed + unknown.start
    cov[np.ix_(at, at)] = known.cov[np.ix_(fixed, fixed)]
    share = covariance_share(before.steps, gains, cov, before.steps.r, before.steps.q)
    return share[unknown, unknown]


def _warming(run: RigRun) -> Callable[[FloatArray], FloatArray]:
    """Return the temperatures over time of the rig run, for a flight that warms up alike."""
    assert run.temp_c is not None
    time_s, temp_c = run.time_s - run.time_s[0], np.asarray(run.temp_c)
    order = np.argsort(time_s, kind="stable")

    def warm(at_s: FloatArray) -> FloatArray:
        return np.column_stack(
            [
                cast(FloatArray, np.interp(at_s, time_s[order], temp_c[order, k]))
                for k in range(len(AXES))
            ]
        )

    return warm
