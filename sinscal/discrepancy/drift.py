"""Comparison of named effects with a slow drift of the constant errors.

A jump, a temperature or an asymmetry can partly describe a drift. If the drift is more probable
than the named effects together, they are withdrawn. If it is about as probable, it joins their
alias set.
"""

from dataclasses import replace

import numpy as np

from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.search.state import SearchState, Slot
from sinscal.calibration.effect_tests import EffectTest
from sinscal.library import rig_library
from sinscal.sensitivity.drift import Drift, drift_of
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.views import effect_views, tested_effects

# Smaller differences of log-likelihood do not decide; 5 corresponds to odds of 150 to one.
UNDECIDED = 5.0


def against_drift(
    before: FilterProblem, verdict: Judgement, result: SearchState
) -> tuple[Judgement, SearchState, Drift | None]:
    """Return verdict and result after the comparison, and the drift that the run shows.

    Parameters
    ----------
    before : FilterProblem
        Filter of the present model.
    verdict : Judgement
    result : SearchState
    """
    tests = tested_effects(effect_views(before.run, before.found, before.cycles), 1.0)
    if not verdict.names_stand:
        first = drift_of(tests.missing[0], before.run.length_s) if tests.missing else None
        return verdict, result, first
    # The drift is compared with the named effects, so it need not be significant by itself.
    rival = next((t for t in tests.tests if drift_of(t, before.run.length_s)), None)
    if rival is None:
        return verdict, result, None
    single = {t.name: t for t in tests.tests}
    ahead = rival.evidence - sum(_evidence(before, slot, single) for slot in result.slots)
    if ahead < -UNDECIDED:
        return verdict, result, None
    drift = drift_of(rival, before.run.length_s)
    if ahead > UNDECIDED:
        return replace(verdict, verdict="unexplained_noise"), result, drift
    strongest, *others = sorted(result.slots, key=lambda s: -s.gain)
    open_slot = replace(strongest, alias=(*strongest.alias, rival.name))
    result = replace(result, slots=(open_slot, *others))
    return replace(verdict, verdict="alias"), result, drift


def _evidence(before: FilterProblem, slot: Slot, single: dict[str, EffectTest]) -> float:
    """Return the evidence of a named effect beside the others.

    The chi-square explained is that of the search; the penalty of its parameters is computed for
    the effect alone. The search tries many times of a jump, so the mean likelihood over the run is
    its peak times its width divided by the length of the run (Laplace).
    """
    alone = single.get(slot.choice.name)
    if alone is None:
        return 0.5 * slot.gain
    effect = rig_library().by_name[slot.choice.name]
    if not effect.step:
        return 0.5 * slot.gain - (0.5 * alone.chi2 - alone.evidence)
    width_s = np.sqrt(2.0 * np.pi) * before.time_sigma_s(effect, slot.choice.theta)
    cost = -np.log(min(1.0, width_s / before.run.length_s))
    return 0.5 * slot.gain - (0.5 * alone.chi2 - alone.likelihood) - float(cost)
