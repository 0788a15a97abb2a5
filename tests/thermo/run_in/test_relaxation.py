"""The inference of a relaxing coefficient, judged on coefficients drawn as it assumes."""

import numpy as np
import pytest

from tests.thermo.run_in.examples import LIMIT, assembled, series_of
from thermo.run_in.judge import judge_run_in, run_spread
from thermo.run_in.relaxation import CoefficientSeries, cycles_needed, weigh
from thermo.run_in.rivals import HORIZON, NOT_SLOW, SLOW, SLOW_ODDS


def test_cycles_needed_by_hand() -> None:
    path = np.array([[0.0, 3.0, 5.0, 5.5, 5.2], [0.0, 0.5, -0.9, 0.0, 0.0], [0, 5, 0, 0, 0]])
    assert cycles_needed(path, 1.0).tolist() == [2, 0, 2]


def drawn(rng: np.random.Generator, n: int) -> tuple[np.ndarray, float, float]:
    """A path in limits, of κ, kicks and size within the priors, and its standard deviations."""
    kappa, kick = np.exp(rng.uniform(np.log(1.0), np.log(5.0))), np.exp(rng.uniform(-2.0, 1.0))
    left = np.exp(-np.arange(n) / kappa)
    kicks = np.where(np.arange(n) > 0, kick * left * rng.standard_normal(n), 0.0)
    return 12 * rng.standard_normal() * left + np.cumsum(kicks), kappa, np.exp(rng.uniform(-3, -1))


def test_what_is_still_to_come_is_where_it_was_said_to_be() -> None:
    """A 90 % interval holds 90 % of 120 cases: 108 ± 3.3; four sigmas are allowed."""
    rng = np.random.default_rng(3)
    inside, needed_inside, seeds = 0, 0, 120
    for _ in range(seeds):
        path, _, scatter = drawn(rng, 8 + HORIZON)
        sigma = 0.15
        values = path[:8] + np.hypot(sigma, scatter) * rng.standard_normal(8)
        series = CoefficientSeries(
            name="k0", unit="", values=values, sigmas=np.full(8, sigma), limit=1.0
        )
        (found,) = weigh([series], "exponential").draw(1000, rng)
        low, high = np.quantile(found.future[:, -1], [0.05, 0.95])
        inside += bool(low <= path[-1] - path[7] <= high)
        low, high = np.quantile(found.needed, [0.05, 0.95])
        needed_inside += bool(low <= cycles_needed(path[None, 7:], 1.0)[0] <= high)
    allowed = 4 * np.sqrt(seeds * 0.9 * 0.1)
    assert abs(inside - 0.9 * seeds) < allowed
    assert needed_inside > 0.9 * seeds - allowed  # of whole numbers it holds more


def test_kappa_of_a_quiet_relaxation_is_found() -> None:
    values = 300 * np.exp(-np.arange(12) / 2.5)
    series = CoefficientSeries(
        name="k0", unit="µg", values=values, sigmas=np.full(12, 0.5), limit=15.0
    )
    verdict = judge_run_in("A", [series])
    (found,) = verdict.coefficients
    # the grid of κ has a step of 15 %, its half is 8 %
    assert found.kappa[0] == pytest.approx(2.5, rel=0.08)
    assert found.remaining[0] == pytest.approx(-values[-1], abs=3 * found.remaining[1])
    assert verdict.settled
    assert verdict.law == "exponential"
    assert verdict.cycles_needed == (0, 0)


def test_a_slow_law_is_recognised() -> None:
    values = 300 / (1 + np.arange(15) / 2)
    series = CoefficientSeries(
        name="k0", unit="µg", values=values, sigmas=np.full(15, 1.0), limit=15.0
    )
    verdict = judge_run_in("A", [series])
    assert verdict.law == "hyperbolic"
    assert not verdict.settled  # 300/8.5 = 35 µg are still to come


