"""Calibration of a SINS from what it puts out while it navigates on the rig.

The SINS stands still (its centre does), so that its velocity is its velocity error and its position
its position error. The heights of such systems are held by another sensor, so that the vertical
channel carries nothing; when the recorded height runs free it is used as well.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.filter.steps import NO_GATE
from sinscal.calibration.found import FilterCalibration
from sinscal.calibration.nav_filter import POSITION_FLOOR_M, VELOCITY_FLOOR_M_S, NavFilter, NavNoise
from sinscal.calibration.nav_outputs import free_height, nav_cycle
from sinscal.filter.iterate import STEP_SIGMAS, Pass, iterated
from sinscal.frames.earth import radii_m
from sinscal.model.priors import RigPrior, make_prior
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import NavRun


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavCalibration(FilterCalibration):
    """Calibration of the sensors from the outputs of navigation.

    Attributes
    ----------
    noise : NavNoise
    mode : str
    """

    noise: NavNoise
    mode: str = "navigation"

    @property
    def judged(self) -> tuple[int, ...]:
        """The measurements whose innovations are white: velocities.

        The positions are their integrals, so that their noise is a bound.
        """
        return tuple(range(len(self.layout.integrals) // 2))


def nav_noise_of(run: NavRun) -> NavNoise:
    """Return the noise that a run's facts state.

    Raises
    ------
    InputError
        If a density is not stated.
    """
    facts = run.facts
    if not facts.gyro_noise or not facts.accel_noise:
        raise InputError(run.source, "gyro and accelerometer noise", "missing; densities, > 0")
    m, _ = radii_m(facts.site.lat_rad)
    return NavNoise(
        gyro=facts.gyro_noise,
        accel=facts.accel_noise,
        velocity_m_s=max(resolution(run.velocity[:, :2]) / np.sqrt(12.0), VELOCITY_FLOOR_M_S),
        position_m=max(resolution(run.lat_rad) * m / np.sqrt(12.0), POSITION_FLOOR_M),
    )


def resolution(values: FloatArray) -> float:
    """Return the step in which values are recorded: the smallest difference between two."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if steps.size else 0.0


def calibrate_navigation(
    run: NavRun,
    *,
    sensors: SensorModel | None = None,
    prior: RigPrior | None = None,
    noise: NavNoise | None = None,
    gate: float = NO_GATE,
) -> NavCalibration:
    """Calibrate a SINS from its navigation outputs.

    Parameters
    ----------
    run : NavRun
        With a row at the start of each cycle and at each output.
    sensors : SensorModel, optional
        What to estimate; by default biases, scale errors and misalignments.
    prior : RigPrior, optional
    noise : NavNoise, optional
    gate : float
        Innovations beyond so many sigmas are refused.

    Returns
    -------
    NavCalibration

    Raises
    ------
    InputError
        If the run has too few outputs or does not state its noise.
    """
    if len(run) < 10:
        raise InputError(run.source, "", f"{len(run)} outputs; expected at least 10")
    for k, rows in enumerate(run.cycles):
        if rows.stop - rows.start < 2:
            raise InputError(run.source, f"cycle {k + 1}", "one output; expected at least 2")
    sensors = sensors or sensor_model(gravity_m_s2=run.facts.site.gravity_m_s2)
    own = NavFilter(
        cycles=[nav_cycle(run, rows) for rows in run.cycles],
        sensors=sensors,
        prior=prior or make_prior(sensors),
        noise=noise or nav_noise_of(run),
        site=run.facts.site,
        free=free_height(run),
    )
    ended = iterated(own.first_nominal(), own.layout, own.steps, own.start, gate, STEP_SIGMAS)
    return _result(own, ended, run)


def _result(own: NavFilter, ended: Pass, run: NavRun) -> NavCalibration:
    unknowns, state = own.layout.unknowns, ended.filtered.state
    cycles = [(k, c.time_s) for k, c in enumerate(own.cycles)]
    return NavCalibration(
        sensors=own.sensors,
        names=own.sensors.names,
        values=ended.nominal.values + state.x[unknowns],
        cov=state.cov[unknowns, unknowns],
        layout=own.layout,
        nominal=ended.nominal,
        start=ended.start,
        steps=ended.steps,
        filtered=ended.filtered,
        cycle_of_step=np.concatenate([[-1] + [k] * t.size for k, t in cycles]),
        time_s=np.concatenate([np.append(t[0], t) for _, t in cycles]),
        prior=own.prior,
        noise=own.noise,
        iterations=ended.iterations,
        converged=ended.converged,
        warnings=run.warnings,
    )
