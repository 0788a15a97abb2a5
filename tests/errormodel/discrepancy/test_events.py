"""Events beside noise of every kind: where they are put, and which noises stand beside them."""

import numpy as np

from errormodel.discrepancy.events import placed, shapes_allowed
from errormodel.discrepancy.problem import Candidate, Problem, Signature, Theta
from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import NoiseModel, drifting
from tests.errormodel.discrepancy.examples import time_base

BASE = time_base()
HOURS = BASE.elapsed_s / 3600.0
EVERY = 12  # instants between two of the coarse grid


def after(theta: Theta) -> Signature:
    return Signature(columns=(theta[0] <= HOURS).astype(float)[:, None])


def about(theta: Theta) -> tuple[Theta, ...]:
    k = int(np.argmin(np.abs(HOURS - theta[0])))
    return tuple((float(t),) for t in HOURS[max(k - EVERY, 1) : k + EVERY])


def with_step(residual: np.ndarray) -> Problem:
    grid = tuple((float(t),) for t in HOURS[EVERY:-EVERY:EVERY])
    step = Candidate(name="step", signature=after, grid=grid, finer=about, event=True)
    ones = np.ones((len(BASE), 1))
    return Problem(times=BASE, residual=residual, base=ones, candidates=(step,), saturated=ones)


def test_a_step_is_put_at_its_reading_and_not_at_the_next_of_the_grid() -> None:
    rng = np.random.default_rng(21)
    slow = drifting(4.0, 3600.0)
    for at in rng.integers(2 * EVERY, len(BASE) - 2 * EVERY, size=10):
        noise = slow.whitener(BASE).colour(rng.standard_normal(len(BASE)))
        # 15 white sigmas in one reading: a neighbour is 100 times less likely in all but 1e-9
        problem = with_step(noise + 15.0 * (HOURS[at] <= HOURS))
        found = placed(problem, (slow,), problem.candidates[0])
        assert found.theta == (HOURS[at],)


def test_a_noise_without_the_step_stands_beside_the_step() -> None:
    """The floor takes a step for slow noise; the white noise that is there must be allowed."""
    rng = np.random.default_rng(22)
    noise = rng.standard_normal(len(BASE))
    problem = with_step(noise + 3.0 * (HOURS[200] <= HOURS))
    floor = estimate_floor(BASE, problem.residual, problem.saturated)
    assert floor.noise.family != "white"
    shapes = shapes_allowed(problem, floor)
    assert NoiseModel() in shapes
    ratio = placed(problem, shapes, problem.candidates[0]).ratio
    without = placed(problem, [s for _, s in floor.support], problem.candidates[0]).ratio
    # what the allowance is for: the floor's shapes alone see less of the step
    assert ratio > without