def test_noise_as_large_as_the_limit_settles_nothing_soon() -> None:
    """A constant seen through noise of the limit's size: five cycles cannot tell."""
    rng = np.random.default_rng(1)
    values = LIMIT * rng.standard_normal(5)
    series = CoefficientSeries(
        name="k0", unit="", values=values, sigmas=np.full(5, LIMIT), limit=LIMIT
    )
    verdict = judge_run_in("A", [series])
    assert not verdict.settled
    assert verdict.cycles_needed[1] is None or verdict.cycles_needed[1] > 3


@pytest.mark.parametrize("creep", [0.0, 0.1, 0.2])
def test_the_odds_of_slow_processes_are_those_of_how_often_they_are_drawn(creep: float) -> None:
    rng = np.random.default_rng(5)
    values = creep * np.arange(12) + 0.15 * rng.standard_normal(12)
    series = CoefficientSeries(
        name="k0", unit="", values=values, sigmas=np.full(12, 0.15), limit=1.0
    )
    found = weigh([series], "exponential")
    share = {"a second relaxation": SLOW / 2, "a creep": SLOW / 2}
    share["a random walk"] = 1.0 - NOT_SLOW - SLOW
    rivals = found.slow_rivals(10, rng, 1e-12)
    slow = sum(share[r.name] * r.odds / SLOW_ODDS for r in rivals)
    (draws,) = found.draw(4000, rng)
    # a share of 4000 draws is known to 0.8 % (1 sigma)
    assert 1.0 - np.mean(draws.plain) == pytest.approx(slow, abs=0.03)


def test_a_walk_in_one_coefficient_alone_is_not_called_settled() -> None:
    """Steps as large as an estimate's sigma: 20 cycles show them, in K0 alone."""
    rng = np.random.default_rng(8)
    truth = np.vstack([np.cumsum(4.0 * rng.standard_normal(90)), np.zeros(90)])
    verdict = judge_run_in("S", [s.first(20) for s in series_of(truth, rng)])
    assert not verdict.settled
    assert "a random walk" in verdict.not_excluded


def test_a_stop_tells_what_could_go_on_unseen_and_how_large() -> None:
    series = series_of(np.zeros((2, 90)), np.random.default_rng(1))
    early, late = (judge_run_in("S", [s.first(n) for s in series]) for n in (10, 20))
    assert early.settled
    told = {u.process: u.change for u in early.unseen}
    # a slope is known to 2·√(12/10³) µg a cycle: ±26 µg in 60 of them, at 95 %
    assert 15.0 < told["a creep"] < 60.0
    assert f"a creep of K{early.unseen[0].coefficient[1]} by up to" in early.sentence
    assert {u.process: u.change for u in late.unseen}.get("a creep", 0.0) < told["a creep"]


def test_the_same_estimates_give_the_same_verdict_and_order_of_units_does_not_matter() -> None:
    series = [s.first(9) for s in series_of(assembled(1), np.random.default_rng(1))]
    one, same = judge_run_in("A", series), judge_run_in("A", series)
    assert one.settled_probability == same.settled_probability
    thousandth = [
        CoefficientSeries(
            name=s.name, unit="mg", values=s.values / 1e3, sigmas=s.sigmas / 1e3, limit=LIMIT / 1e3
        )
        for s in series
    ]
    scaled = judge_run_in("A", thousandth)
    assert scaled.cycles_needed == one.cycles_needed
    # the draws are the same but for rounding
    assert scaled.settled_probability == pytest.approx(one.settled_probability, abs=0.005)


def test_the_limits_of_an_instability_hold_for_few_runs() -> None:
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(1000):
        low, high = run_spread(rng.standard_normal(4)).ci95
        inside += low <= 1.0 <= high
    assert abs(inside - 950) < 4 * np.sqrt(1000 * 0.95 * 0.05)


@pytest.mark.parametrize(
    ("values", "limit"), [([1.0, 2.0], 1.0), ([1.0, np.nan, 2.0], 1.0), ([1.0, 2.0, 3.0], 0.0)]
)
def test_a_series_that_says_nothing_is_refused(values: list[float], limit: float) -> None:
    with pytest.raises(ValueError, match="k0"):
        CoefficientSeries(
            name="k0", unit="µg", values=np.array(values), sigmas=np.ones(len(values)), limit=limit
        )
