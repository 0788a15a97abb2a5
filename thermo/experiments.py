"""The experiment that would settle what is open."""

from dataclasses import dataclass

from errormodel.discrepancy.floor import NoiseFloor
from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.search import SearchResult
from thermo.discrepancy_source import ThermalSource
from thermo.sequence import Sequence


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment proposed: in words, and as a sequence that `run` takes."""

    text: str
    separates: tuple[str, ...]
    d_before: float | None
    d_after: float | None
    hours: float | None
    sequence: Sequence | None


def propose(
    source: ThermalSource,
    result: SearchResult,
    verdict: Judgement,
    invisible: tuple[str, ...],
    floor: NoiseFloor,
) -> Experiment | None:
    """Propose what would tell apart the effects of an alias set, or show what cannot be seen."""
    del floor
    known = {e.name: e for e in source.effects}
    for slot in result.slots:
        if len(slot.alias) > 1 and verdict.verdict == "alias":
            text = "; ".join(f"{n}: {known[n].experiment}" for n in slot.alias[:3])
            return Experiment(
                text=text,
                separates=slot.alias,
                d_before=None,
                d_after=None,
                hours=None,
                sequence=None,
            )
    shown = [n for n in invisible if n in known]
    if shown:
        return Experiment(
            text=f"{shown[0]}: {known[shown[0]].experiment}",
            separates=(shown[0],),
            d_before=0.0,
            d_after=None,
            hours=None,
            sequence=None,
        )
    return None
