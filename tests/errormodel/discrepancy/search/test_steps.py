"""The engine on a problem that is linear in everything, noise known: what a filter will hand it."""

from dataclasses import fields

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.discrepancy.foresight import foresee_candidates
from errormodel.discrepancy.gate import judge
from errormodel.discrepancy.nulls import NullDistributions, simulate_nulls
from errormodel.discrepancy.scan import Prepared, View
from errormodel.discrepancy.search.choices import Rules
from errormodel.discrepancy.search.state import SearchState, SearchTask
from errormodel.discrepancy.search.steps import CLOSE, ROUND, search
from errormodel.noise.model import NoiseModel, given_noise
from tests.errormodel.discrepancy.examples import LinearSource, linear_problem, time_base, waves

BASE = time_base()
FLOOR = given_noise(NoiseModel())
RULES = Rules()


@pytest.fixture(scope="module")
def nulls() -> NullDistributions:
    problem = linear_problem(np.zeros(len(BASE)), BASE)
    return simulate_nulls(problem, FLOOR, draws=400, rng=np.random.default_rng(5))


def searched(residual: np.ndarray, nulls: NullDistributions) -> tuple[str, SearchState]:
    source = LinearSource(start=linear_problem(residual, BASE))
    result = search(SearchTask(source=source, floor=FLOOR, nulls=nulls, rules=RULES))
    return judge(
        result.view(result.found), result, nulls, RULES, too_much_drift=False
    ).verdict, result


def test_the_gain_is_what_least_squares_says() -> None:
    residual = np.random.default_rng(1).standard_normal(len(BASE)) + 0.3 * waves(BASE, 3.0)
    problem = linear_problem(residual, BASE)
    view = View(problem, NoiseModel())
    found = {f.candidate.name: f.gain for f in Prepared(view, problem.candidates).scan()}
    wave = waves(BASE, 3.0)[:, None]
    without = np.linalg.lstsq(problem.base, residual)[1][0]
    with_it = np.linalg.lstsq(np.hstack([problem.base, wave]), residual)[1][0]
    assert_allclose(found["wave"], without - with_it, rtol=1e-9)
    assert_allclose(found["same"], found["wave"], rtol=1e-9)
    assert found["lost"] == 0.0


def test_what_cannot_be_seen_and_what_cannot_be_told_apart_is_said_beforehand() -> None:
    problem = linear_problem(np.zeros(len(BASE)), BASE)
    foresight = foresee_candidates(View(problem, NoiseModel()), problem.candidates)
    assert foresight.invisible == ("lost",)
    assert foresight.partners("wave") == ("same",)
    # the third harmonic of a square wave has the amplitude 4/3π: its share of the power
    i, j = foresight.names.index("square"), foresight.names.index("wave")
    assert_allclose(foresight.imitated[i, j], (4 / (3 * np.pi)) ** 2 / 2, rtol=0.02)
    assert_allclose(foresight.imitated[i, j], foresight.imitated[j, i], rtol=1e-9)
    # strength: the length of a sine beside its mean is sqrt(n/2)
    assert_allclose(foresight.strength[j], np.sqrt(len(BASE) / 2), rtol=0.01)


def test_an_effect_with_a_twin_is_told_as_an_alias_set(nulls: NullDistributions) -> None:
    rng = np.random.default_rng(7)
    for _ in range(10):
        residual = rng.standard_normal(len(BASE)) + 1.0 * waves(BASE, 3.0)  # d = 13
        verdict, result = searched(residual, nulls)
        assert verdict == "alias"
        assert set(result.slots[0].alias) == {"wave", "same"}


def test_an_effect_without_a_twin_is_named(nulls: NullDistributions) -> None:
    rng = np.random.default_rng(8)
    for _ in range(10):
        residual = rng.standard_normal(len(BASE)) - 0.7 * np.sign(waves(BASE, 1.0))  # d = 13
        verdict, result = searched(residual, nulls)
        assert verdict == "named"
        assert result.slots[0].choice.name == "square"
        assert abs(np.sqrt(result.slots[0].gain) - 13.3) < 4.0  # its own sigma is 1


def test_nothing_is_found_in_noise_more_often_than_said(nulls: NullDistributions) -> None:
    rng = np.random.default_rng(9)
    verdicts = [searched(rng.standard_normal(len(BASE)), nulls)[0] for _ in range(150)]
    # alpha of the library and of what is left: 0.5 % together, 0.75 of 150; P(>4) 0.1 %
    assert sum(v != "nothing" for v in verdicts) <= 4


def test_what_repeats_but_has_no_name_is_told_as_such(nulls: NullDistributions) -> None:
    rng = np.random.default_rng(10)
    for _ in range(10):
        residual = rng.standard_normal(len(BASE)) + 1.2 * waves(BASE, 5.0)
        assert searched(residual, nulls)[0] == "unexplained_repeatable"


def test_p_values_are_uniform_where_nothing_is_missing(nulls: NullDistributions) -> None:
    rng = np.random.default_rng(11)
    problem = linear_problem(np.zeros(len(BASE)), BASE)
    view = View(problem, NoiseModel())
    prepared = Prepared(view, problem.candidates)
    gains = prepared.null_gains(rng.standard_normal((len(BASE), 4000)))
    p = nulls.gains["square"].p_values(gains[2])
    # the distribution itself comes from 400 draws: two sigmas of its
    # quantile are 2 % at 5 %, 0.8 % at 1 %
    assert abs(np.mean(p < 0.05) - 0.05) < 0.022
    assert abs(np.mean(p < 0.01) - 0.01) < 0.009


def test_the_null_distributions_do_not_depend_on_how_many_work_at_them() -> None:
    problem = linear_problem(np.zeros(len(BASE)), BASE)
    one, two = (
        simulate_nulls(problem, FLOOR, draws=120, rng=np.random.default_rng(5), workers=n)
        for n in (1, 2)
    )
    for name, one_null in one.gains.items():
        np.testing.assert_array_equal(one_null.draws, two.gains[name].draws)
    for name, one_null in one.factors.items():
        np.testing.assert_array_equal(one_null.draws, two.factors[name].draws)


def test_every_threshold_belongs_to_a_step_or_to_the_judgement() -> None:
    applied = {t for step in (*ROUND, *CLOSE) for t in step.thresholds}
    judged = {"share", "alpha_rest", "over_wander"}  # applied by `judge`
    assert applied | judged | {"most"} == {f.name for f in fields(Rules)}
