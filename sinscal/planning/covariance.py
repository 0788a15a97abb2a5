"""Covariance analysis: how well a programme will calibrate a SINS, before any test.

The same filter runs on the programme's true motion. Its covariance does not depend on what is
measured, so that no noise need be drawn.
"""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.filter.kalman import State, initial_state
from errormodel.filter.steps import Filtered, Steps, run_filter
from sinscal.filter.data import CycleData, Nominal, RigNoise
from sinscal.filter.integrate import interval_rows
from sinscal.filter.iterate import RigFilter
from sinscal.filter.layout import RigLayout
from sinscal.filter.steps import make_steps
from sinscal.frames.attitude import rotation
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import AXES, RigFacts
from sinscal.twin.motion import RigMotion, rig_motion
from sinscal.twin.programme import Programme
from sinscal.twin.simulate import Warming

STEP_DEG = 0.5  # what a step turns by at most: sigmas are good to 3e-4
MIN_RATE_HZ, MAX_RATE_HZ = 20.0, 1000.0
INTERVAL_S = 1.0
HISTORY_S = 10.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigCovariance:
    """Covariance to expect of a calibration by a programme.

    Attributes
    ----------
    names, cov
        Of the constants: the sensors' unknowns, then the rig's mounting; SI.
    time_s : ndarray, shape (t,)
        Of `history`, without the pauses between cycles.
    history : ndarray, shape (t, p)
        Sigmas over time.
    cycle_s : ndarray, shape (cycles,)
        Duration of each cycle.
    prior_sigmas : ndarray, shape (p,)
    units : dict of str to str
        Of the sensors' unknowns by name.
    layout, steps, start, filtered
        The filter's.
    """

    names: tuple[str, ...]
    cov: FloatArray
    time_s: FloatArray
    history: FloatArray
    cycle_s: FloatArray
    prior_sigmas: FloatArray
    units: dict[str, str]
    layout: RigLayout
    steps: Steps
    start: State
    filtered: Filtered

    def __post_init__(self) -> None:
        freeze(self, cov=readonly(self.cov), history=readonly(self.history))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations after the programme, in the order of `names`."""
        return np.sqrt(np.diag(self.cov))

    def sigma(self, name: str) -> float:
        """Return one standard deviation."""
        return float(self.sigmas[self.names.index(name)])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinearisedFilter:
    """The filter of a programme, ready to run.

    Attributes
    ----------
    rig : RigFilter
    layout : RigLayout
    nominal : Nominal
        The truth.
    steps : Steps
    """

    rig: RigFilter
    layout: RigLayout
    nominal: Nominal
    steps: Steps


def rig_covariance(
    programme: Programme,
    sensors: SensorModel,
    prior: RigPrior,
    noise: RigNoise,
    *,
    angle: bool,
    azimuth_sigma_rad: float | None = None,
    carry: bool = False,
    warming: Warming | None = None,
) -> RigCovariance:
    """Compute the covariance that a calibration by a programme will have.

    Parameters
    ----------
    programme : Programme
    sensors : SensorModel
        What is estimated.
    prior : RigPrior
    noise : RigNoise
    angle : bool
        Whether the rig's angle is used (precise), or not (coarse).
    azimuth_sigma_rad : float, optional
        How well the azimuth of the rotation axis is known, one error for all cycles.
    carry : bool
        Whether the gyros carry the attitude from one cycle to the next; else it starts anew.
    warming : callable, optional
        Temperatures (n, 3) over time, °C; sensors with terms of temperature need them.
    """
    made = linearise(programme, sensors, prior, noise, angle=angle, warming=warming)
    return solve(made, azimuth_sigma_rad=azimuth_sigma_rad, carry=carry)


def linearise(
    programme: Programme,
    sensors: SensorModel,
    prior: RigPrior,
    noise: RigNoise,
    *,
    angle: bool,
    warming: Warming | None = None,
) -> LinearisedFilter:
    """Linearise a programme's calibration about its truth; parameters as of `rig_covariance`."""
    true = rig_motion(programme, _rate_hz(programme))
    cycles = tuple(_cycle(true, k, warming) for k in range(len(true.cycles)))
    facts = RigFacts(site=true.site, azimuth_rad=true.azimuth_rad)
    rig = RigFilter(facts=facts, cycles=cycles, sensors=sensors, prior=prior, noise=noise)
    layout = rig.layout(angle=angle)
    nominal = _true_nominal(true, sensors)
    steps = make_steps(cycles, sensors, nominal, layout, noise, true.site.gravity_m_s2)
    return LinearisedFilter(rig=rig, layout=layout, nominal=nominal, steps=steps)


