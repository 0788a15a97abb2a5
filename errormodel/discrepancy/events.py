"""Effects that do not repeat, tested with a noise estimate for each of them.

If a step, an offset of a run or a slow relaxation is missing from the mean, it is taken for slow
noise, and the estimated noise hides it. The statistic is therefore a likelihood ratio: the best
likelihood over noise shapes with the effect in the mean, divided by the best without it. Some
events cannot be separated from a random walk.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Problem, Signature, Theta, columns_of
from errormodel.discrepancy.scan import Prepared, View
from errormodel.linear import independent
from errormodel.noise.floor import PENALTY, REACH, SLOWEST_SPANS
from errormodel.noise.likelihood import RestrictedLikelihood
from errormodel.noise.model import NoiseFit, NoiseModel, drifting, flicker, walking
from errormodel.noise.whitening import TimeBase

MOST_SHAPES = 12  # without an event, over which likelihoods are maximised
MOST_BESIDE = 5  # beside each event
# Powers of slow noise relative to the white: the grid for placing events and for estimating the
# noise with them (a likelihood is some 30 % wide in the power).
POWERS_TO_PLACE = (0.3, 10.0)
POWERS = tuple(np.geomspace(0.02, 200.0, 12).tolist())
PEAKS = 3  # peaks of a grid that are refined
BETWEEN = 7  # points tried between neighbours of a grid


def events_of(problem: Problem) -> tuple[Candidate, ...]:
    """Return the candidates that do not repeat."""
    return tuple(c for c in problem.candidates if c.event)


def shapes_allowed(problem: Problem, floor: NoiseFit) -> tuple[NoiseModel, ...]:
    """Return the noise shapes that the data allow without an event, and with each event.

    An event is first placed at its likeliest time over shapes of every kind. With an error of one
    minute, the remainder of a step would be so large that only a noise that hides all steps would
    be allowed. The repeatable part is projected out first, so that a missing repeatable effect is
    not taken for an event.
    """
    steady = independent(problem.saturated)
    rest = problem.residual - steady @ (steady.T @ problem.residual)
    passing = _with_base(problem, problem.base, rest)
    probes = noise_menu(problem.times, POWERS_TO_PLACE, 2)
    columns: list[FloatArray] = [np.zeros((len(problem.times), 0))]
    for candidate in events_of(problem):
        columns.append(columns_of(candidate.signature(placed(passing, probes, candidate).theta)))
    judge = RestrictedLikelihood(problem.times, problem.saturated)
    menu = tuple(
        dict.fromkeys((*(s.shape for _, s in floor.support), *noise_menu(problem.times, POWERS, 4)))
    )
    beside = np.array(
        [judge.beside(s, problem.residual, columns) - PENALTY[s.family] for s in menu]
    )
    kept = [s.shape for _, s in floor.support[:MOST_SHAPES]]
    for likelihoods in beside.T:
        order = np.argsort(-likelihoods)[:MOST_BESIDE]
        kept += [menu[k] for k in order.tolist() if likelihoods[k] > likelihoods.max() - REACH]
    return tuple(dict.fromkeys(kept))


def noise_menu(times: TimeBase, powers: Sequence[float], taus: int) -> tuple[NoiseModel, ...]:
    """Return noise shapes of every kind: white, and slow parts of these powers."""
    between = np.geomspace(5.0 * times.step_s, SLOWEST_SPANS * times.span_s, taus).tolist()
    return (
        NoiseModel(),
        *(drifting(r, t) for r in powers for t in between),
        *(walking(r, times, continued=c) for r in powers for c in (True, False)),
        *(flicker(r, times) for r in powers),
    )


def _with_base(problem: Problem, base: FloatArray, residual: FloatArray) -> Problem:
    return Problem(
        times=problem.times,
        residual=residual,
        base=base,
        candidates=problem.candidates,
        saturated=base,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """The likeliest place of an event, and twice its log-likelihood ratio there."""

    theta: Theta
    ratio: float


def placed(problem: Problem, shapes: Sequence[NoiseModel], candidate: Candidate) -> Placed:
    """Return the likeliest place of an event: on its grid, then near its highest peaks.

    The best grid point may be the start of a run, where a step has no cost under slow noise. A
    sharp step one minute from its true time has no reliable peak in the likelihood.
    """
    ratios = _ratios(problem, shapes, candidate.grid_signatures)
    k = int(np.argmax(ratios))
    best = Placed(theta=candidate.grid[k], ratio=float(ratios[k]))
    about = [t for peak in _peaks(ratios) for t in _about(candidate, candidate.grid[peak])]
    if not about:
        return best
    ratios = _ratios(problem, shapes, [candidate.signature(theta) for theta in about])
    k = int(np.argmax(ratios))
    finer = Placed(theta=about[k], ratio=float(ratios[k]))
    return finer if finer.ratio > best.ratio else best


def _peaks(ratios: FloatArray) -> list[int]:
    """Return the highest local maxima."""
    padded = np.concatenate([[-np.inf], ratios, [-np.inf]])
    tops = np.flatnonzero((ratios >= padded[:-2]) & (ratios >= padded[2:]))
    return tops[np.argsort(-ratios[tops])][:PEAKS].tolist()


def _ratios(
    problem: Problem, shapes: Sequence[NoiseModel], signatures: Sequence[Signature]
) -> FloatArray:
    points = [fixed(s) for s in signatures]
    return event_ratios(problem, shapes, problem.residual[:, None], points)[:, 0]


def fixed(signature: Signature) -> Candidate:
    """Return a candidate that is one point."""
    return Candidate(name="", signature=lambda theta: signature)


def _about(candidate: Candidate, theta: Theta) -> tuple[Theta, ...]:
    """Return points between the neighbours of a point of the grid."""
    if candidate.finer is not None:
        return candidate.finer(theta)
    if len(candidate.bounds) != 1:
        return ()
    values = sorted(t[0] for t in candidate.grid)
    k = values.index(theta[0])
    lo, hi = values[max(k - 1, 0)], values[min(k + 1, len(values) - 1)]
    between = np.geomspace if lo > 0.0 else np.linspace
    return tuple((v,) for v in between(lo, hi, BETWEEN).tolist())


def event_ratios(
    problem: Problem,
    shapes: Sequence[NoiseModel],
    residuals: FloatArray,
    candidates: Sequence[Candidate] | None = None,
    pool: Executor | None = None,
) -> FloatArray:
    """Return twice the log-likelihood ratio of each candidate, shape (candidates, D).

    The mean is the present model alone, because little of a slow relaxation would remain after
    projecting out everything that repeats. A repeatable effect must therefore be in the model
    first.

    Parameters
    ----------
    problem : Problem
    shapes : sequence of NoiseModel
        Over which the likelihood is maximised, with each effect and without.
    residuals : ndarray, shape (n, D)
    candidates : sequence of Candidate, optional
        By default the events.
    pool : Executor, optional
        Threads, each with a noise shape of its own.
    """
    events = events_of(problem) if candidates is None else tuple(candidates)
    judge = RestrictedLikelihood(problem.times, problem.base)
    beside = _with_base(problem, judge.mean, problem.residual)

    def likelihoods(shape: NoiseModel) -> tuple[FloatArray, FloatArray]:
        plain, sigma = judge.evaluate(shape, residuals)
        plain = plain - PENALTY[shape.family]
        view = View(beside, shape.shape)
        gains = Prepared(view, events).null_gains(view.white(residuals))
        share = np.clip(gains / (sigma**2 * judge.dof), 0.0, 1.0 - 1e-12)
        return plain, plain - 0.5 * judge.dof * np.log1p(-share)

    without = np.full(residuals.shape[1], -np.inf)
    with_effect = np.full((len(events), residuals.shape[1]), -np.inf)
    for plain, improved in (pool.map if pool else map)(likelihoods, shapes):
        without = np.maximum(without, plain)
        with_effect = np.maximum(with_effect, improved)
    return 2.0 * np.maximum(with_effect - without, 0.0)
