"""A small problem that is linear in everything, for the engine alone."""

import numpy as np

from errormodel.discrepancy.problem import Candidate, Factor, Problem, Signature
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
