"""Calibration of a SINS from its raw sensors on a rig, without and with the rig's angle."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.calibration.found import FilterCalibration
from sinscal.filter.data import RigNoise, cycle_data
from sinscal.filter.iterate import STEP_SIGMAS, Pass, RigFilter
from sinscal.filter.layout import RigLayout
from sinscal.filter.north import KnownNorth, judge_north
from sinscal.library import BASIC
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.priors import RigPrior, make_prior
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import RigFacts, RigRun

Mode = Literal["coarse", "precise"]
INTERVAL_S = 1.0
# Refused beyond so many sigmas: of 10⁴ good scalar innovations one in 10⁵ runs loses one.
GATE_SIGMAS = 7.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigCalibration(FilterCalibration):
    """Calibration from raw sensors.

    Attributes
    ----------
    mode : str
    noise : RigNoise
    north_sigma_rad : ndarray, shape (cycles,)
        How well gyrocompassing alone found north.
    north_azimuth_rad : ndarray, shape (cycles,)
        Azimuth of the rotation axis by gyrocompassing alone.
    """

    mode: str
    noise: RigNoise
    north_sigma_rad: FloatArray
    north_azimuth_rad: FloatArray


def calibrate(
    run: RigRun,
    mode: Mode = "coarse",
    *,
    sensors: SensorModel | None = None,
    prior: RigPrior | None = None,
    noise: RigNoise | None = None,
    interval_s: float = INTERVAL_S,
    gate: float = GATE_SIGMAS,
) -> RigCalibration:
    """Calibrate a SINS.

    Parameters
    ----------
    run : RigRun
    mode : {"coarse", "precise"}
        Without the rig's angle, or with it.
    sensors : SensorModel, optional
        What to estimate; by default biases, scale errors and misalignments, and with the rig's
        angle the offset of its clock.
    prior : RigPrior, optional
    noise : RigNoise, optional
        By default the densities in the run's facts.
    interval_s : float
        Between two measurements of the filter; the data are summed at their full rate.
    gate : float
        Innovations beyond so many sigmas are refused and logged.

    Returns
    -------
    RigCalibration

    Raises
    ------
    InputError
        If the run lacks what the mode needs.
    """
    _check(run, mode)
    own = (*BASIC, TIME_OFFSET) if mode == "precise" else BASIC
    sensors = sensors or sensor_model(own, gravity_m_s2=run.facts.site.gravity_m_s2)
    prior = prior or make_prior(sensors)
    noise = noise or noise_of(run.facts, mode)
    cycles = cycle_data(run, interval_s)
    rig = RigFilter(facts=run.facts, cycles=cycles, sensors=sensors, prior=prior, noise=noise)
    nominal, sigma = rig.find_north(interval_s, gate)
    north = judge_north(run.facts, cycles, nominal, sigma, run.source)
    rig, nominal = replace(rig, facts=north.facts), north.nominal
    if mode == "precise":
        nominal = rig.with_platform(nominal)
    layout = rig.layout(angle=mode == "precise")
    nominal = rig.thinned(interval_s).improved(nominal, layout, gate)
    ended = rig.iterate(nominal, layout, gate, STEP_SIGMAS)
    return _result(rig, mode, ended, layout, north, run)


def _check(run: RigRun, mode: Mode) -> None:
    if mode == "precise" and run.rig_angle_rad is None:
        raise InputError(run.source, "rig_angle_rad", "missing; precise mode needs the rig's angle")
    if mode == "precise" and run.facts.axis_of_cycle is None:
        raise InputError(
            run.source, "axis_of_cycle", "missing; precise mode needs each cycle's rotation axis"
        )


def noise_of(facts: RigFacts, mode: Mode) -> RigNoise:
    """Return the noise that a run's facts state.

    Raises
    ------
    InputError
        If a density is not stated.
    """
    needed = {"gyro_noise": facts.gyro_noise, "accel_noise": facts.accel_noise}
    if mode == "precise":
        needed["angle_noise"] = facts.angle_noise
    for name, value in needed.items():
        if not value:
            raise InputError("the run's facts", name, "missing; a density of white noise, > 0")
    return RigNoise(
        gyro=facts.gyro_noise or 0.0,
        accel=facts.accel_noise or 0.0,
        angle=facts.angle_noise or 0.0,
        gyro_quantum=facts.quantum.gyro_rad,
        accel_quantum=facts.quantum.accel_m_s,
    )


def _result(
    rig: RigFilter, mode: str, ended: Pass, layout: RigLayout, north: KnownNorth, run: RigRun
) -> RigCalibration:
    x, cov = ended.filtered.state.x, ended.filtered.state.cov
    last = ended.nominal.improved(x, layout)
    order = layout.reported
    values = np.append(last.values, last.mount) if layout.angle else last.values
    lengths = [c.first.size - 1 for c in rig.cycles]
    cycle_of_step = np.concatenate([[-1] + [k] * m for k, m in enumerate(lengths)])
    times = [np.concatenate([[0.0], c.measured.time_s[c.first[1:] - 1]]) for c in rig.cycles]
    return RigCalibration(
        mode=mode,
        sensors=rig.sensors,
        names=tuple(layout.names[i] for i in order),
        values=values,
        cov=cov[np.ix_(order, order)],
        layout=layout,
        nominal=ended.nominal,
        start=ended.start,
        steps=ended.steps,
        filtered=ended.filtered,
        cycle_of_step=cycle_of_step,
        time_s=np.concatenate(times),
        prior=rig.prior,
        noise=rig.noise,
        iterations=ended.iterations,
        converged=ended.converged,
        north_sigma_rad=north.sigma_rad,
        north_azimuth_rad=north.azimuth_rad,
        warnings=(*run.warnings, *north.warnings),
    )
