"""The state of a search: an immutable value that each step takes and returns."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from errormodel.discrepancy.nulls import NullDistributions
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice, Rules, Source
from errormodel.noise.model import NoiseFit, NoiseModel

# Simulates the null distributions anew once the noise has been estimated beside an event.
Recalibrate = Callable[[Problem, NoiseFit], NullDistributions]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Slot:
    """One named effect and its rivals.

    Attributes
    ----------
    choice : Choice
    gain : float
        Chi-square it explains beside the other effects.
    p_value : float
        Its p-value over the library.
    rivals : tuple of (str, float)
        Every other effect with its difference in score, nearest first.
    alias : tuple of str
        The names that cannot be separated, the best first; with a single entry, the effect is
        named.
    """

    choice: Choice
    gain: float
    p_value: float
    rivals: tuple[tuple[str, float], ...]
    alias: tuple[str, ...]

    @property
    def weights(self) -> Mapping[str, float]:
        """Posterior weight of the effect and of each rival, alike beforehand; they add up to one.

        A score is twice the log-likelihood beyond what chance gives, so that a rival which lies b
        below the best is exp(−b/2) times as probable.
        """
        odds = {self.choice.name: 1.0} | {n: math.exp(-0.5 * b) for n, b in self.rivals}
        total = sum(odds.values())
        return {name: value / total for name, value in odds.items()}

    @property
    def weight(self) -> float:
        """Posterior weight of what is said of it: of the name, or of its alias set."""
        said = {self.choice.name, *self.alias}
        return sum(w for name, w in self.weights.items() if name in said)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchTask:
    """A search to be made.

    Attributes
    ----------
    source : Source
    floor : NoiseFit
        The noise of the present model's residual.
    nulls : NullDistributions
        Null distributions of the statistics under that noise.
    rules : Rules
    recalibrate : callable, optional
        Simulates null distributions beside an event that has entered.
    start : tuple of Choice
        Effects that the search begins with.
    """

    source: Source
    floor: NoiseFit
    nulls: NullDistributions
    rules: Rules = field(default_factory=Rules)
    recalibrate: Recalibrate | None = None
    start: tuple[Choice, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchState:
    """Progress of a search; the last state is its result.

    Attributes
    ----------
    task : SearchTask
    floor, nulls : NoiseFit, NullDistributions
        Noise and nulls for the next step; estimated again with an event that has entered.
    shapes : tuple of NoiseModel
        Noise shapes of unit white sigma for the tests of events.
    chosen : tuple of Choice
        Effects that have entered.
    complete : bool
        No further effect enters.
    p_at_entry : mapping of str to float
        p-value of each effect when it was added; afterwards the noise is estimated together with an
        event.
    pairs_instead : mapping of str to tuple of str
        Two effects that explain more than the named one, but not enough to replace it.
    slots : tuple of Slot
        The effects found, each with its rivals beside all others.
    explained : float
        Chi-square that the effects found explain together.
    over_wander : float
        Twice the log-likelihood of the named events minus that of a smooth wander.
    started : tuple of str
        Effects found that the search began with: terms of the present model's own equation, which
        it lacked at once.
    """

    task: SearchTask
    floor: NoiseFit
    nulls: NullDistributions
    shapes: tuple[NoiseModel, ...]
    chosen: tuple[Choice, ...] = ()
    complete: bool = False
    p_at_entry: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    pairs_instead: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: MappingProxyType({})
    )
    slots: tuple[Slot, ...] = ()
    explained: float = 0.0
    over_wander: float = float("inf")
    started: tuple[str, ...] = ()

    @property
    def rules(self) -> Rules:
        """The thresholds."""
        return self.task.rules

    @property
    def found(self) -> tuple[Choice, ...]:
        """The effects found."""
        return tuple(s.choice for s in self.slots)

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects found, and of those that could not be told from them."""
        return frozenset(n for s in self.slots for n in (s.choice.name, *s.alias))

    def problem(self, chosen: Sequence[Choice]) -> Problem:
        """Return the problem of the present model with some effects, refitted."""
        return self.task.source.problem(chosen, self.floor.noise)

    def view(self, chosen: Sequence[Choice]) -> View:
        """Return that problem under the present noise."""
        return View(self.problem(chosen), self.floor.noise)


def first_state(task: SearchTask) -> SearchState:
    """Return the state that a search begins with."""
    return SearchState(
        task=task,
        floor=task.floor,
        nulls=task.nulls,
        shapes=task.nulls.shapes,
        chosen=task.start,
    )
