"""The innovations of a rig run as a measurement for the investigation."""

from collections.abc import Sequence

from errormodel.discrepancy.foresight import Foresight
from errormodel.discrepancy.gate import (
    FactorFinding,
    Judgement,
    withdraw_if_factor_explains_more,
)
from errormodel.discrepancy.measurement import Measurement, Revision
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.state import SearchState
from errormodel.noise.model import NoiseModel, given_noise
from sinscal.discrepancy.drift import against_drift
from sinscal.discrepancy.held_out import CycleGap, gap_of_cycle
from sinscal.discrepancy.source import RigSource
from sinscal.library import rig_library

REPEAT = "repeat the same programme: an effect that repeats belongs to the model"


class RigInnovations(Measurement[CycleGap, str]):
    """Innovations of the rig filter over their sigmas: white and of unit variance."""

    parts_name = "cycles"
    known_noise = given_noise(NoiseModel())

    def __init__(self, source: RigSource) -> None:
        self.source = source

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the search problem of the filter with some effects, run again."""
        return self.source.problem(chosen, noise)

    def revised(
        self, judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
    ) -> Revision:
        """Compare names with factors and with a slow drift of the constant errors."""
        judgement = withdraw_if_factor_explains_more(judgement, result, places)
        return Revision(*against_drift(self.source.filter_with(()), judgement, result))

    def invisible(self, foresight: Foresight) -> tuple[str, ...]:
        """Return the effects that the run cannot show, and those whose signal it lacks."""
        source = self.source
        recorded = {e.name for e in source.shown}
        unrecorded = [e.name for e in source.effects if not (e.name in recorded or source.holds(e))]
        return (*foresight.invisible, *unrecorded)

    def next_experiment(
        self, result: SearchState, judgement: Judgement, invisible: tuple[str, ...]
    ) -> str | None:
        """Return the experiment that would decide an open question."""
        open_names = [n for s in result.slots if len(s.alias) > 1 for n in s.alias]
        if judgement.verdict == "alias":
            return _experiments(open_names)
        if judgement.verdict.startswith("unexplained"):
            return REPEAT
        return _experiments(invisible) if invisible else None

    def parts(self, choices: Sequence[Choice]) -> Sequence[int]:
        """Return the numbers of the cycles; empty without effects or with a single cycle."""
        cycles = len(self.source.run.cycles)
        return range(cycles) if choices and cycles > 1 else ()

    def without_part(self, part: int) -> "RigInnovations":
        """Return the other cycles, with filters that do not use this one."""
        cycles = range(len(self.source.run.cycles))
        return RigInnovations(self.source.of_cycles([k for k in cycles if k != part]))

    def gap(
        self, part: int, others: Measurement[CycleGap, str], chosen: Sequence[Choice]
    ) -> CycleGap:
        """Test effects on a cycle with the selection and the sizes of the others."""
        del others  # sizes are combined again, in the innovations of the whole run
        return gap_of_cycle(self.source.filter_with(()), part, chosen)


def _experiments(names: Sequence[str]) -> str:
    return "; ".join(f"{n}: {rig_library().by_name[n].experiment}" for n in dict.fromkeys(names))
