"""The place of a disagreement, and the verdict on whether the named effects explain it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.discrepancy.nulls import NullDistributions
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Rules
from errormodel.discrepancy.search.ranking import residual_of
from errormodel.discrepancy.search.state import SearchState

Verdict = Literal["named", "alias", "unexplained_repeatable", "unexplained_noise", "nothing"]
# Penalty of one resolved direction in the comparison of factors (ln of some 20 samples).
PER_DIRECTION = 3.0
# Excess kurtosis of the whitened residual beyond this many of its own sigmas is bursts, not noise.
BURSTS = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FactorFinding:
    """Share of the residual that follows one factor.

    `excess` is its chi-square minus the mean of noise alone; `score` also subtracts a penalty for
    its resolution; `p_value` is over all factors of its kind.
    """

    name: str
    repeatable: bool
    excess: float
    score: float
    p_value: float


def locate(view: View, nulls: NullDistributions) -> tuple[FactorFinding, ...]:
    """Return every factor with the excess that it explains, the best first."""
    data = view.data[:, None]
    found: list[FactorFinding] = []
    for factor in view.problem.factors:
        gain = float(view.factor_gains(factor, data)[0])
        null = nulls.factors[factor.name]
        p_value = nulls.p_factor_family(null.p_value(gain), repeatable=factor.repeatable)
        score = gain - PER_DIRECTION * null.mean
        found.append(
            FactorFinding(
                name=factor.name,
                repeatable=factor.repeatable,
                excess=gain - null.mean,
                score=score,
                p_value=p_value,
            )
        )
    return tuple(sorted(found, key=lambda f: -f.score))


def bursts(view: View) -> float:
    """Return the excess kurtosis of the whitened residual in units of its own sigma.

    Bounded samples are left out, because their smaller noise would change the kurtosis.
    """
    rest = residual_of(view)
    if view.problem.bounded is not None:
        rest = rest[~view.problem.bounded]
    if rest.size < 30:
        return 0.0
    scaled = rest / np.std(rest)
    return float((np.mean(scaled**4) - 3.0) / np.sqrt(24.0 / rest.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """The verdict and its basis.

    Attributes
    ----------
    verdict : str
    explained_share : float
        Share of the excess chi-square that is explained.
    rest : tuple of FactorFinding
        Remainder after the named effects, by factor.
    loud, loud_noise : bool
        True if a repeatable, or a non-repeatable, remainder is significant.
    bursts : float
    """

    verdict: Verdict
    explained_share: float
    rest: tuple[FactorFinding, ...]
    loud: bool
    loud_noise: bool
    bursts: float

    @property
    def names_stand(self) -> bool:
        """True if effects are named, alone or in alias sets."""
        return self.verdict in ("named", "alias")


def judge(
    view: View, result: SearchState, nulls: NullDistributions, rules: Rules, *, too_much_drift: bool
) -> Judgement:
    """Test whether the named effects explain the disagreement.

    Parameters
    ----------
    view : View
        View of the model with the effects found.
    result : SearchState
    nulls : NullDistributions
    rules : Rules
    too_much_drift : bool
        The noise itself is more than it may be.
    """
    rest = locate(view, nulls)
    repeating = [f for f in rest if f.repeatable and f.p_value < rules.alpha_rest]
    passing = [f for f in rest if not f.repeatable and f.p_value < rules.alpha_rest]
    spikes = bursts(view)
    left = max((f.excess for f in repeating), default=0.0)
    share = result.explained / (result.explained + left) if result.explained else 0.0
    loud = bool(repeating)
    wanders = result.over_wander < rules.over_wander
    restless = bool(passing) or spikes > BURSTS or wanders
    loud_noise = restless or too_much_drift
    events = result.slots and all(_is_event(view, s.choice.name) for s in result.slots)
    verdict: Verdict = "nothing"
    if loud and share < rules.share:
        verdict = "unexplained_repeatable"
    elif (loud_noise and not result.slots) or (restless and events):
        verdict = "unexplained_noise"
    elif result.slots:
        verdict = "alias" if any(len(s.alias) > 1 for s in result.slots) else "named"
    return Judgement(
        verdict=verdict,
        explained_share=share,
        rest=rest,
        loud=loud,
        loud_noise=loud_noise,
        bursts=spikes,
    )


def _is_event(view: View, name: str) -> bool:
    return name in view.problem.events


def withdraw_if_factor_explains_more(
    judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
) -> Judgement:
    """Withdraw names that explain clearly less than a factor alone does.

    A factor describes a part of the missing effect; the correct effects explain all of it. If a
    factor explains more than the named effects, by more than in all but a share `alpha_rest` of the
    simulated nulls, the cause is another one: for example a slow drift, which a jump and two
    further effects would describe in part. If the named effects leave no significant remainder,
    they are kept; a factor that explains more then follows linearisation errors.

    Parameters
    ----------
    judgement : Judgement
    result : SearchState
    places : sequence of FactorFinding
        Factors of the present model's residual.
    """
    quiet = not (judgement.loud or judgement.loud_noise)
    if quiet or not judgement.names_stand:
        return judgement
    expected = sum(result.nulls.expected_gain(c.name) for c in result.found)
    explained = result.explained - expected
    for place in places:
        null = result.nulls.factors[place.name]
        by_chance = float(np.quantile(null.draws, 1.0 - result.rules.alpha_rest)) - null.mean
        if place.excess - by_chance > explained:
            return replace(
                judgement,
                verdict="unexplained_repeatable" if place.repeatable else "unexplained_noise",
                explained_share=max(explained, 0.0) / place.excess,
            )
    return judgement
