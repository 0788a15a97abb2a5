"""Effects that do not repeat, judged with the noise estimated beside each of them.

A step, an offset of a run, a slow relaxation: beside a mean without them they pose as slow noise,
and the noise so found hides them. So the statistic is a likelihood ratio: the best likelihood over
noise shapes with the effect in the mean against the best without it. The price is that some of
them cannot be told from a random walk, and that is true.
"""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.coloured import NoiseShape
from errormodel.discrepancy.floor import PENALTY, NoiseFloor, Restricted, estimate_floor
from errormodel.discrepancy.problem import Candidate, Problem, columns_of, independent
from errormodel.discrepancy.scan import Prepared, View

MOST_SHAPES = 12  # of either kind, over which likelihoods are maximised
# More points of a grid than this cannot all stand beside the noise: so many do for them.
MANY, STAND_INS = 40, 12


def events_of(problem: Problem) -> tuple[Candidate, ...]:
    """Return the candidates that do not repeat."""
    return tuple(c for c in problem.candidates if c.event)


def shapes_allowed(problem: Problem, floor: NoiseFloor) -> tuple[NoiseShape, ...]:
    """Return the noise shapes allowed with and without effects that do not repeat."""
    columns = [problem.saturated]
    for candidate in events_of(problem):
        every = candidate.prepared()
        count = 4 if len(every) <= MANY else STAND_INS
        columns += [columns_of(s) for s in every[:: max(1, len(every) // count)]]
    beside = independent(np.hstack(columns), 1e-4)
    other = estimate_floor(problem.times, problem.residual, beside)
    shapes = [s for f in (floor, other) for _, s in f.support[:MOST_SHAPES]]
    return tuple(dict.fromkeys(shapes))


def event_ratios(
    problem: Problem,
    shapes: Sequence[NoiseShape],
    residuals: FloatArray,
    candidates: Sequence[Candidate] | None = None,
) -> FloatArray:
    """Return twice the log-likelihood ratio of each candidate, shape (candidates, D).

    The mean is the present model alone: beside everything that repeats, too little of a slow
    relaxation would be left. An effect that repeats must therefore be in the model first.

    Parameters
    ----------
    problem : Problem
    shapes : sequence of NoiseShape
        Over which the likelihood is maximised, with each effect and without.
    residuals : ndarray, shape (n, D)
    candidates : sequence of Candidate, optional
        By default the events.
    """
    events = events_of(problem) if candidates is None else tuple(candidates)
    judge = Restricted(problem.times, problem.base)
    beside = Problem(
        times=problem.times,
        residual=problem.residual,
        base=judge.mean,
        candidates=events,
        saturated=judge.mean,
    )
    without = np.full(residuals.shape[1], -np.inf)
    with_effect = np.full((len(events), residuals.shape[1]), -np.inf)
    for shape in shapes:
        likelihood, sigma = judge.evaluate(shape, residuals)
        likelihood = likelihood - PENALTY[shape.family]
        view = View(beside, shape, 1.0)
        gains = Prepared(view, events).null_gains(view.white(residuals))
        share = np.clip(gains / (sigma**2 * judge.dof), 0.0, 1.0 - 1e-12)
        without = np.maximum(without, likelihood)
        improved = likelihood - 0.5 * judge.dof * np.log1p(-share)
        with_effect = np.maximum(with_effect, improved)
    return 2.0 * np.maximum(with_effect - without, 0.0)
