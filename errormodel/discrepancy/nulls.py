"""Null distributions of every statistic: simulated, with a separate noise estimate for each draw.

The draws take their noise from all shapes that the data allow, weighted by likelihood. The noise of
each draw is estimated before its statistics are computed, so the distribution includes the
uncertainty of the noise. The tail of each statistic is an exponential fitted to the largest fifth
of the draws, at most a hundred, because the tail is the closer to an exponential the further out it
is. The smallest
p-value of the library has a distribution of its own, from the same draws.
"""

from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.events import event_ratios, shapes_allowed
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scale import Scales
from errormodel.discrepancy.scan import Prepared, View
from errormodel.noise.floor import PENALTY
from errormodel.noise.likelihood import RestrictedLikelihood
from errormodel.noise.model import NoiseFit, NoiseModel
from errormodel.noise.whitening import TimeBase

TAIL_SHARE = 0.2
TAIL_MOST = 100  # draws: an exponential's scale is then known to a tenth
PART = 250  # draws that are worked on together, for the memory they take


@dataclass(frozen=True, slots=True, eq=False)
class NullDistribution:
    """Distribution of one statistic when nothing is missing, from draws of it."""

    draws: FloatArray

    @property
    def mean(self) -> float:
        """Mean of the statistic."""
        return float(np.mean(self.draws))

    def p_value(self, value: float) -> float:
        """Return the probability of a value as large or larger."""
        return float(self.p_values(np.array([value]))[0])

    def p_values(self, values: FloatArray) -> FloatArray:
        """Return the probabilities of many values."""
        ordered = np.sort(self.draws)
        share = min(TAIL_SHARE, TAIL_MOST / ordered.size)
        edge = float(np.quantile(ordered, 1.0 - share))
        beyond = ordered[ordered > edge] - edge
        scale = float(np.mean(beyond)) if beyond.size else 1e-9
        above = ordered.size - np.searchsorted(ordered, values, side="left")
        inner = (above + 0.5) / (ordered.size + 1.0)
        tail = share * np.exp(-np.maximum(values - edge, 0.0) / max(scale, 1e-9))
        return np.where(values > edge, np.minimum(tail, share), np.minimum(inner, 1.0))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NullDistributions:
    """The null distributions of a problem.

    Attributes
    ----------
    gains : mapping of str to NullDistribution
        Distribution of each candidate's gain; for an event, of its likelihood ratio.
    shapes : tuple of NoiseModel
        Over which those likelihoods are maximised.
    least : mapping of bool to NullDistribution
        Distribution of −ln of the smallest p-value over the events, and over the candidates that
        repeat.
    events : frozenset of str
        Names of the events.
    factors : mapping of str to NullDistribution
        Distribution of each factor's share of chi-square.
    least_factor : mapping of bool to NullDistribution
        Distribution of −ln of the smallest p-value over the repeatable factors, and the others.
    """

    gains: dict[str, NullDistribution]
    shapes: tuple[NoiseModel, ...]
    least: dict[bool, NullDistribution]
    events: frozenset[str]
    factors: dict[str, NullDistribution]
    least_factor: dict[bool, NullDistribution]

    def expected_gain(self, name: str) -> float:
        """Return the expected null gain of a candidate: its mean chi-square in noise alone."""
        return self.gains[name].mean if name in self.gains else 0.0

    def p_of(self, name: str, gain: float) -> float:
        """Return the p-value of one candidate's gain, taken alone."""
        return self.gains[name].p_value(gain)

    def p_family(self, name: str, gain: float) -> float:
        """Return the p-value of a candidate's gain over all candidates of its kind."""
        alone = self.p_of(name, gain)
        null = self.least[name in self.events]
        return null.p_value(-float(np.log(max(alone, 1e-300))))

    def p_factor_family(self, p_alone: float, *, repeatable: bool) -> float:
        """Return the p-value of the smallest p-value over the factors of a kind."""
        return self.least_factor[repeatable].p_value(-float(np.log(max(p_alone, 1e-300))))


def draw_noise(
    times: TimeBase, floor: NoiseFit, count: int, rng: np.random.Generator
) -> FloatArray:
    """Draw noise of all shapes the data allow, shape (n, count), in units of the white sigma."""
    weights = np.array([w for w, _ in floor.support])
    chosen = rng.choice(weights.size, size=count, p=weights / weights.sum())
    white = rng.standard_normal((len(times), count))
    out = np.empty_like(white)
    for k in np.unique(chosen).tolist():
        columns = np.flatnonzero(chosen == k)
        out[:, columns] = floor.support[k][1].whitener(times).colour(white[:, columns])
    return out


