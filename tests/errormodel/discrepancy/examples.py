"""A small problem that is linear in everything, for the engine alone."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.discrepancy.problem import Candidate, Factor, Problem, Signature
from errormodel.discrepancy.search.choices import Choice
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import TimeBase


def time_base(runs: int = 3, n: int = 120, step_s: float = 60.0) -> TimeBase:
    """Return runs of n samples with an hour between them."""
    time_s = np.tile(np.arange(n) * step_s, runs)
    run = np.repeat(np.arange(runs), n)
    elapsed = time_s + run * (n * step_s + 3600.0)
    return TimeBase(time_s, run, np.ones(runs * n), elapsed)


def waves(base: TimeBase, cycles: float) -> np.ndarray:
    """Return a sine over each run, the same in all."""
    return np.sin(2 * np.pi * cycles * base.time_s / base.span_s)


def problem_of(
    base: TimeBase,
    residual: np.ndarray,
    columns: Mapping[str, np.ndarray],
    joint: Collection[str] = (),
) -> Problem:
    """Return a problem whose candidates are columns, shape (n, k) each, under white noise."""
    ones = np.ones((len(base), 1))
    candidates = tuple(
        Candidate(
            name=name,
            signature=lambda theta, c=c: Signature(columns=c),
            joint=name in joint,
        )
        for name, c in columns.items()
    )
    return Problem(
        times=base,
        residual=residual,
        base=ones,
        candidates=candidates,
        saturated=np.hstack([ones, *columns.values()]),
        noise=NoiseModel(),
    )


def linear_problem(
    residual: np.ndarray, base: TimeBase, *, known: bool = True, period: float = 3.0
) -> Problem:
    """Return a problem with candidates "wave", "same" (a copy of it), "square" and "lost"."""
    ones = np.ones((len(base), 1))
    wave = waves(base, period)[:, None]
    square = np.sign(waves(base, 1.0))[:, None]
    columns = {"wave": wave, "same": -2.0 * wave, "square": square, "lost": 3.0 * ones}
    candidates = tuple(
        Candidate(name=name, signature=lambda theta, c=c: Signature(columns=c))
        for name, c in columns.items()
    )
    return Problem(
        times=base,
        residual=residual,
        base=ones,
        candidates=candidates,
        saturated=np.hstack([ones, wave, square]),
        factors=(Factor(name="wave", groups=(wave, waves(base, 5.0)[:, None]), repeatable=True),),
        noise=NoiseModel() if known else None,
    )


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
