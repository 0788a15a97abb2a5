"""The stop rule over many newly assembled accelerometers: right, and in time."""

import numpy as np
import pytest

from tests.thermo.run_in_examples import Law, Stopped, assembled, hyperbolic, run_in, stretched


def campaign(law: Law, seeds: int) -> list[Stopped]:
    return [run_in(law, seed) for seed in range(seeds)]


def times_smaller(stopped: list[Stopped]) -> float:
    """Instability between runs before over after, pooled over the accelerometers."""
    before, after = (np.array([getattr(s, n) for s in stopped]) for n in ("before", "after"))
    return float(np.sqrt(np.mean(before**2) / np.mean(after**2)))


def test_a_few_accelerometers_are_stopped_rightly_and_in_time() -> None:
    stopped = campaign(assembled, 6)
    # each is wrong with a risk of 5 % at most: two or more of six by chance in 3 %
    assert sum(s.right for s in stopped) >= 5
    assert np.median([s.late for s in stopped]) <= 3  # the median of six moves by one
    assert times_smaller(stopped) > 5


@pytest.mark.slow
def test_a_hundred_accelerometers_are_stopped_rightly_and_in_time() -> None:
    stopped = campaign(assembled, 100)
    assert sum(s.right for s in stopped) >= 95
    assert np.median([s.late for s in stopped]) <= 2
    assert times_smaller(stopped) > 5
    assert np.median([s.before / s.after for s in stopped]) > 5


def test_under_another_law_the_rule_stays_right() -> None:
    assert run_in(stretched, 0).right


@pytest.mark.slow
@pytest.mark.parametrize("law", [stretched, hyperbolic])
def test_under_another_law_the_rule_stays_right_but_is_late(law: Law) -> None:
    stopped = campaign(law, 30)
    # 28.5 expected at the risk stated, and 25 or fewer by chance in 1.6 %
    assert sum(s.right for s in stopped) >= 26
    assert np.median([s.late for s in stopped]) <= 15
