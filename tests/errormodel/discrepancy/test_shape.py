"""A smooth function of one quantity: recovered, priced, and never what the model does already."""

import numpy as np
import pytest

from errormodel.discrepancy.scan import View
from errormodel.discrepancy.shape import best_formula, fit_shape, knots_of
from errormodel.noise.model import NoiseModel
from tests.errormodel.discrepancy.examples import problem_of, time_base

BASE = time_base(runs=3, n=200)
X = np.tile(np.linspace(-40.0, 60.0, 200), 3)
ONE = np.ones(X.size)
SINE = np.sin(2.0 * np.pi * X / 18.0)


def view(signal: np.ndarray, seed: int = 1) -> View:
    rng = np.random.default_rng(seed)
    return View(problem_of(BASE, signal + rng.standard_normal(X.size), {}), NoiseModel())


def test_a_sine_is_found_within_its_own_noise():
    shape = fit_shape(view(3.0 * SINE), X, ONE, knots_of(X))
    assert shape is not None
    error = np.interp(X, shape.knots, shape.values) - 3.0 * SINE
    # k free curves of n samples of unit noise leave sqrt(k/n); the broken line itself 0.1
    assert np.std(error) < 2.0 * np.sqrt(shape.size.size / X.size) + 0.1
    assert shape.size.size < 30


def test_its_chi_square_over_many_seeds_is_that_of_its_curves_when_there_is_nothing():
    scores = []
    for seed in range(200):
        shape = fit_shape(view(0.0 * X, seed), X, ONE, knots_of(X))
        scores.append(0.0 if shape is None else shape.score)
    # a shape of noise alone is not worth a name's price of 30 beyond its curves
    assert max(scores) < 30.0
    assert np.mean(np.array(scores) > 10.0) < 0.02


def test_what_the_model_has_already_is_no_shape():
    problem = problem_of(BASE, 50.0 + 0.0 * X, {})  # a constant, which the baseline holds
    assert fit_shape(View(problem, NoiseModel()), X, ONE, knots_of(X)) is None


def test_a_function_may_be_multiplied():
    times = np.where(np.arange(X.size) % 2 == 0, 1.0, -1.0)
    shape = fit_shape(view(3.0 * SINE * times), X, times, knots_of(X))
    plain = fit_shape(view(3.0 * SINE * times), X, ONE, knots_of(X))
    assert shape is not None
    assert plain is None or plain.evidence < 0.01 * shape.evidence


@pytest.mark.parametrize(
    ("signal", "family", "at"),
    [
        (SINE, "sine", 18.0),
        (np.exp(-(X + 40.0) / 12.0), "exponential", 12.0),
        (np.maximum(X - 20.0, 0.0) / 40.0, "kink", 20.0),
        ((X > 10.0).astype(float), "step", 10.0),
    ],
)
def test_a_short_formula_is_recognised(signal: np.ndarray, family: str, at: float):
    formula = best_formula(view(8.0 * signal), X, ONE)
    assert formula is not None
    assert formula.family == family
    assert abs(formula.at - at) < 0.15 * max(abs(at), 10.0)


def test_knots_are_the_levels_of_what_has_few():
    assert knots_of(np.array([0.0, 90.0, 90.0, 180.0])).tolist() == [0.0, 90.0, 180.0]
