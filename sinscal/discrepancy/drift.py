"""A slow drift of the constant errors against the names that a search found instead of it.

A jump, a temperature or an asymmetry follows a drift in part; where the drift is more probable than
the names together, they are withdrawn, and where it is about as probable it joins their alias set.
"""

from dataclasses import replace

from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.search.state import SearchState, Slot
from sinscal.calibration.effect_tests import EffectTest
from sinscal.sensitivity.drift import Drift, drift_of
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.views import effect_views, tested_effects

# Log likelihoods nearer than this do not decide: odds of 150 to one.
UNDECIDED = 5.0


def against_drift(
    before: FilterProblem, verdict: Judgement, result: SearchState
) -> tuple[Judgement, SearchState, Drift | None]:
    """Return verdict and result with drifts considered, and the drift that the run shows.

    Parameters
    ----------
    before : FilterProblem
        Filter of the present model.
    verdict : Judgement
    result : SearchState
    """
    tests = tested_effects(effect_views(before.run, before.found, before.cycles), 1.0)
    shown = [t for t in tests.missing if drift_of(t, before.run.length_s)]
    if not shown:
        return verdict, result, None
    drift = drift_of(shown[0], before.run.length_s)
    if not verdict.names_stand:
        return verdict, result, drift if shown[0] == tests.missing[0] else None
    single = {t.name: t for t in tests.tests}
    named = sum(_evidence(slot, single) for slot in result.slots)
    ahead = shown[0].evidence - named
    if ahead < -UNDECIDED:
        return verdict, result, None
    if ahead > UNDECIDED:
        return replace(verdict, verdict="unexplained_noise"), result, drift
    strongest, *others = sorted(result.slots, key=lambda s: -s.gain)
    open_slot = replace(strongest, alias=(*strongest.alias, shown[0].name))
    result = replace(result, slots=(open_slot, *others))
    return replace(verdict, verdict="alias"), result, drift


def _evidence(slot: Slot, single: dict[str, EffectTest]) -> float:
    """Return the evidence of a named effect beside the others.

    The chi-square explained is the search's; the cost of its parameters is that of it alone.
    """
    alone = single.get(slot.choice.name)
    return 0.5 * slot.gain - (0.5 * alone.chi2 - alone.evidence if alone else 0.0)
