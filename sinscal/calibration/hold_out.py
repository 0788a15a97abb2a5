"""A cycle held out: whether the others predict it, and whether it agrees with them."""

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.stats import chi2

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.filter.steps import NO_GATE, run_filter
from sinscal.calibration.found import FilterCalibration
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import RigNoise, cycle_data
from sinscal.filter.iterate import ROUGHLY_SIGMAS, RigFilter
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import RigRun

# Directions in which the cycle brings less than this share of the variance are left out: there the
# shift is as small as what the iteration leaves.
LEAST_SHARE = 0.02
LAST: Final = "last"
EACH: Final = "each"
NONE: Final = "none"
# Which cycles to hold out: the last, each in turn, none, or one by its number from 1.
Held = Literal["last", "each", "none"] | int
SETTLE_S = 20.0  # at a cycle's beginning, in which its own attitude is found


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """Change of estimates by more data: χ², degrees of freedom and probability by chance."""

    chi2: float
    dof: int

    @property
    def p_value(self) -> float:
        """Probability of a larger one."""
        return float(chi2.sf(self.chi2, self.dof)) if self.dof else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldOut:
    """Agreement of a cycle with the calibration by the others.

    Attributes
    ----------
    cycle : int
        Which was held out, from 0.
    shift : Shift
        Of the estimates when it is taken in.
    before_m_s2, after_m_s2 : float
        Rms of the force that the cycle's readings leave over gravity, with the prior's values and
        with those of the other cycles; its attitude is its own. None where forces are not read.
    """

    cycle: int
    shift: Shift
    before_m_s2: float | None = None
    after_m_s2: float | None = None


def cycles_held(held: Held, cycles: int, source: str) -> tuple[int, ...]:
    """Return the cycles to hold out, from 0; none where there is but one.

    Raises
    ------
    InputError
        If the run has no such cycle, or no other.
    """
    if isinstance(held, int):
        if not 1 <= held <= cycles:
            raise InputError(source, f"holdout {held}", f"no such cycle; expected 1 to {cycles}")
        if cycles == 1:
            raise InputError(source, f"holdout {held}", "expected a cycle beside it")
        return (held - 1,)
    if held == NONE or cycles == 1:
        return ()
    return tuple(range(cycles)) if held == EACH else (cycles - 1,)


def shift_test(
    values: FloatArray, cov: FloatArray, without: FloatArray, cov_without: FloatArray
) -> Shift:
    """Return the shift that more data brought; its covariance is the difference of the two.

    Parameters
    ----------
    values, cov : ndarray, shape (p,), (p, p)
        By all data.
    without, cov_without
        By part of them.
    """
    sigma = np.sqrt(np.diag(cov_without))
    free = sigma > 0.0
    scale = np.outer(sigma[free], sigma[free])
    before = cov_without[np.ix_(free, free)] / scale
    after = cov[np.ix_(free, free)] / scale
    shift = (without - values)[free] / sigma[free]
    d, v = np.linalg.eigh(before)
    kept = d > 1e-10 * d[-1]
    white = v[:, kept] / np.sqrt(d[kept])
    share, axes = np.linalg.eigh(np.eye(int(kept.sum())) - white.T @ after @ white)
    told = share > LEAST_SHARE
    moved = axes[:, told].T @ (white.T @ shift)
    return Shift(chi2=float(np.sum(moved**2 / share[told])), dof=int(told.sum()))


def without_cycle(found: FilterCalibration, cycle: int) -> tuple[FloatArray, FloatArray]:
    """Return values and covariance by the other cycles, about the nominal of all of them.

    Were the others' own nominal taken, what they do not show would differ by its prior's sigma, and
    with it the direction of what they show best: a thousandth times a thousandth is as much as the
    sigma of that.

    Parameters
    ----------
    found : FilterCalibration
        By all cycles. What its gate refused stays refused.
    cycle : int
        From 0.

    Returns
    -------
    values : ndarray, shape (p,)
    cov : ndarray, shape (p, p)
        In the order of `found.names`.
    """
    left_out = (found.cycle_of_step == cycle)[:, None] | ~found.filtered.used
    steps = replace(found.steps, z=np.where(left_out, np.nan, found.steps.z))
    state = run_filter(found.start, steps).state
    order, layout = found.layout.reported, found.layout
    values = found.nominal.improved(state.x, layout)
    return (
        np.append(values.values, values.mount) if layout.angle else values.values,
        state.cov[np.ix_(order, order)],
    )


def hold_out(run: RigRun, found: RigCalibration, cycle: int, interval_s: float) -> HoldOut:
    """Judge a cycle by the others.

    Parameters
    ----------
    run : RigRun
        Two cycles or more.
    found : RigCalibration
        Of all of them.
    cycle : int
        From 0.
    interval_s : float
        Time between two measurements of the filter.
    """
    values, cov = without_cycle(found, cycle)
    alone, p = run.take_cycles([cycle]), len(found.sensors.names)
    before, after = (
        force_residual(alone, found.sensors, v[:p], found.noise, interval_s)
        for v in (found.prior.values, values)
    )
    return HoldOut(
        cycle=cycle,
        shift=shift_test(found.values, found.cov, values, cov),
        before_m_s2=before,
        after_m_s2=after,
    )


def force_residual(
    cycle: RigRun, sensors: SensorModel, values: FloatArray, noise: RigNoise, interval_s: float
) -> float:
    """Return the rms force that a cycle's corrected readings leave over gravity, m/s².

    Only the cycle's attitude is estimated. Innovations after the first 20 s count; as the filter
    itself forecasts them, they hold no more than noise and what the sensors are wrong by.
    """
    p = values.size
    prior = RigPrior(values=values, cov=np.zeros((p, p)))
    facts = replace(cycle.facts, azimuth_rad=None)
    rig = RigFilter(
        facts=facts,
        cycles=cycle_data(cycle, interval_s),
        sensors=sensors,
        prior=prior,
        noise=replace(noise, gyro_instability=0.0, accel_instability=0.0),
    )
    nominal, _ = rig.find_north(interval_s)
    ended = rig.iterate(nominal, rig.layout(), NO_GATE, ROUGHLY_SIGMAS)
    settled = ended.filtered.innovation[round(SETTLE_S / interval_s) :, :3]
    return float(np.sqrt(np.nanmean(settled**2)))
