"""Covariance analysis: how well a programme will calibrate a SINS, before any test.

The same filter runs on the programme's true motion. Its covariance does not depend on what is
measured, so that no noise need be drawn.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.filtering import Filtered, Steps, covariance_share, run_filter
from errormodel.kalman import State
from sinscal.attitude import rotation
from sinscal.integrate import interval_rows
from sinscal.layout import RigLayout
from sinscal.motion import RigMotion, rig_motion
from sinscal.priors import RigPrior
from sinscal.programme import Programme
from sinscal.rigfilter import CycleData, Nominal, RigNoise, make_steps
from sinscal.rigpass import RigFilter
from sinscal.run import AXES, RigFacts
from sinscal.sensors import SensorModel

RATE_HZ = 20.0  # a step turns by half a degree at 10 °/s: the columns' sums are good to 1e-5
INTERVAL_S = 1.0
HISTORY_S = 10.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigCovariance:
    """What a calibration by a programme will be worth.

    Attributes
    ----------
    names, cov
        Of the constants: the sensors' unknowns, then the rig's mounting; SI.
    time_s : ndarray, shape (t,)
        Of `history`, without the pauses between cycles.
    history : ndarray, shape (t, p)
        Sigmas over time.
    prior_sigmas : ndarray, shape (p,)
    layout, steps, start, filtered
        The filter's.
    """

    names: tuple[str, ...]
    cov: FloatArray
    time_s: FloatArray
    history: FloatArray
    prior_sigmas: FloatArray
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


def rig_covariance(
    programme: Programme,
    sensors: SensorModel,
    prior: RigPrior,
    noise: RigNoise,
    *,
    angle: bool,
    azimuth_sigma_rad: float | None = None,
    carry: bool = False,
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
    """
    true = rig_motion(programme, RATE_HZ)
    cycles = tuple(_cycle(true, k) for k in range(len(true.cycles)))
    facts = RigFacts(
        site=true.site,
        azimuth_rad=None if azimuth_sigma_rad is None else true.azimuth_rad,
        azimuth_sigma_rad=azimuth_sigma_rad or 0.0,
    )
    rig = RigFilter(facts=facts, cycles=cycles, sensors=sensors, prior=prior, noise=noise)
    layout = rig.layout(angle=angle)
    nominal = _true_nominal(true, sensors)
    steps = make_steps(cycles, sensors, nominal, layout, noise, true.site.gravity_m_s2)
    if carry:
        steps = _carried(steps, layout, [c.first.size - 1 for c in cycles])
    start = rig.start(nominal, nominal, layout)
    every = max(1, round(HISTORY_S / INTERVAL_S))
    filtered = run_filter(start, steps, every=every, with_gains=True)
    order = layout.reported
    return RigCovariance(
        names=tuple(layout.names[i] for i in order),
        cov=filtered.state.cov[np.ix_(order, order)],
        time_s=INTERVAL_S * every * np.arange(1, len(filtered.sigmas) + 1),
        history=filtered.sigmas[:, order],
        prior_sigmas=start.sigmas[order],
        layout=layout,
        steps=steps,
        start=start,
        filtered=filtered,
    )


def _cycle(true: RigMotion, k: int) -> CycleData:
    cycle = true.cycles[k]
    motion = cycle.motion
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


def error_budget(found: RigCovariance) -> Mapping[str, FloatArray]:
    """Split the final variances among the sources: each noise, each group of priors.

    Returns
    -------
    mapping of str to ndarray, shape (p,)
        Variances in the order of `names`; they add up to the whole.
    """
    layout, steps, start = found.layout, found.steps, found.start
    order = [layout.names.index(n) for n in found.names]
    zero_r, zero_q = np.zeros_like(steps.r), np.zeros_like(steps.q)
    nothing = np.zeros((layout.size, layout.size))
    gains = found.filtered.gains
    out: dict[str, FloatArray] = {}

    def put(name: str, cov: FloatArray, r: FloatArray, q: FloatArray) -> None:
        share = covariance_share(steps, gains, cov, r, q)
        out[name] = np.diag(share)[order]

    r = zero_r.copy()
    r[:, :3] = steps.r[:, :3]
    put("accelerometer noise", nothing, r, zero_q)
    if layout.angle:
        r = zero_r.copy()
        r[:, 3:] = steps.r[:, 3:]
        put("rig angle noise", nothing, r, zero_q)
    q = zero_q.copy()
    q[:, :3] = steps.q[:, :3]
    put("gyro noise", nothing, zero_r, q)
    if layout.drift:
        q = zero_q.copy()
        q[:, 3:] = steps.q[:, 3:]
        put("slow drift", nothing, zero_r, q)
    put("what was known beforehand", start.cov, zero_r, zero_q)
    return out
