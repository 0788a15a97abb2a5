"""A smooth wander against the names of events."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.wander import over_wander
from errormodel.noise.model import NoiseModel, drifting
from tests.errormodel.discrepancy.examples import time_base

BASE = time_base(runs=4, n=300)
HOURS = BASE.elapsed_s / 3600.0
SHAPES = (NoiseModel(), *(drifting(r, t) for r in (0.3, 1.0, 3.0) for t in (1200.0, 3600.0)))
RELAXED = np.exp(-HOURS / 5.0)[:, None]


def problem(residual: FloatArray) -> Problem:
    ones = np.ones((len(BASE), 1))
    return Problem(times=BASE, residual=residual, base=ones, candidates=(), saturated=ones)


def noise(rng: np.random.Generator) -> FloatArray:
    white = rng.standard_normal(len(BASE))
    return drifting(1.0, 3600.0).whitener(BASE).colour(white)


def test_a_relaxation_is_likelier_than_a_wander() -> None:
    rng = np.random.default_rng(3)
    # 20 white sigmas; a wander of any shape pays for its freedom with the determinant
    ratios = [
        over_wander(problem(noise(rng) + 20.0 * RELAXED[:, 0]), SHAPES, RELAXED, 2)
        for _ in range(20)
    ]
    assert min(ratios) > 0.0


def test_a_wander_is_likelier_than_the_relaxation_nearest_to_it() -> None:
    rng = np.random.default_rng(4)
    relaxations = [np.exp(-HOURS / tau)[:, None] for tau in (1.0, 4.0, 16.0)]
    ratios: list[float] = []
    for _ in range(12):
        walk = np.cumsum(np.cumsum(rng.standard_normal(len(BASE))))
        walk = 40.0 * (walk - walk.mean()) / walk.std()
        one = problem(noise(rng) + walk)
        ratios.append(max(over_wander(one, SHAPES, r, 2) for r in relaxations))
    assert max(ratios) < 0.0


def test_no_wander_is_at_most_as_likely_as_what_is_in_the_mean() -> None:
    """In white noise a column that is not there explains nothing and costs its unknowns."""
    rng = np.random.default_rng(5)
    ratios = [
        over_wander(problem(rng.standard_normal(len(BASE))), (NoiseModel(),), RELAXED, 2)
        for _ in range(20)
    ]
    # twice (unknowns − one), less what chance explains: chi-square of one degree of freedom
    assert abs(float(np.median(ratios)) + 2.0 - 0.45) < 1.5
