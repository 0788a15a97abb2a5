"""What the runs cannot tell is told, in one sentence that points at it."""

import numpy as np
import pytest

from accelbench.commands.stability.text import (
    coefficient_row,
    headline,
    sigma_limits,
    stability_sentences,
)
from tests.thermo.stability.examples import SIX, one_run, recorded
from thermo.stability.judge import judge_stability
from thermo.stability.limits import CoefficientLimits, LimitsFile


def test_runs_that_share_one_temperature_in_one_direction_have_finite_figures() -> None:
    """Heating shares 20 to 30 °C, cooling 25 °C alone."""
    rng = np.random.default_rng(41)
    ranges = ((25.0, -10.0, 50.0, 25.0), (25.0, 0.0, 40.0, 25.0), (20.0, 60.0, 25.0, 30.0))
    ranges += ((25.0, 30.0, -20.0, 30.0), (25.0, 15.0, 45.0, 20.0))
    frames = [
        one_run(rng, "A", f"r{k}", {"k0": 20.0 * rng.standard_normal()}, span_c=span)
        for k, span in enumerate(ranges)
    ]
    (one,) = judge_stability(recorded(frames), terms=SIX).accelerometers
    assert one.shape is not None
    figures = (one.shape.spread_ug, *one.shape.spread_ci95_ug, one.shape.bend_ug)
    assert np.all(np.isfinite(figures))
    # five runs know 20 µg to 0.6 to 2.9 times itself
    assert one.shape.spread_ci95_ug[0] < 20.0 < one.shape.spread_ci95_ug[1]
    assert 5.0 < one.shape.spread_ug < 60.0


def test_drift_far_slower_than_a_run_is_no_difference_between_runs_or_is_told() -> None:
    """10 µg over 10 h, runs of 4 h that do not differ: 2.5 % of the lower limits lie above 0."""
    wrong = 0
    for seed in range(6):
        rng = np.random.default_rng([42, seed])
        frames = [one_run(rng, "A", f"r{k}", n=120, drift_ug=10.0, tau_h=10.0) for k in range(3)]
        (one,) = judge_stability(recorded(frames), terms=SIX).accelerometers
        k0 = one.coefficient("k0")
        assert k0 is not None
        told = any("so slow cannot be separated from a difference" in note for note in one.notes)
        wrong += k0.scatter.ci95[0] > 0.0 and not told
    assert wrong <= 1  # two of six come by chance in 1 %


def moving(moves: tuple[float, ...], seed: int) -> list[str]:
    rng = np.random.default_rng([43, seed])
    frames = [
        one_run(rng, "A", f"r{k + 1}", {"k0": m}, n=120, drift_ug=1.0) for k, m in enumerate(moves)
    ]
    result = judge_stability(
        recorded(frames, {f"r{k + 1}": k for k in range(len(moves))}), terms=SIX
    )
    (one,) = result.accelerometers
    return [*headline(result), *stability_sentences(one)]


def test_three_runs_that_move_plainly_are_not_said_to_stand_still() -> None:
    told = moving((0.0, 100.0, 195.0), 1)
    (line,) = (t for t in told if "cannot separate a trend" in t)
    assert "k0 drifts by" in line
    assert not any("no coefficient shows a significant trend" in t for t in told)


def test_a_trend_is_in_the_headline_with_its_size() -> None:
    rng = np.random.default_rng(44)
    drifts = tuple(15.0 * k + 3.0 * float(rng.standard_normal()) for k in range(7))
    told = moving(drifts, 2)
    assert "from first to last run" in told[1]
    assert told[1].startswith("  A: k0 drifts by 1")  # 15 µg a day, known to 3/√28 = 0.6


def test_one_sigma_has_one_interval_in_the_headline_and_in_the_table() -> None:
    rng = np.random.default_rng(45)
    frames = [
        one_run(rng, "A", f"r{k}", {"k0": 15.0 * rng.standard_normal()}, n=120) for k in range(4)
    ]
    limits = LimitsFile(limits={"k0": CoefficientLimits(sigma_run=14.0, max_minus_min=60.0)})
    result = judge_stability(recorded(frames), terms=SIX, limits=limits)
    (one,) = result.accelerometers
    k0 = one.coefficient("k0")
    assert k0 is not None
    (criterion,) = (c for c in one.criteria if c.name == "k0 sigma_run")
    assert sigma_limits(one, k0) == criterion.bounds
    low, high = criterion.bounds
    shown = coefficient_row(one, k0)[4]
    assert shown == f"{low:.3g} to {high:.3g}"
    assert any(shown in line for line in headline(result)) or criterion.verdict == "pass"


@pytest.mark.parametrize("runs", [2, 3])
def test_a_sigma_that_the_runs_do_not_show_is_never_told_as_zero(runs: int) -> None:
    rng = np.random.default_rng([46, runs])
    frames = [one_run(rng, "A", f"r{k}", n=120) for k in range(runs)]
    (one,) = judge_stability(recorded(frames), terms=SIX).accelerometers
    for c in one.coefficients:
        shown = coefficient_row(one, c)[3]
        assert shown.startswith("< ") or float(shown) > 0.0
        assert c.scatter.ci95[1] > 0.0


def test_runs_without_temperature_are_compared_at_one_temperature() -> None:
    """A log of outputs alone: K0, K1 and the Allan deviation of the holds are there."""
    rng = np.random.default_rng(46)
    moves = (0.0, 60.0, -45.0)
    still = (25.0, 25.001)
    frames = [
        one_run(rng, "A", f"r{k}", {"k0": m}, n=120, drift_ug=0.0, span_c=still).assign(
            temp_c=np.nan
        )
        for k, m in enumerate(moves)
    ]
    (one,) = judge_stability(recorded(frames)).accelerometers
    k0 = one.coefficient("k0")
    assert k0 is not None
    assert k0.scatter.sigma_runs_observed == pytest.approx(np.std(moves, ddof=1), rel=0.1)
    assert one.coefficient("k0_t1") is None
    assert one.allan.tau_s.size > 0
