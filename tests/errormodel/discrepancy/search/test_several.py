"""Terms of the equation that are missing at once, and one cause that imitates all of them."""

import numpy as np
import pytest

from errormodel.arrays import FloatArray
from errormodel.discrepancy.nulls import NullDistributions, simulate_nulls
from errormodel.discrepancy.problem import Candidate, Problem, Signature
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Rules
from errormodel.discrepancy.search.several import joint_block, search_all
from errormodel.discrepancy.search.state import SearchTask
from errormodel.discrepancy.search.steps import search
from errormodel.noise.model import NoiseModel, given_noise
from tests.errormodel.discrepancy.examples import LinearSource, problem_of, time_base, waves

BASE = time_base()
FLOOR = given_noise(NoiseModel())
TERMS = {name: waves(BASE, cycles) for name, cycles in (("a", 3.0), ("b", 5.0), ("c", 7.0))}
# each of its columns is nine tenths a term: together 92 % of what the three terms explain
CAUSE = np.column_stack(
    [column + 0.3 * waves(BASE, 11.0 + k) for k, column in enumerate(TERMS.values())]
)
ONE = Rules(most=1)


def problem(residual: FloatArray) -> Problem:
    columns = {**{name: c[:, None] for name, c in TERMS.items()}, "cause": CAUSE}
    return problem_of(BASE, residual, columns, joint=TERMS)


@pytest.fixture(scope="module")
def nulls() -> NullDistributions:
    return simulate_nulls(
        problem(np.zeros(len(BASE))), FLOOR, draws=400, rng=np.random.default_rng(5)
    )


def residual(seed: int, **sizes: float) -> FloatArray:
    every = {**TERMS, "cause": CAUSE.sum(axis=1)}
    noise = np.random.default_rng(seed).standard_normal(len(BASE))
    return noise + sum(size * every[name] for name, size in sizes.items())


def test_three_terms_missing_at_once_are_named_and_not_the_cause_that_imitates_them(nulls) -> None:
    for seed in range(5):
        source = LinearSource(start=problem(residual(seed, a=3.0, b=-2.0, c=2.5)))
        alone = search(SearchTask(source=source, floor=FLOOR, nulls=nulls, rules=ONE))
        assert [s.choice.name for s in alone.slots] == ["cause"]
        found = search_all(SearchTask(source=source, floor=FLOOR, nulls=nulls, rules=ONE))
        assert {s.choice.name for s in found.slots} == {"a", "b", "c"}
        assert all(len(s.alias) == 1 for s in found.slots)
        assert set(found.started) == {c.name for c in found.task.start} == {"a", "b", "c"}


def test_the_cause_keeps_its_name_where_it_is_the_cause(nulls) -> None:
    for seed in range(5):
        source = LinearSource(start=problem(residual(seed, cause=2.0)))
        found = search_all(SearchTask(source=source, floor=FLOOR, nulls=nulls, rules=ONE))
        assert [s.alias for s in found.slots] == [("cause",)]
        assert found.started == ()


def test_where_the_two_explain_alike_no_name_is_bare(nulls) -> None:
    """Without a part of its own the cause explains what the terms do, and costs two names less."""
    same = np.column_stack(list(TERMS.values()))
    start = problem(residual(1, a=3.0, b=-2.0, c=2.5))
    candidates = tuple(
        Candidate(name="cause", signature=lambda theta: Signature(columns=same))
        if c.name == "cause"
        else c
        for c in start.candidates
    )
    made = Problem(
        times=start.times,
        residual=start.residual,
        base=start.base,
        candidates=candidates,
        saturated=start.saturated,
        noise=start.noise,
    )
    rules = Rules(most=1, alias=25.0)
    task = SearchTask(source=LinearSource(start=made), floor=FLOOR, nulls=nulls, rules=rules)
    found = search_all(task)
    assert set(found.slots[0].alias) == {"cause", "a", "b", "c"}


def test_the_block_holds_what_the_data_call_for_and_no_more() -> None:
    view = View(problem(residual(3, a=3.0, c=2.0)), NoiseModel())
    assert [c.name for c in joint_block(view, Rules().further)] == ["a", "c"]
    assert joint_block(View(problem(residual(4)), NoiseModel()), Rules().further) == ()
