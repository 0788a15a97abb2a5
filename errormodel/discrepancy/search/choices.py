"""The thresholds of a search, a choice it makes, and the source of its problems."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from errormodel.discrepancy.problem import Problem, Theta
from errormodel.noise.model import NoiseModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """The thresholds, frozen before any benchmark is run.

    Attributes
    ----------
    alpha, alpha_event : float
        False-alarm rates for adding an effect: for all repeatable effects together, and for all
        events together.
    least : float
        Chi-square that an effect must explain beyond the expected null gain, beside the others, to
        keep its name.
    further : float
        Chi-square that a further effect must explain, beyond the expected null gain, beside one
        that is already named, because the shape of the first is never known exactly.
    further_event : float
        Chi-square that a further event must explain.
    alpha_rest : float
        False-alarm rate for declaring the remainder unexplained.
    alias : float
        Effects with a gain (beyond the expected null gain) within this of the best cannot be
        separated from it. Two effects with this expected difference are confused in about one case
        in 700.
    share : float
        Share of the excess that the named effects must explain.
    flexible : float
        Chi-square that a flexible form must gain, beyond twice its further parameters.
    relative : float
        Effects smaller than this fraction of one named already, with a similar pattern, are
        attributed to that one's imperfect shape.
    most : int
        Effects named at most.
    over_wander : float
        Twice the log-likelihood ratio by which the named events must exceed a smooth wander: a
        factor of ten.
    pairs : bool
        True to try two effects at once before one is named. If many effects follow the same input,
        such as temperature, two may half cancel.
    """

    alpha: float = 0.002
    alpha_event: float = 0.008
    least: float = 10.0
    further: float = 30.0
    further_event: float = 0.0
    alpha_rest: float = 0.002
    alias: float = 9.0
    share: float = 0.6
    flexible: float = 9.0
    relative: float = 0.15
    most: int = 3
    over_wander: float = 4.6
    pairs: bool = False


@dataclass(frozen=True, slots=True)
class Choice:
    """An effect in the model at given nonlinear parameters, or in its flexible form."""

    name: str
    theta: Theta
    flexible: bool = False


class Source(Protocol):
    """A measurement that provides the search problem of its model with some effects added."""

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the problem of the enlarged model, refitted under a noise."""
        ...
