"""Protection levels: the largest error of a parameter that the tests may leave unseen.

An effect c that the model lacks makes the test's statistic χ² with non-centrality cᵀM c and moves
a parameter by b·c. The test finds it with probability 99 % when the non-centrality is λ; smaller
effects may stay unseen, and of those with cᵀM c ≤ λ the worst for the parameter moves it by
√(λ · b M⁻¹ bᵀ). Where the run hardly shows an effect, what is expected of it beforehand bounds it
instead: the worst of both is the minimum over w of √(b (w M/λ + (1 − w) C⁻¹)⁻¹ bᵀ), C of three
expected sigmas. One effect at a time is supposed to be missing: the level is that of the worst
effect, and three sigmas of the calibration's own covariance on top.

References
----------
Brown, R. G. (1992), A baseline GPS RAIM scheme and a note on the equivalence of three RAIM methods,
Navigation 39, for slope, threshold and protection level.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from errormodel.arrays import FloatArray
from sinscal.calibration.effect_tests import FALSE_ALARM
from sinscal.sensitivity.views import EffectView, by_effect

MISSED = 0.01  # probability that the tests are quiet at the non-centrality counted with
COVERED_SIGMAS = 3.0  # of the calibration's covariance, and of what is expected of an effect
WEIGHTS = np.concatenate([np.linspace(0.0, 0.9, 10), 1.0 - np.logspace(-1.5, -9.0, 16)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """The protection level of one parameter, SI.

    Attributes
    ----------
    total : float
    covariance : float
        The share of the calibration's own covariance.
    effects : mapping of str to float
        The largest unseen error by each effect.
    """

    total: float
    covariance: float
    effects: Mapping[str, float]

    @property
    def worst(self) -> str | None:
        """The effect that could cause the largest error."""
        return max(self.effects, key=lambda e: self.effects[e]) if self.effects else None


def protection_levels(
    names: Sequence[str], sigmas: FloatArray, views: Sequence[EffectView], variance: float
) -> dict[str, Level]:
    """Return the protection level of every parameter.

    Parameters
    ----------
    names, sigmas
        Of the calibration.
    views : sequence of EffectView
    variance : float
        Of the normalised innovations, 1 where the noise is as stated.
    """
    tested = by_effect(views)
    effects = dict.fromkeys(v.effect.name for v in views)
    worst: dict[str, FloatArray] = {}
    for effect in effects:
        shapes = [v for v in views if v.effect.name == effect]
        alarm = FALSE_ALARM / max(len(tested), 1) / max(len(tested.get(effect, ())), 1)
        worst[effect] = np.max([unseen_errors(v, alarm, variance) for v in shapes], axis=0)
    out: dict[str, Level] = {}
    for i, name in enumerate(names):
        by = {effect: float(errors[i]) for effect, errors in worst.items()}
        own = COVERED_SIGMAS * float(sigmas[i])
        out[name] = Level(total=own + max(by.values(), default=0.0), covariance=own, effects=by)
    return out


def unseen_errors(view: EffectView, alarm: float, variance: float) -> FloatArray:
    """Return the largest error of each parameter by an effect that the test misses, shape (p,)."""
    found_at = noncentrality(view.dof, alarm) if view.dof else np.inf
    seen = view.strengths / variance / found_at
    weight = WEIGHTS[:, None] * seen + (1.0 - WEIGHTS[:, None]) / COVERED_SIGMAS**2
    return np.sqrt(np.min((1.0 / weight) @ (view.errors**2).T, axis=0))


def noncentrality(dof: int, alarm: float) -> float:
    """Return the non-centrality that a χ² test of a false-alarm rate finds but for `MISSED`."""
    limit = float(chi2.isf(alarm, dof))

    def apart(value: float) -> float:
        return float(ncx2.cdf(limit, dof, value)) - MISSED

    return float(brentq(apart, 1e-6, 20.0 * limit + 100.0))


def over_limits(
    levels: Mapping[str, Level], limits: Mapping[str, float], groups: Mapping[str, str]
) -> dict[str, str]:
    """Return by group whose limit is exceeded the parameter that exceeds it most.

    Parameters
    ----------
    levels : mapping of str to Level
    limits : mapping of str to float
        By group, SI.
    groups : mapping of str to str
        The group of each parameter.
    """
    out: dict[str, str] = {}
    for group, limit in limits.items():
        mine = [n for n in levels if groups[n] == group]
        name = max(mine, key=lambda n: levels[n].total)
        if not levels[name].total <= limit:
            out[group] = name
    return out
