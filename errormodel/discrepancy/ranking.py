"""Candidates in the order of what they explain beyond luck."""

from dataclasses import dataclass

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Signature
from errormodel.discrepancy.scan import Found, View


def residual_of(view: View) -> FloatArray:
    """Return the whitened residual beside the baseline."""
    return view.beside_base(view.data[:, None])[:, 0]


def chi_square(view: View) -> float:
    """Return the whitened sum of squares that the baseline leaves."""
    rest = residual_of(view)
    return float(rest @ rest)


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
    """A candidate at its best.

    `score` is its gain beyond its mean under the null: what an effect with more unknowns gains by
    luck does not count for it. `p_value` is over the whole library; `rich` tells that the most
    supple member of its family stands for it.
    """

    found: Found
    score: float
    p_value: float
    rich: bool = False


def lasting(view: View, ranked: list[Ranked]) -> list[Ranked]:
    """Return what may repeat, where one run is all there is and all are judged as events."""
    if not all(c.event for c in view.problem.candidates):
        return ranked
    return [r for r in ranked if r.found.candidate.name not in view.problem.events]


def gain_of(view: View, one: Found) -> float:
    """Return the chi-square that an effect explains under the view's noise."""
    points = view.points([one.candidate.signature(one.theta)])
    return float(view.gains(points, view.data[:, None])[0, 0])


# Scores this close are a tie: the effect with fewer unknowns is put first.
TIE = 2.0


def simplest_first(ranked: list[Ranked]) -> list[Ranked]:
    """Put the effect with the fewest unknowns before those that are hardly better."""
    tied = [r for r in ranked if ranked[0].score - r.score < TIE]
    first = min(tied, key=lambda r: unknowns_of(r.found.candidate))
    return [first, *(r for r in ranked if r is not first)]


def unknowns_of(candidate: Candidate) -> int:
    """Return how many unknowns an effect has, nonlinear ones too."""
    signature: Signature = candidate.prepared()[0]
    return signature.columns.shape[1] + len(candidate.grid[0])
