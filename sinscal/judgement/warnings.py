"""The warnings of a calibration's judgement, each begun by its name."""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.calibration.consistency import Consistency
from sinscal.calibration.effect_tests import EffectTests
from sinscal.calibration.navigation import NavCalibration
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import RigNoise
from sinscal.library import rig_library
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel

NOISE_FACTOR = 1.5  # by which the sigma of the innovations may be off before it is said by name
PRIOR_SIGMAS = 6.0

Calibration = RigCalibration | NavCalibration


def warnings_of(found: Calibration, consistency: Consistency) -> list[str]:
    """Return what a calibration's tests warn of."""
    out: list[str] = []
    sigma = float(np.sqrt(consistency.nis.mean))
    if consistency.noise_known and not 1 / NOISE_FACTOR < sigma < NOISE_FACTOR:
        out.append(
            f"noise_contradiction: the innovations are {sigma:.2g} times as large as the stated "
            f"noise; all sigmas are wrong by about this factor, or the model lacks an effect"
        )
    if not (consistency.white and consistency.steady):
        out.append(
            "coloured_innovations: the innovations are not white: the sensors drift slowly or "
            "the model lacks an effect, and the sigmas are too small; " + _advice(found)
        )
    if not consistency.repeats:
        worst = min(consistency.held_out, key=lambda held: held.shift.p_value)
        out.append(
            f"cycle_contradiction: cycle {worst.cycle + 1} does not agree with the others; if no "
            f"other fault is found, the sensors drift: {_advice(found)}"
        )
    if not consistency.within_bound:
        out.append(
            "axis_moves: the rig's axis moves across itself more than assumed; see --axis-wobble"
        )
    if not consistency.expected:
        out.append(
            f"prior_contradiction: the errors are larger than their priors, χ² "
            f"{consistency.prior.chi2:.0f} with {consistency.prior.dof} degrees of freedom; if "
            f"this is not a fault, give wider priors with --priors"
        )
    out += prior_contradictions(found.names, found.values, found.sensors, found.prior)
    if consistency.effects is not None:
        out += _missing(consistency.effects)
    if not consistency.converged:
        out.append("not_converged: the estimates still change; do not use the values")
    return out


def _missing(effects: EffectTests) -> list[str]:
    """Tell the effects that the innovations show, the most probable first."""
    if effects.passed:
        return []
    first, *others = effects.missing
    effect = rig_library().by_name[first.name]
    what = effect.sentence.rstrip(".")
    groups = f"--groups {effect.name} estimates it; " if effect.groups else ""
    more = f"; so would, less well, {', '.join(t.name for t in others)}" if others else ""
    return [
        f"effect_missing: {effect.name} would explain the innovations (χ² "
        f"{first.chi2:.0f} with {first.dof} degrees of freedom, p {first.p_value:.1g}): "
        f"{what}{more}; {groups}`accelbench discrepancy rig` identifies the effect"
    ]


def _advice(found: Calibration) -> str:
    if isinstance(found.noise, RigNoise):
        if found.noise.drifts:
            return "the estimated drift does not explain it"
        return "--gyro-instability and --accel-instability model drift"
    return "the outputs do not agree with the stated noise"


def prior_contradictions(
    names: Sequence[str], values: FloatArray, sensors: SensorModel, prior: RigPrior
) -> list[str]:
    """Return a warning for each estimate beyond six of its prior's sigmas."""
    sigma = np.sqrt(np.diag(prior.cov))
    out: list[str] = []
    for name, value in zip(names, values, strict=True):
        if name not in sensors.names:
            continue
        k = sensors.names.index(name)
        if sigma[k] > 0 and abs(value - prior.values[k]) > PRIOR_SIGMAS * sigma[k]:
            out.append(
                f"prior_contradiction: {name} is {value:.3g}, "
                f"{abs(value - prior.values[k]) / sigma[k]:.0f} sigmas of the prior from its mean"
            )
    return out
