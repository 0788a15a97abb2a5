"""A measurement as an investigation takes it: all in which a chamber and a rig differ."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from errormodel.discrepancy.foresight import Foresight
from errormodel.discrepancy.gate import FactorFinding, Judgement
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.search.choices import Choice, Rules
from errormodel.discrepancy.search.state import SearchState
from errormodel.noise.model import NoiseFit, NoiseModel

Gap = TypeVar("Gap")
Proposal = TypeVar("Proposal")


class Refuted(Protocol):
    """Evidence of other measurements against an effect found in one."""

    @property
    def effect(self) -> str:
        """Name of the effect."""
        ...

    @property
    def sentence(self) -> str:
        """The evidence in words."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """A verdict and the result it is of, with a rival outside the library where there is one."""

    judgement: Judgement
    result: SearchState
    rival: object = None


class Measurement(ABC, Generic[Gap, Proposal]):
    """A measurement, its present model and the library of what may be missing.

    Attributes
    ----------
    name : str
        For lines of progress; may be empty.
    parts_name : str
        Name of what is held out: runs, cycles.
    known_noise : NoiseFit or None
        None where it is to be estimated.
    """

    name: str = ""
    parts_name: str = "parts"
    known_noise: NoiseFit | None = None

    @abstractmethod
    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the engine's problem of the model with some effects, refitted under a noise."""

    @abstractmethod
    def invisible(self, foresight: Foresight) -> tuple[str, ...]:
        """Return the effects that the measurement cannot show, whatever their size."""

    @abstractmethod
    def next_experiment(
        self, result: SearchState, judgement: Judgement, invisible: tuple[str, ...]
    ) -> Proposal | None:
        """Return the experiment that would settle what is open; None when nothing is."""

    @abstractmethod
    def parts(self, choices: Sequence[Choice]) -> Sequence[int]:
        """Return the parts to be held out, one after another; none where there are too few."""

    @abstractmethod
    def without_part(self, part: int) -> "Measurement[Gap, Proposal]":
        """Return the measurement without one part."""

    @abstractmethod
    def gap(self, part: int, others: "Measurement[Gap, Proposal]", chosen: Sequence[Choice]) -> Gap:
        """Return the gap in a part, before and after, by effects that the others chose."""

    def rules(self, rules: Rules) -> Rules:
        """Return the thresholds for this measurement."""
        return rules

    def wider_rules(self, result: SearchState) -> Rules | None:
        """Return thresholds to search by again, after what a first search found."""
        del result
        return None

    def refuted(
        self, of: "Searched[Gap, Proposal]", every: Sequence["Searched[Gap, Proposal]"]
    ) -> tuple[Refuted, ...]:
        """Return the effects found that measurements made at the same time refute."""
        del of, every
        return ()

    def without_effects(self, names: frozenset[str]) -> "Measurement[Gap, Proposal]":
        """Return the measurement with a smaller library."""
        raise NotImplementedError(f"nothing refutes {names}")

    def drifts_too_much(self, result: SearchState) -> bool:
        """Tell whether the noise found is more than an instrument's drift can be."""
        del result
        return False

    def revised(
        self, judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
    ) -> Revision:
        """Return the verdict after what only this kind of measurement is held against."""
        del places
        return Revision(judgement, result)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Searched(Generic[Gap, Proposal]):
    """A measurement that has been searched, before its verdict.

    Attributes
    ----------
    measurement : Measurement
    foresight : Foresight
    result : SearchState
    refuted : tuple of Refuted
        Effects that measurements made at the same time refute.
    replaced : bool
        Other effects have come in their place, and explain clearly less than they did: their names
        do not stand.
    """

    measurement: Measurement[Gap, Proposal]
    foresight: Foresight
    result: SearchState
    refuted: tuple[Refuted, ...] = ()
    replaced: bool = False
