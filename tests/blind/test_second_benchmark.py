"""The second benchmark's truths are what their keys say, and its answers are scored as agreed."""

import json
import logging
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from accelbench import read_runs
from benchmarks.blind.second import library, outside
from benchmarks.blind.second import run as asking
from benchmarks.blind.second.campaign import draw_protocol, make_campaign
from benchmarks.blind.second.files import write_set
from benchmarks.blind.second.noise import FLICKER_TAUS_S, Noise, draw_readings, whiten
from benchmarks.blind.second.outcome import cases_of, factor_of
from benchmarks.blind.second.plan import group_of, name_of, seeds_of
from benchmarks.blind.second.score import report
from benchmarks.blind.second.truth import make_truth

# small ones: nothing, an effect of the library, two, one outside with and without another
FEW = (34, 11, 7, 20, 22, 61)
NOT_USED = "columns not used: supply_v"


def campaign(seed: int = 1, **fixed: object):
    rng = np.random.default_rng(seed)
    return make_campaign(draw_protocol(rng, **fixed), rng)


def covariance(noise: Noise, hours: np.ndarray, run: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Of the readings, written down entry by entry instead of filtered."""
    apart_s = 3600 * np.abs(hours[:, None] - hours)
    cov = np.diag(sigma**2)
    if noise.flicker_ug:
        cov += sum(noise.flicker_ug**2 * np.exp(-apart_s / tau) for tau in FLICKER_TAUS_S)
    begun = hours[0]
    if noise.walk_ug_per_rt_h and not noise.walk_goes_on:
        begun = hours[np.searchsorted(run, run)]
        cov += (
            noise.walk_ug_per_rt_h**2
            * np.minimum((hours - begun)[:, None], hours - begun)
            * (run[:, None] == run)
        )
    elif noise.walk_ug_per_rt_h:
        cov += noise.walk_ug_per_rt_h**2 * np.minimum((hours - begun)[:, None], hours - begun)
    return cov


def test_ten_rounds_of_seeds_hold_what_the_acceptance_asks_for() -> None:
    groups = Counter(map(group_of, range(310)))
    assert groups == {"nulls": 60, "library": 120, "pairs": 30, "outside": 100}
    names = Counter(name_of(s)[0] for s in range(310) if group_of(s) == "library")
    assert set(names) == set(library.NAMES)
    assert min(names.values()) >= 7
    strangers = [name_of(s) for s in seeds_of("outside", 0, 310)]
    kinds = Counter(kind for kind, _ in strangers)
    assert set(kinds) == set(outside.KINDS)
    assert len(kinds) >= 12
    assert min(kinds.values()) >= 4
    assert 48 <= sum(beside for _, beside in strangers) <= 52


def test_names_of_the_library_are_those_of_the_reference() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/terms.md").read_text(encoding="utf-8")
    table = page.partition("<!-- table: effects -->")[2].partition("<!-- end -->")[0]
    named = {line.split("`")[1] for line in table.splitlines() if line.startswith("| `")}
    assert set(library.NAMES) <= named
    # a kind that the library has gained since counts as told by its own name
    assert all(outside.KINDS[kind].names for kind in named & set(outside.KINDS))


@pytest.mark.parametrize("seed", FEW)
def test_files_are_read_without_complaint_and_are_the_same_again(
    seed: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        key = write_set(seed, tmp_path / "set", tmp_path / "key")
        runs = read_runs([tmp_path / "set/run.csv"])
    told = [r.getMessage() for r in caplog.records]
    # single readings may be held for spoiled, as in any record, and must be few
    assert [m for m in told if NOT_USED not in m and "left out as" not in m] == []
    left_out = sum(map(int, re.findall(r"(\d+) readings left out", " ".join(told))))
    assert left_out <= 0.03 * len(runs.time_s)
    unseen = read_runs([tmp_path / "key/unseen.csv"], checked=False)
    assert len(unseen.serials) == 1
    assert len(runs.serials) == len(key["accelerometers"])
    again = write_set(seed, tmp_path / "set2", tmp_path / "key2")
    assert again == key
    for name in ("set/run.csv", "set/run.toml", "key/unseen.csv", "key/key.json"):
        folder, file = name.split("/")
        assert (tmp_path / name).read_bytes() == (tmp_path / f"{folder}2/{file}").read_bytes()


@pytest.mark.parametrize("seed", [11, 7, 22])
def test_strength_is_that_of_generalised_least_squares(seed: int) -> None:
    truth = make_truth(seed)
    c, kept = truth.campaign, truth.kept
    sigma = np.sqrt(
        truth.noise.white_ug**2
        + truth.noise.count_ug**2 / 12
        + (truth.accelerometer.slope_ug_per_c(c) * truth.noise.thermistor_c) ** 2
    )
    cov = covariance(truth.noise, c["elapsed_h"][kept], c.run[kept], sigma[kept])
    columns = np.column_stack([truth.accelerometer.columns(c)[kept], truth.hidden[0].column[kept]])
    information = columns.T @ np.linalg.solve(cov, columns)
    # the variance of the effect's own amplitude, which is 1 here
    d = 1 / np.sqrt(np.linalg.inv(information)[-1, -1])
    assert truth.hidden[0].d == pytest.approx(d, rel=1e-6)


def test_strengths_are_within_what_the_plan_says() -> None:
    for seed in FEW:
        for h in make_truth(seed).hidden:
            assert (20 if h.outside else 4.9) <= h.d <= 201  # a lag's size is interpolated
            assert h.d_beside <= h.d * (1 + 1e-9)


@pytest.mark.parametrize(
    "slow",
    [
        {"flicker_ug": 1.0},
        {"walk_ug_per_rt_h": 1.5},
        {"walk_ug_per_rt_h": 1.5, "walk_goes_on": True},
        {"heavy_tails": True},
    ],
)
def test_noise_that_is_drawn_is_white_once_whitened(slow: dict[str, Any]) -> None:
    c = campaign(runs=3, style="ramp", interval_s=60.0)
    noise = Noise(white_ug=3.0, count_ug=0.0, **slow)
    rng = np.random.default_rng(7)
    drawn = np.column_stack([sum(draw_readings(noise, c["elapsed_h"], c.run, rng)) for _ in "abc"])
    white = whiten(noise, np.full(len(c.run), 3.0), c["elapsed_h"], c.run, drawn)
    n = white.size
    together = (white[1:] * white[:-1]).sum() / np.sqrt(n)
    assert abs(together) < 4
    if not slow.get("heavy_tails"):  # the square of a Student t of 3 has no variance
        assert stats.chi2.cdf((white**2).sum(), n) == pytest.approx(0.5, abs=0.4999)


def test_a_lag_on_an_even_ramp_is_rate_times_time_constant() -> None:
    c = campaign(style="ramp", runs=2, ripple_c=0.0, span="full", low_c=-40.0, high_c=70.0)
    even = (c["since_ramp_s"] > 5400) & (np.abs(c["rate"]) > 0.5)
    assert even.sum() > 20 or c.protocol.rates_c_per_min[0] > 1.2
    behind = (c.x - library.inner_x(c, 40.0))[even]
    np.testing.assert_allclose(behind, c["rate"][even] * 40 / 60, atol=0.02)


def test_a_loop_closes_on_plus_and_minus_one() -> None:
    c = campaign(style="ramp", runs=2, ripple_c=0.0)
    z = library.loop(c, 5.0, memory=False)
    assert -1 <= z.min() < -0.9
    assert 0.9 < z.max() <= 1


def test_air_minus_case_holds_a_ripple_that_the_rate_does_not() -> None:
    c = campaign(style="ramp", runs=2, ripple_c=2.5)
    flow = c["chamber_c"] - c["temp_c"]
    left = flow - np.polyval(np.polyfit(c["rate"], flow, 1), c["rate"])
    # the ripple's own rms is 2.5/sqrt(2); the rate follows less than half of it
    assert left.std() > 0.5 * 2.5 / np.sqrt(2)


def test_an_unseen_run_has_neither_noise_nor_events(tmp_path: Path) -> None:
    truth = make_truth(20)
    write_set(20, tmp_path / "set", tmp_path / "key")
    rows = np.genfromtxt(tmp_path / "key/unseen.csv", delimiter=",", names=True, dtype=None)
    c = truth.campaign
    at = c.unseen & (c["moving"] == 0)
    clean = sum(h.column[at] for h in truth.hidden if h.name not in library.EVENTS)
    force = c.a_i[at] + 1e-6 * (truth.accelerometer.input_ug(c)[at] + clean)
    scale = (1 + truth.accelerometer.scale) * (1 + 1e-6 * truth.accelerometer.k1(c.x)[at])
    ratio = rows["output"] / (scale * force)
    assert np.ptp(ratio) / ratio.mean() < 1e-6


def record(
    hidden: list[dict[str, Any]], document: dict[str, Any] | None, **changed: Any
) -> dict[str, Any]:
    key = {
        "seed": 1,
        "group": "nulls" if not hidden else "outside" if hidden[0]["outside"] else "library",
        "present": "bare",
        "protocol": dict.fromkeys(
            ("style", "span", "runs", "positions", "random_order", "mixed_rates"), 4
        ),
        "noise": {"label": "white"},
        "noise_rms_ug": 5.0,
        "predictive": True,
        "accelerometers": [{"serial": "A1", "carrier": True, "hidden": hidden}],
        **changed,
    }
    answer = {"json": document, "cpu_s": 3.0}
    return {"key": key, "answer": answer, "unseen_ug": {"rms": 5.0, "mean": 5.0}}


def one(name: str, **said: Any) -> dict[str, Any]:
    return {
        "name": name,
        "outside": False,
        "d": 30.0,
        "factors": [],
        "names": [],
        "shares": {},
        **said,
    }


def says(verdict: str, *names: str, aliases: tuple[tuple[str, ...], ...] = (), **more: Any):
    among = [n for group in aliases for n in group]
    effects = [{"name": n} for n in (*names, *among)]
    return {"serial": "A1", "verdict": verdict, "effects": effects, "alias_sets": aliases, **more}


LAG, STEP = one("thermal_lag"), one("bias_step")


@pytest.mark.parametrize(
    ("hidden", "document", "outcome"),
    [
        ([], says("nothing"), "silent"),
        ([], says("unexplained_noise"), "false"),
        ([], None, "failed"),
        ([LAG], says("named", "thermal_lag"), "exact"),
        ([LAG], says("alias", aliases=(("thermal_lag", "run_in"),)), "alias"),
        ([LAG], says("named", "thermal_lag", "run_in"), "too many"),
        ([LAG], says("named", "run_in"), "wrong"),
        ([LAG], says("alias", aliases=(("bias_step", "run_in"),)), "wrong"),
        ([LAG], says("nothing"), "missed"),
        ([LAG, STEP], says("named", "bias_step"), "in part"),
        ([LAG, STEP], says("named", "bias_step", "thermal_lag"), "exact"),
    ],
)
def test_answers_to_effects_with_names_are_called(
    hidden: list[dict[str, Any]], document: dict[str, Any] | None, outcome: str
) -> None:
    (case,) = cases_of(record(hidden, document))
    assert case.outcome == outcome


KINK = one("kink", outside=True, factors=["temperature"], names=["kink"], shares={"run_in": 0.7})


@pytest.mark.parametrize(
    ("document", "outcome", "told", "factor"),
    [
        (says("nothing"), "silent", False, False),
        (says("unexplained_repeatable", where={"factor": "temperature"}), "told", True, True),
        (says("unexplained_noise", where={"factor": "time"}), "told", True, False),
        (says("named", "bias_kink"), "named", True, False),
        (says("named", "bias_step"), "wrong name", False, False),
        (says("named", "run_in"), "half a name", False, False),
        (says("named", "thermal_lag", something_left=True), "told", True, False),
        (says("named", "thermal_lag"), "only beside", False, False),
    ],
)
def test_answers_to_an_effect_without_a_name_are_called(
    document: dict[str, Any], outcome: str, told: bool, factor: bool
) -> None:
    (case,) = cases_of(record([KINK, LAG], document))
    assert (case.outcome, case.told, case.factor_right) == (outcome, told, factor)
    assert case.bare_wrong == (outcome == "wrong name")
    assert case.unseen == pytest.approx(1.0)  # an offset is the level of the run


@pytest.mark.parametrize(
    ("words", "factor"),
    [
        ("time since the last move", "since_move"),
        ("direction of the last move", "last_move"),
        ("last_move", "last_move"),
        ("chamber_minus_case", "chamber_minus_case"),
        ("position before the last move", "position_before"),
        ("time_since_ramp_change", "since_ramp_change"),
        ("rotation_phase", "position"),
        ("hour of the day", "hour"),
        ("time_in_run", "time_in_run"),
        ("supply_v", "supply_v"),
    ],
)
def test_a_factor_is_known_by_other_words(words: str, factor: str) -> None:
    assert factor_of(words) == factor


def test_seeds_that_are_answered_are_not_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def ask(seed: int, program: Path, work: Path) -> dict[str, Any]:
        asked.append(seed)
        return {"seed": seed, **record([], says("nothing"))}

    monkeypatch.setattr(asking, "ask", ask)
    out = tmp_path / "answers.jsonl"
    for seeds in ("0:3", "0:5"):
        assert asking.main(["--sets", "nulls", "--seeds", seeds, "--out", str(out)]) == 0
    assert sorted(asked) == [0, 1, 2, 3, 4]
    told = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    page = report([case for line in told for case in cases_of(line)])
    assert "| nothing hidden: a false verdict | ≤ 2 % | 0 of 5 = 0.0 % | 0.0–52.2 % |" in page
