"""Run-to-run stability of simulated accelerometers, judged by what was put in."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest

from errormodel.errors import InputError
from tests.thermo.examples import NOMINAL, TRUTH, simulate_run
from thermo.fitting.fit import TermsFile
from thermo.recording.files import RecordedRuns, make_runs
from thermo.stability.judge import Stability, judge_stability
from thermo.stability.limits import (
    Between,
    Criterion,
    LimitsFile,
    intervals_between_runs,
    verdict_of,
)

TERMS = TermsFile(terms=("k1", "k0", "k0_t1", "k0_t2", "k0_t3", "k1_t1", "k1_t2", "k2", "delta_o"))
PLAIN = {**TRUTH, "k3": 0.0, "k_ip": 0.0}


def batch(
    seed: int,
    sigmas_ug: dict[str, float],
    runs: int = 5,
    *,
    k1_ppm: float = 0.0,
    loop_ug: float = 0.0,
    steps_ug: float = 0.0,
    n: int = 360,
    started: bool = False,
    **kw: float,
) -> RecordedRuns:
    """Runs of accelerometers whose K0 differs from run to run by a sigma each."""
    rng = np.random.default_rng(seed)
    frames: list[pd.DataFrame] = []
    for serial, sigma_ug in sigmas_ug.items():
        for r in range(runs):
            truth = dict(PLAIN)
            truth["k0"] += sigma_ug * rng.standard_normal() + steps_ug * r
            truth["k1"] *= 1.0 + 1e-6 * k1_ppm * rng.standard_normal()
            frames.append(
                simulate_run(
                    rng, serial=serial, run=f"r{r}", truth=truth, n=n, period_s=40.0,
                    loop_ug=loop_ug, **kw,  # type: ignore[arg-type]
                )
            )  # fmt: skip
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    starts = {f"r{r}": begin + timedelta(days=runs - r) for r in range(runs)} if started else {}
    return make_runs(
        pd.concat(frames), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL,
        run_start_utc=starts,
    )  # fmt: skip


@pytest.fixture(scope="module")
def unsteady() -> Stability:
    limits = LimitsFile.model_validate(
        {
            "limits": {"k0": {"sigma_run": 10.0, "max_minus_min": 100.0}},
            "curve_ug": {"max": 120.0},
            "grades": {"A": {"spread_ug": 10.0}, "B": {"spread_ug": 100.0}},
        }
    )
    runs = batch(1, {"good": 0.0, "bad": 40.0}, 6, k1_ppm=8.0)
    return judge_stability(runs, terms=TERMS, at_c=(25.0, 60.0), limits=limits)


def test_planted_scatter_is_found_and_judged(unsteady: Stability) -> None:
    good, bad = unsteady.accelerometers
    for one, sigma_ug in ((good, 0.0), (bad, 40.0)):
        k0, k1 = one.coefficient("k0"), one.coefficient("k1")
        assert k0 is not None
        assert k1 is not None
        assert k0.scatter.ci95[0] <= sigma_ug <= k0.scatter.ci95[1]
        assert k1.scatter.ci95[0] <= 8.0 <= k1.scatter.ci95[1]
        # 2 sigma for the mean of the runs about the truth: seeds are fixed
        assert k0.scatter.mean == pytest.approx(PLAIN["k0"], abs=3 * k0.scatter.mean_sigma)
        assert one.shape is not None
    assert (good.verdict, bad.verdict) == ("pass", "fail")
    assert (good.grade, bad.grade) == ("A", "B")
    assert (good.rank, bad.rank) == (1, 2)
    assert unsteady.failed
    assert not good.trends


def test_coefficients_at_other_temperatures_follow_the_polynomial(unsteady: Stability) -> None:
    good = unsteady.accelerometers[0]
    at, k1_at = good.coefficient("k0_at_60c"), good.coefficient("k1_at_60c")
    assert at is not None
    assert k1_at is not None
    expected = sum(PLAIN.get(f"k0_t{k}", 0.0) * 35.0**k for k in range(1, 4)) + PLAIN["k0"]
    assert at.scatter.mean == pytest.approx(expected, abs=4 * at.scatter.mean_sigma)
    ratio = PLAIN["k1"] / NOMINAL * (1 + 1e-6 * (80.7 * 35 + 0.309 * 35**2))
    assert k1_at.scatter.mean == pytest.approx(1e6 * (ratio - 1), abs=4 * k1_at.scatter.mean_sigma)


def test_curves_lie_as_far_apart_as_the_biases(unsteady: Stability) -> None:
    good, bad = unsteady.accelerometers
    assert good.k0_distance is not None
    assert bad.k0_distance is not None
    assert good.k0_distance.largest_bounds(0.05)[0] == 0.0
    k0 = bad.coefficient("k0")
    assert k0 is not None
    spread = k0.scatter.max_minus_min
    lo, hi = bad.k0_distance.largest_bounds(0.05)
    assert lo < spread < hi
    assert bad.k0_distance.rms == pytest.approx(np.sqrt(2) * np.std(k0.values, ddof=1), rel=0.2)


def test_components_say_where_the_variance_lies(unsteady: Stability) -> None:
    found = unsteady.components
    assert found is not None
    # both accelerometers: the mean square of their run sigmas, 0 and 40 µg
    lo, hi = found.of("run").ci95
    assert lo < np.sqrt((0.0 + 40.0**2) / 2) < hi
    assert found.of("run").dof == 10
    assert found.of("position").sigma < 3.0


def test_what_repeats_is_no_scatter() -> None:
    """A loop of 40 µg that no polynomial holds, the same in all runs, moves no coefficient."""
    runs = batch(3, {"A": 0.0}, 5, loop_ug=20.0, drift_ug=0.0)
    (one,) = judge_stability(runs, terms=TERMS).accelerometers
    k0 = one.coefficient("k0")
    assert k0 is not None
    assert k0.scatter.sigma_estimation < 2.0  # 5 µg of white noise in 360 readings give 0.5
    assert k0.scatter.ci95[0] == 0.0
    assert one.shape is not None
    assert one.shape.spread_ug > 10.0  # yet the curves of heating and cooling lie apart


def test_a_creeping_bias_is_a_trend_in_the_order_of_time() -> None:
    # the file holds the last run first: by its start the bias falls, by its place it would rise
    runs = batch(4, {"A": 1.0}, 6, steps_ug=30.0, started=True, drift_ug=0.0)
    result = judge_stability(runs, terms=TERMS)
    assert result.order == ("r5", "r4", "r3", "r2", "r1", "r0")
    (one,) = result.accelerometers
    k0 = one.coefficient("k0")
    assert k0 is not None
    assert k0.scatter.trend_per_run == pytest.approx(-30.0, abs=3.0)
    assert "k0" in one.trends
    assert result.intervals[0].rest_h == pytest.approx(24.0 - 359 * 40.0 / 3600, abs=1e-6)


def test_a_run_at_one_temperature_gives_what_it_can() -> None:
    runs = batch(5, {"A": 5.0}, 3)
    still = simulate_run(np.random.default_rng(6), serial="A", run="still", n=200, truth=PLAIN)
    still["temp_c"] = 25.0 + 0.002 * np.random.default_rng(7).standard_normal(200)
    th = np.deg2rad(still["position_deg"])
    noise = 5e-6 * np.random.default_rng(8).standard_normal(200)
    a_i, a_p = np.sin(th), np.cos(th)
    error = 1e-6 * (PLAIN["k0"] + PLAIN["k2"] * a_i**2 + PLAIN["delta_o"] * a_p) + noise
    still["output"] = PLAIN["k1"] * (a_i + error)
    frame = pd.DataFrame(
        {
            "run": runs.run.text(),
            "serial": runs.serial.text(),
            "time_s": runs.time_s,
            "temp_c": runs.temp_c,
            "position_deg": runs.position_deg,
            "output": runs.output,
        }
    )
    joined = make_runs(
        pd.concat([frame, still]), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL
    )
    (one,) = judge_stability(joined, terms=TERMS).accelerometers
    k0, k0_t2 = one.coefficient("k0"), one.coefficient("k0_t2")
    assert k0 is not None
    assert k0_t2 is not None
    assert k0.run_ids == ("r0", "r1", "r2", "still")
    assert k0_t2.run_ids == ("r0", "r1", "r2")
    assert k0.values[3] == pytest.approx(PLAIN["k0"], abs=4 * k0.sigmas[3])
    assert any("run still cannot determine" in n and "k0_t2" in n for n in one.notes)


def test_holds_have_an_allan_deviation() -> None:
    rng = np.random.default_rng(9)
    # the first and last twentieth of a simulated run are holds: 2 × 2 × 60 readings of 5 µg
    frames = [simulate_run(rng, run=f"r{k}", n=1200, truth=PLAIN, drift_ug=0.0) for k in range(2)]
    runs = make_runs(
        pd.concat(frames), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL
    )
    (one,) = judge_stability(runs, terms=TERMS).accelerometers
    terms = one.allan.terms[0]
    assert terms > 180
    assert one.allan.tau_s[0] == pytest.approx(12.0)
    # white noise has its own sigma at the sampling interval, here to 4 sigma of so many squares
    assert one.allan.deviation[0] == pytest.approx(5.0, rel=4 / np.sqrt(terms))


def test_refusals_name_what_is_wrong() -> None:
    runs = batch(10, {"A": 1.0}, 2)
    one_run = runs.select(runs=["r0"])
    with pytest.raises(InputError, match=r"serial A.*two or more"):
        judge_stability(one_run, terms=TERMS)
    strange = LimitsFile.model_validate({"limits": {"k9": {"sigma_run": 1.0}}})
    with pytest.raises(InputError, match=r"limits\.k9.*do not give it"):
        judge_stability(runs, terms=TERMS, limits=strange)
    between = LimitsFile(between=(Between(after="r7"),))
    with pytest.raises(InputError, match="no run 'r7'"):
        judge_stability(runs, terms=TERMS, limits=between)


def test_a_verdict_needs_the_bounds_on_one_side() -> None:
    def criterion(lo: float, hi: float) -> Criterion:
        return Criterion(name="k0 sigma_run", value=5.0, bounds=(lo, hi), limit=10.0, unit="µg")

    assert [criterion(*b).verdict for b in ((11, 20), (2, 9), (2, 20))] == [
        "fail",
        "pass",
        "undecided",
    ]
    assert verdict_of([criterion(2, 9), criterion(2, 20)]) == "undecided"
    assert verdict_of([criterion(2, 9), criterion(11, 20), criterion(2, 20)]) == "fail"
    assert verdict_of([]) == "not judged"


def test_what_was_stated_of_the_time_between_goes_before_what_the_clock_says() -> None:
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    starts = {"a": begin, "b": begin + timedelta(hours=10), "c": begin + timedelta(hours=30)}
    said = (Between(after="a", before="b", power_off=True, rest_h=3.0, note="moved"),)
    first, second = intervals_between_runs(
        ("a", "b", "c"), said, starts, {"a": 3600.0, "b": 7200.0, "c": 1.0}
    )
    assert first.facts == "power off yes, rest 3 h, remounted not stated; moved"
    assert second.rest_h == pytest.approx(18.0)
    with pytest.raises(InputError, match="is followed by 'b'"):
        intervals_between_runs(("a", "b"), (Between(after="a", before="c"),), {}, {})


def coverage(runs: int, sets: int) -> dict[str, float]:
    """Return how often the limits of K0's and K1's sigma hold what was put into readings."""
    held = {"k0": 0, "k1": 0}
    for seed in range(sets):
        record = batch(1000 * runs + seed, {"A": 20.0}, runs, k1_ppm=8.0)
        (one,) = judge_stability(record, terms=TERMS).accelerometers
        for name, truth in (("k0", 20.0), ("k1", 8.0)):
            found = one.coefficient(name)
            assert found is not None
            held[name] += found.scatter.ci95[0] <= truth <= found.scatter.ci95[1]
    return {name: count / sets for name, count in held.items()}


# two coefficients a set: at 95 % each, fewer than 4 of 6 come once in 450 times and fewer than 12
# of 16 once in 10⁴ times
@pytest.mark.parametrize(("sets", "least"), [(3, 4), pytest.param(8, 12, marks=pytest.mark.slow)])
def test_limits_from_readings_hold_the_truth_a_few_sets(sets: int, least: int) -> None:
    assert sets * sum(coverage(3, sets).values()) >= least


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("runs", [3, 5, 10])
def test_limits_from_readings_hold_the_truth_in_95_percent(runs: int) -> None:
    found = coverage(runs, 500)
    assert all(0.92 <= share <= 0.98 for share in found.values()), found
