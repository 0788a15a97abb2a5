"""Candidates ordered by their gain beyond the expected null gain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from errormodel.arrays import FloatArray
from errormodel.discrepancy.events import event_ratios, events_of, fixed, placed
from errormodel.discrepancy.problem import Candidate, Signature
from errormodel.discrepancy.scan import Found, Prepared, View
from errormodel.discrepancy.search.state import SearchState

# Scores this close are a tie: the effect with fewer parameters is put first.
TIE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
    """A candidate at its best.

    `score` is its gain beyond the expected null gain, so more parameters give no advantage by
    chance. `p_value` is over the whole library; `flexible` is True if the flexible form is used.
    """

    found: Found
    score: float
    p_value: float
    flexible: bool = False


def residual_of(view: View) -> FloatArray:
    """Return the whitened residual beside the baseline."""
    return view.beside_base(view.data[:, None])[:, 0]


def chi_square(view: View) -> float:
    """Return the whitened sum of squares of the residual of the baseline."""
    rest = residual_of(view)
    return float(rest @ rest)


def gain_of(view: View, one: Found) -> float:
    """Return the chi-square that an effect explains under the view's noise."""
    points = view.points([one.candidate.signature(one.theta)])
    return float(view.gains(points, view.data[:, None])[0, 0])


def parameter_count(candidate: Candidate) -> int:
    """Return the number of parameters of an effect, including nonlinear ones."""
    signature: Signature = candidate.grid_signatures[0]
    return signature.columns.shape[1] + len(candidate.grid[0])


def ranked_by_gain(state: SearchState, view: View) -> list[Ranked]:
    """Return every candidate at its best, under the present noise, best first."""
    made = [
        Ranked(
            found,
            found.gain - state.nulls.expected_gain(found.candidate.name),
            state.nulls.p_family(found.candidate.name, found.grid_gain),
        )
        for found in Prepared(view, view.problem.candidates).scan()
    ]
    return sorted(made, key=lambda r: -r.score)


def ranked_events(state: SearchState, view: View) -> list[Ranked]:
    """Return the events where they are likeliest, each with its likelihood ratio."""
    made: list[Ranked] = []
    for candidate in events_of(view.problem):
        at = placed(view.problem, state.shapes, candidate)
        name, gain = candidate.name, at.ratio
        found = Found(candidate=candidate, theta=at.theta, gain=gain, grid_gain=gain)
        score = gain - state.nulls.expected_gain(name)
        made.append(Ranked(found, score, state.nulls.p_family(name, gain)))
    return made


def beside_own_noise(state: SearchState, view: View, steady: Sequence[Ranked]) -> list[Ranked]:
    """Return effects that repeat with their likelihood ratios, as events have theirs."""
    points = [fixed(r.found.candidate.signature(r.found.theta)) for r in steady]
    data = view.problem.residual[:, None]
    ratios = event_ratios(view.problem, state.shapes, data, points)[:, 0].tolist()
    return [
        replace(r, score=ratio - state.nulls.expected_gain(r.found.candidate.name))
        for r, ratio in zip(steady, ratios, strict=True)
    ]


def lasting(view: View, ranked: list[Ranked]) -> list[Ranked]:
    """Return repeatable candidates for a single run, where all are tested as events."""
    if not all(c.event for c in view.problem.candidates):
        return ranked
    return [r for r in ranked if r.found.candidate.name not in view.problem.events]


def simplest_first(ranked: list[Ranked]) -> list[Ranked]:
    """Put the effect with the fewest parameters before those that are hardly better."""
    tied = [r for r in ranked if ranked[0].score - r.score < TIE]
    first = min(tied, key=lambda r: parameter_count(r.found.candidate))
    return [first, *(r for r in ranked if r is not first)]
