"""What a search is made of: its thresholds, what it chooses from, and what it hands back."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from errormodel.discrepancy.problem import Problem, Theta
from errormodel.discrepancy.scan import Found
from errormodel.noise.model import NoiseFit, NoiseModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """The thresholds, frozen before any benchmark is run.

    Attributes
    ----------
    alpha, alpha_event : float
        False-alarm rates of the effects that repeat and of the events, each as a whole, for one
        to enter.
    least : float
        What an effect must explain beyond luck beside the others, to keep its name.
    further : float
        What a further effect must explain, beyond luck, beside one that is named already: the
        shape of the first is never known quite.
    further_event : float
        The same for a further event.
    alpha_rest : float
        The same for what is left to be called unexplained.
    alias : float
        Effects whose gain (beyond its mean under the null) is within this of the best cannot be
        told from it. Two effects that truly differ by this in expectation are taken for each
        other in about one case in 700.
    share : float
        What the named effects must explain of the excess for their names to stand.
    supple : float
        A more supple member of a family must gain this, beyond twice its further unknowns.
    relative : float
        An effect weaker than this share of a named one, in a pattern that the named one half
        imitates, is told as the shape of that one and not by a name of its own.
    most : int
        Effects named at most.
    over_wander : float
        Twice the log of how much likelier the events named must be than a smooth wander in their
        place: ten times.
    pairs : bool
        Whether two effects at once are tried before one is named: where many follow the same
        input, as over temperature, two may half cancel.
    """

    alpha: float = 0.002
    alpha_event: float = 0.008
    least: float = 10.0
    further: float = 30.0
    further_event: float = 0.0
    alpha_rest: float = 0.002
    alias: float = 9.0
    share: float = 0.6
    supple: float = 9.0
    relative: float = 0.15
    most: int = 3
    over_wander: float = 4.6
    pairs: bool = False


@dataclass(frozen=True, slots=True)
class Choice:
    """An effect put into the model, at its nonlinear parameters; `rich` the supple member."""

    name: str
    theta: Theta
    rich: bool = False


class Source(Protocol):
    """What makes the engine's problem of a model with some effects added."""

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the problem of the enlarged model, refitted under a noise."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearSource:
    """A source for a problem that is linear in everything, as a filter's innovations are.

    The effects chosen join the baseline by their signature's columns.
    """

    start: Problem

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the problem with the chosen effects' columns in the baseline."""
        del noise
        by_name = {c.name: c for c in self.start.candidates}
        added = [by_name[c.name].signature(c.theta).columns for c in chosen]
        names = {c.name for c in chosen}
        return Problem(
            times=self.start.times,
            residual=self.start.residual,
            base=np.hstack([self.start.base, *added]),
            candidates=tuple(c for c in self.start.candidates if c.name not in names),
            saturated=np.hstack([self.start.saturated, *added]),
            factors=self.start.factors,
            noise=self.start.noise,
            events=self.start.events,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Slot:
    """One named effect and its rivals.

    Attributes
    ----------
    choice : Choice
    gain : float
        Chi-square it explains beside the other effects.
    p_value : float
        Of that gain, over the library.
    rivals : tuple of (str, float)
        Every other effect with how far its score lies below, nearest first.
    alias : tuple of str
        The names that cannot be told apart, the best first; one name alone: it is named.
    """

    choice: Choice
    gain: float
    p_value: float
    rivals: tuple[tuple[str, float], ...]
    alias: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchResult:
    """What the search found.

    Attributes
    ----------
    slots : tuple of Slot
    floor : NoiseFit
        The noise the last steps were judged by.
    explained : float
        Chi-square that the effects explain together.
    over_wander : float
        Twice the log-likelihood of the events chosen, less that of a smooth wander in their place.
    first : tuple of Found
        Every candidate on the residual of the present model.
    started : tuple of str
        Of the effects found, those that the search began with: terms of the present model's own
        equation, which it lacked at once.
    """

    slots: tuple[Slot, ...]
    floor: NoiseFit
    explained: float
    over_wander: float = float("inf")
    first: tuple[Found, ...] = field(default=())
    started: tuple[str, ...] = ()
