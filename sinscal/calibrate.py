"""Calibration of a SINS from its raw sensors on a rig, without and with the rig's angle."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.filtering import Filtered, Steps, run_filter
from errormodel.kalman import State, initial_state
from sinscal.alignment import azimuth_of, find_north, level_nominal, mean_axis
from sinscal.attitude import rotation, rotvec_of
from sinscal.layout import RigLayout
from sinscal.priors import RigPrior, make_prior
from sinscal.rigfilter import CycleData, Nominal, RigNoise, cycle_data, make_steps
from sinscal.run import RigFacts, RigRun
from sinscal.sensors import SensorModel, sensor_model

Mode = Literal["coarse", "precise"]
INTERVAL_S = 1.0
MAX_ITERATIONS = 15
# Iteration ends when no unknown moves by more than this share of its sigma.
STEP_SIGMAS = 0.02
# Refused beyond so many sigmas: of 10⁴ good scalar innovations one in 10⁵ runs loses one.
GATE_SIGMAS = 7.0
# North that is found no better than this is no north: the gyros do not feel the earth.
NORTH_SIGMA_RAD = 0.3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigCalibration:
    """What a calibration found.

    Attributes
    ----------
    mode : str
    sensors : SensorModel
    names, values, cov
        Of all constants: the sensors' unknowns first, then the rig's; SI.
    layout : RigLayout
    nominal : Nominal
        Where the filter ended.
    start : State
        What the last pass started from.
    steps : Steps
        Of the last pass.
    filtered : Filtered
        What it made of them.
    cycle_of_step : ndarray of int, shape (K,)
        −1 for the steps that begin a cycle.
    time_s : ndarray, shape (K,)
        End of each step from the start of its cycle.
    prior : RigPrior
    noise : RigNoise
    iterations : int
    converged : bool
    north_sigma_rad : ndarray, shape (cycles,)
        How well gyrocompassing alone found north.
    warnings : tuple of str
    """

    mode: str
    sensors: SensorModel
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    layout: RigLayout
    nominal: Nominal
    start: State
    steps: Steps
    filtered: Filtered
    cycle_of_step: FloatArray
    time_s: FloatArray
    prior: RigPrior
    noise: RigNoise
    iterations: int
    converged: bool
    north_sigma_rad: FloatArray
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, in the order of `names`."""
        return np.sqrt(np.diag(self.cov))

    def value(self, name: str) -> float:
        """Return one estimate."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return one standard deviation."""
        return float(self.sigmas[self.names.index(name)])


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
        What to estimate; by default biases, scale errors and misalignments.
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
    wanted = ("rig_time_offset",) if mode == "precise" else ()
    sensors = sensors or sensor_model(gravity_m_s2=run.facts.site.gravity_m_s2)
    if wanted and not sensors.channels[6].model.names:
        sensors = sensors.with_angle_groups(wanted)
    prior = prior or make_prior(sensors)
    noise = noise or noise_of(run.facts, mode)
    cycles = cycle_data(run, interval_s)
    work = _Work(run=run, cycles=cycles, sensors=sensors, prior=prior, noise=noise)
    levelled, north = work.find_north()
    if mode == "precise":
        nominal, layout = work.with_platform(levelled), work.layout(angle=True)
    else:
        nominal, layout = levelled, work.layout()
    return work.finish(mode, nominal, layout, north, gate)


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
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Work:
    run: RigRun
    cycles: Sequence[CycleData]
    sensors: SensorModel
    prior: RigPrior
    noise: RigNoise

    def layout(self, *, wander: bool = False, angle: bool = False) -> RigLayout:
        """Return the states of a pass."""
        return RigLayout(
            cycles=len(self.cycles),
            parameters=self.sensors.names,
            drift=self.noise.drifts,
            wander=wander,
            angle=angle,
            remount=angle and self.prior.remount_sigma_rad > 0.0,
        )

    def find_north(self) -> tuple[Nominal, FloatArray]:
        """Level, then gyrocompass: iterate in axes of any azimuth, and turn them to north."""
        site = self.run.facts.site
        layout = self.layout(wander=True)
        nominal = level_nominal(self.cycles, self.sensors, self.prior.values, site)
        nominal, filtered, _, _, _, _ = self.iterate(nominal, layout, np.inf, 0.3)
        north = find_north(nominal, filtered.state.cov, layout, site)
        return north.nominal, north.sigma_rad

    def with_platform(self, nominal: Nominal) -> Nominal:
        """Return the nominal with the platform's attitude at angle zero, from the first minute."""
        bases: list[FloatArray] = []
        for k, cycle in enumerate(self.cycles):
            assert cycle.angle is not None
            assert cycle.axis is not None
            unit = np.eye(3)[cycle.axis]
            back = rotation(-float(cycle.angle[0]) * unit)
            first = rotation(self.sensors.corrected(cycle.measured, nominal.values).w[0]
                             * cycle.measured.step_s[0])  # fmt: skip
            bases.append(nominal.c_start[k] @ first @ back)
        return replace(
            nominal,
            base=tuple(bases),
            remount=tuple(np.zeros(3) for _ in self.cycles),
        )

    def iterate(
        self, nominal: Nominal, layout: RigLayout, gate: float, enough: float
    ) -> tuple[Nominal, Filtered, Steps, State, int, bool]:
        """Filter, improve the nominal, and again, until nothing moves by `enough` sigmas."""
        anchor = nominal
        count, converged = 0, False
        while True:
            steps = make_steps(
                self.cycles, self.sensors, nominal, layout, self.noise,
                self.run.facts.site.gravity_m_s2,
            )  # fmt: skip
            start = self.start(nominal, anchor, layout)
            filtered = run_filter(start, steps, gate=gate if converged else np.inf)
            if converged or count >= MAX_ITERATIONS:
                return nominal, filtered, steps, start, count, converged
            count += 1
            x, sigma = filtered.state.x, filtered.state.sigmas
            moved = np.abs(x[layout.moving :]) / np.maximum(sigma[layout.moving :], 1e-300)
            moved[sigma[layout.moving :] == 0.0] = 0.0
            nominal = nominal.improved(x, layout)
            converged = bool(np.max(moved) < enough)

    def start(self, nominal: Nominal, anchor: Nominal, layout: RigLayout) -> State:
        """Return the state before all data: what is known beforehand, about the nominal."""
        prior, n = self.prior, layout.size
        x, cov = np.zeros(n), np.zeros((n, n))
        unknown = layout.unknowns
        x[unknown] = prior.values - nominal.values
        cov[unknown, unknown] = prior.cov
        if layout.drift:
            pairs = ((3, self.noise.gyro_instability), (6, self.noise.accel_instability))
            for first, sigma in pairs:
                cov[first : first + 3, first : first + 3] = np.eye(3) * sigma**2
        for k in range(layout.cycles):
            self._start_cycle(x, cov, nominal, anchor, layout, k)
        if not layout.wander:
            self._azimuth_prior(x, cov, nominal, layout)
        if layout.angle:
            place = layout.mount
            x[place] = -nominal.mount
            cov[place, place] = np.eye(3) * prior.mount_sigma_rad**2
        return initial_state(x, cov)

    def _start_cycle(
        self,
        x: FloatArray,
        cov: FloatArray,
        nominal: Nominal,
        anchor: Nominal,
        layout: RigLayout,
        k: int,
    ) -> None:
        prior = self.prior
        place = layout.start(k)
        sigmas = np.full(3, prior.start_sigma_rad)
        if layout.wander:
            sigmas[2] = 0.0  # the azimuth of the axes is what it is
            rate = layout.earth_rate(k)
            x[rate] = -nominal.earth[k][:2]
            cov[rate, rate] = np.eye(2) * self.run.facts.site.earth_rate[1] ** 2
        cov[place, place] = np.diag(sigmas**2)
        if layout.angle:
            base = layout.base(k)
            x[base] = rotvec_of(anchor.base[k] @ nominal.base[k].T)
            cov[base, base] = np.eye(3) * prior.base_sigma_rad**2
        if layout.angle and layout.remount:
            more = layout.remounted(k)
            x[more] = -nominal.remount[k]
            cov[more, more] = np.eye(3) * prior.remount_sigma_rad**2

    def _azimuth_prior(
        self, x: FloatArray, cov: FloatArray, nominal: Nominal, layout: RigLayout
    ) -> None:
        """Put in the azimuth of the rotation axis when it is given: one error for all cycles."""
        facts = self.run.facts
        if facts.azimuth_rad is None:
            return
        up = [layout.start(k).start + 2 for k in range(layout.cycles)]
        for k, cycle in enumerate(self.cycles):
            found = azimuth_of(nominal.c_start[k] @ mean_axis(cycle))
            apart = facts.azimuth_rad - found
            x[up[k]] = -((apart + np.pi) % (2.0 * np.pi) - np.pi)
        cov[np.ix_(up, up)] = facts.azimuth_sigma_rad**2 * np.ones((len(up), len(up)))

    def finish(
        self, mode: str, nominal: Nominal, layout: RigLayout, north: FloatArray, gate: float
    ) -> RigCalibration:
        """Iterate to convergence and put the result together."""
        ended, filtered, steps, start, count, converged = self.iterate(
            nominal, layout, gate, STEP_SIGMAS
        )
        x, cov = filtered.state.x, filtered.state.cov
        last = ended.improved(x, layout)
        unknown = layout.unknowns
        order = np.arange(unknown.start, unknown.stop)
        values, names = last.values, self.sensors.names
        if layout.angle:
            mount = np.arange(layout.mount.start, layout.mount.stop)
            order = np.concatenate([order, mount])
            values = np.concatenate([values, last.mount])
            names = (*names, *(layout.names[i] for i in mount))
        lengths = [c.first.size - 1 for c in self.cycles]
        cycle_of_step = np.concatenate([[-1] + [k] * m for k, m in enumerate(lengths)])
        times = [
            np.concatenate([[0.0], c.measured.time_s[c.first[1:] - 1]]) for c in self.cycles
        ]
        return RigCalibration(
            mode=mode,
            sensors=self.sensors,
            names=names,
            values=values,
            cov=cov[np.ix_(order, order)],
            layout=layout,
            nominal=ended,
            start=start,
            steps=steps,
            filtered=filtered,
            cycle_of_step=cycle_of_step,
            time_s=np.concatenate(times),
            prior=self.prior,
            noise=self.noise,
            iterations=count,
            converged=converged,
            north_sigma_rad=north,
            warnings=self.run.warnings,
        )
