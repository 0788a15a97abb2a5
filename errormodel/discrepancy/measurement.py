"""Interface of a measurement: everything in which a chamber and a rig differ."""

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
    """A verdict with its result and, if there is one, a rival outside the library."""

    judgement: Judgement
    result: SearchState
    rival: object = None


class Measurement(ABC, Generic[Gap, Proposal]):
    """A measurement, its present model and the library of candidate effects.

    Attributes
    ----------
    name : str
        For lines of progress; may be empty.
    parts_name : str
        Name of what is held out: runs, cycles.
    known_noise : NoiseFit or None
        None if it is to be estimated.
    """

    name: str = ""
    parts_name: str = "parts"
    known_noise: NoiseFit | None = None

    @abstractmethod
    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the search problem of the model with some effects, refitted under a noise."""

    @abstractmethod
    def invisible(self, foresight: Foresight) -> tuple[str, ...]:
        """Return the effects that the measurement cannot show, whatever their size."""

    @abstractmethod
    def next_experiment(
        self, result: SearchState, judgement: Judgement, invisible: tuple[str, ...]
    ) -> Proposal | None:
        """Return the experiment that would decide an open question; None if there is none."""

    @abstractmethod
    def parts(self, choices: Sequence[Choice]) -> Sequence[int]:
        """Return the parts to be held out in turn; empty if there are too few."""

    @abstractmethod
    def without_part(self, part: int) -> "Measurement[Gap, Proposal]":
        """Return the measurement without one part."""

    @abstractmethod
    def gap(self, part: int, others: "Measurement[Gap, Proposal]", chosen: Sequence[Choice]) -> Gap:
        """Return the residual of a part, before and after, with effects selected by the others."""

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
        """Return True if the estimated noise exceeds the possible drift of an instrument."""
        del result
        return False

    def revised(
        self, judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
    ) -> Revision:
        """Return the verdict after the tests that are specific to this kind of measurement."""
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
        Other effects replaced them and explain clearly less, so they are not named.
    """

    measurement: Measurement[Gap, Proposal]
    foresight: Foresight
    result: SearchState
    refuted: tuple[Refuted, ...] = ()
    replaced: bool = False