def solve(
    made: LinearisedFilter,
    *,
    azimuth_sigma_rad: float | None = None,
    carry: bool = False,
    one_base: bool = False,
) -> RigCovariance:
    """Run the filter of a programme.

    Parameters
    ----------
    made : LinearisedFilter
    azimuth_sigma_rad, carry
        As of `rig_covariance`.
    one_base : bool
        Whether the error of the platform's attitude at angle zero is the same in all cycles.
    """
    layout, facts = made.layout, made.rig.facts
    facts = replace(
        facts,
        azimuth_rad=None if azimuth_sigma_rad is None else facts.azimuth_rad,
        azimuth_sigma_rad=azimuth_sigma_rad or 0.0,
    )
    start = replace(made.rig, facts=facts).start(made.nominal, made.nominal, layout)
    if layout.angle and one_base:
        start = _one_base(start, layout)
    lengths = [c.first.size - 1 for c in made.rig.cycles]
    steps = _carried(made.steps, layout, lengths) if carry else made.steps
    every = max(1, round(HISTORY_S / INTERVAL_S))
    filtered = run_filter(start, steps, every=every, with_gains=True)
    order = layout.reported
    return RigCovariance(
        names=tuple(layout.names[i] for i in order),
        cov=filtered.state.cov[np.ix_(order, order)],
        time_s=INTERVAL_S * every * np.arange(1, len(filtered.sigmas) + 1),
        history=filtered.sigmas[:, order],
        cycle_s=np.array([float(c.measured.time_s[-1]) for c in made.rig.cycles]),
        prior_sigmas=start.sigmas[order],
        units=made.rig.sensors.units,
        layout=layout,
        steps=steps,
        start=start,
        filtered=filtered,
    )


def _one_base(start: State, layout: RigLayout) -> State:
    cov, own = start.cov, layout.base(0)
    for i in range(layout.cycles):
        for j in range(layout.cycles):
            cov[layout.base(i), layout.base(j)] = start.cov[own, own]
    return initial_state(start.x, cov)


def _rate_hz(programme: Programme) -> float:
    """Return how many steps a second keep a step's turn below `STEP_DEG`."""
    fastest = max(abs(s.rate_deg_s) for c in programme.cycles for s in c.segments)
    return float(np.clip(np.ceil(fastest / STEP_DEG), MIN_RATE_HZ, MAX_RATE_HZ))


def _cycle(true: RigMotion, k: int, warming: Warming | None) -> CycleData:
    cycle = true.cycles[k]
    motion = cycle.motion
    if warming is not None:
        motion = replace(motion, temp_c=warming(motion.time_s + true.start_s[k]))
    return CycleData(
        measured=motion,
        good=np.ones(len(motion), dtype=np.bool_),
        first=interval_rows(motion.time_s, motion.step_s, INTERVAL_S),
        axis=AXES.index(true.axes[k]),
        angle=cycle.angle,
    )


def _true_nominal(true: RigMotion, sensors: SensorModel) -> Nominal:
    bases = [
        c.c_nb[0] @ rotation(-float(c.angle[0]) * np.eye(3)[AXES.index(axis)])
        for c, axis in zip(true.cycles, true.axes, strict=True)
    ]
    return Nominal(
        values=sensors.start_values(),
        c_start=tuple(c.c_start for c in true.cycles),
        earth=tuple(true.site.earth_rate for _ in true.cycles),
        base=tuple(bases),
        mount=np.zeros(3),
        remount=tuple(np.zeros(3) for _ in true.cycles),
    )


def _carried(steps: Steps, layout: RigLayout, lengths: list[int]) -> Steps:
    """Return the steps with the attitude going on from cycle to cycle."""
    phi = steps.phi.copy()
    at = 0
    for k, length in enumerate(lengths):
        if k > 0:
            phi[at, :3] = 0.0
            phi[at, :3, :3] = np.eye(3)
        at += length + 1
    return replace(steps, phi=phi)