def simulate_nulls(
    problem: Problem,
    floor: NoiseFit,
    *,
    draws: int,
    rng: np.random.Generator,
    workers: int = 1,
) -> NullDistributions:
    """Simulate the null distributions of a problem's statistics.

    Parameters
    ----------
    problem : Problem
    floor : NoiseFit
        Noise of the measured residual.
    draws : int
    rng : numpy.random.Generator
    workers : int
        Threads, each with a noise shape of its own; the result does not depend on their number.

    Returns
    -------
    NullDistributions
    """
    noise = Scales(problem).normalised(draw_noise(problem.times, floor, draws, rng))
    for candidate in problem.candidates:
        _ = candidate.grid_signatures  # once, before the threads start
    shapes_of_events = _shapes_of_events(problem, floor)
    with ThreadPoolExecutor(workers) as pool:
        gains, factors = _null_values(problem, floor, noise, pool)
        if shapes_of_events:  # the statistic of an event is its likelihood ratio
            rows = [k for k, c in enumerate(problem.candidates) if c.event]
            gains[rows] = event_ratios(problem, shapes_of_events, noise, pool=pool)
    return _distributions(problem, gains, factors, shapes_of_events)


def _null_values(
    problem: Problem, floor: NoiseFit, noise: FloatArray, pool: Executor
) -> tuple[FloatArray, FloatArray]:
    """Return the gains of candidates and of factors, one column a draw.

    The candidates are prepared once for each noise shape, for all draws that use it, because this
    takes most of the time.
    """
    draws = int(noise.shape[1])
    shapes, sigmas = _estimated(problem, floor, noise)
    gains = np.empty((len(problem.candidates), draws))
    factors = np.empty((len(problem.factors), draws))

    def judge_by(shape: NoiseModel) -> None:
        mine = np.flatnonzero([s == shape for s in shapes])
        view = View(problem, shape)
        # a lag's own offset is in units of the residual; the draws are in those of its sigma
        prepared = Prepared(View(problem, shape.scaled(floor.noise.white)), problem.candidates)
        for first in range(0, mine.size, PART):
            part = mine[first : first + PART]
            data = view.white(noise[:, part]) / sigmas[part]
            gains[:, part] = prepared.null_gains(data)
            for k, factor in enumerate(problem.factors):
                factors[k, part] = view.factor_gains(factor, data)

    list(pool.map(judge_by, dict.fromkeys(shapes)))
    return gains, factors


def _shapes_of_events(problem: Problem, floor: NoiseFit) -> tuple[NoiseModel, ...]:
    """Return the noise shapes that events are judged under; none where there are no events."""
    if problem.noise is not None or not any(c.event for c in problem.candidates):
        return ()
    return shapes_allowed(problem, floor)


def _estimated(
    problem: Problem, floor: NoiseFit, noise: FloatArray
) -> tuple[list[NoiseModel], FloatArray]:
    """Return the noise shape and the white sigma estimated for each draw."""
    if problem.noise is not None:
        known: FloatArray = np.ones(int(noise.shape[1]))
        return [problem.noise] * known.size, known
    judge = RestrictedLikelihood(problem.times, problem.saturated)
    shapes = [s.shape for _, s in floor.support]
    judged = [judge.evaluate(s, noise) for s in shapes]
    likelihoods = [j[0] - PENALTY[s.family] for s, j in zip(shapes, judged, strict=True)]
    best: list[int] = np.argmax(np.array(likelihoods), axis=0).tolist()
    sigmas = np.array([float(judged[k][1][d]) for d, k in enumerate(best)])
    return [shapes[k] for k in best], sigmas


def _distributions(
    problem: Problem, gains: FloatArray, factors: FloatArray, shapes: tuple[NoiseModel, ...]
) -> NullDistributions:
    of_gains = _named([c.name for c in problem.candidates], gains)
    of_factors = _named([f.name for f in problem.factors], factors)
    least = _least_by_kind([c.event for c in problem.candidates], list(of_gains.values()), gains)
    by_kind = _least_by_kind(
        [f.repeatable for f in problem.factors], list(of_factors.values()), factors
    )
    return NullDistributions(
        gains=of_gains,
        shapes=shapes,
        least=least,
        events=frozenset(c.name for c in problem.candidates if c.event),
        factors=of_factors,
        least_factor=by_kind,
    )


def _named(names: Sequence[str], values: FloatArray) -> dict[str, NullDistribution]:
    return {name: NullDistribution(own) for name, own in zip(names, values, strict=True)}


def _least_by_kind(
    kinds: list[bool], nulls: list[NullDistribution], values: FloatArray
) -> dict[bool, NullDistribution]:
    made: dict[bool, NullDistribution] = {}
    for kind in (True, False):
        rows = [k for k, own in enumerate(kinds) if own == kind]
        made[kind] = NullDistribution(_smallest([nulls[k] for k in rows], values[rows]))
    return made


def _smallest(nulls: list[NullDistribution], values: FloatArray) -> FloatArray:
    """Return −ln of the smallest p-value of each draw."""
    if not nulls:
        return np.zeros(max(int(values.shape[-1]), 1))
    p_values: list[FloatArray] = [
        null.p_values(own) for null, own in zip(nulls, values, strict=True)
    ]
    return -np.log(np.min(np.array(p_values, dtype=float), axis=0))
