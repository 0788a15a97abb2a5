"""The chamber generator is right by closed forms, and finds its own coefficients again."""

import ast
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from accelbench.cli import main
from benchmarks.blind.chamber.effects import (
    LIBRARY,
    OUTSIDE,
    SECOND_POLE,
    UNITS,
    Accelerometer,
    events,
    inner_temperature,
    loop,
    output_g,
)
from benchmarks.blind.chamber.noise import (
    FAMILIES,
    HEAD_REPEAT_ARCSEC,
    UG_PER_ARCSEC,
    Noise,
    Yardstick,
)
from benchmarks.blind.chamber.physics import COLD_C, HOT_C, PROTOCOLS, Night, make_night, relays
from benchmarks.blind.chamber.plan import ONLY_EIGHT, full, medium, small
from benchmarks.blind.chamber.truth import Recipe, write_set

GENERATORS = Path(__file__).parents[2] / "benchmarks/blind"
PACKAGES = {"errormodel", "thermo", "sinscal", "drivers", "accelbench"}
FIT = 'terms = ["k1", "k0", "k0_t1", "k0_t2", "k1_t1", "k1_t2"]\n'


def night(protocol: str = "P1", seed: int = 1) -> Night:
    return make_night(PROTOCOLS[protocol], np.random.default_rng(seed))


@pytest.fixture(scope="module")
def p1() -> Night:
    return night()


def quiet_recipe(**changed) -> Recipe:
    said = {"group": "nothing", "protocol": "P1", "noise": "white", "strengths": {}, "sizes": {}}
    return Recipe(**{**said, **changed})


# it holds the product's answers to hidden truths in the same process; its runs are of the generator
ASKS_THE_PRODUCT = {"protection.py", "naming.py"}


@pytest.mark.parametrize(
    "path",
    [
        p
        for p in GENERATORS.rglob("*.py")
        if not p.name.startswith("test_") and p.name not in ASKS_THE_PRODUCT
    ],
    ids=lambda p: p.name,
)
def test_the_generator_shares_no_code_with_the_package(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    modules += [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    assert {m.partition(".")[0] for m in modules} & PACKAGES == set()


def test_effects_have_the_names_of_the_contract() -> None:
    assert len(LIBRARY) == 17
    assert len(OUTSIDE) == 4
    assert set(LIBRARY) | set(OUTSIDE) == set(UNITS)


def test_a_run_goes_from_cold_to_hot_and_back_at_its_rate() -> None:
    one = night("P2")
    for run, rate in enumerate((0.5, 1.0, 2.0, 1.0)):
        here = one.run == run
        case = one.case_c[here].mean(axis=1)
        # the chamber's unrest is 0.03 °C of cycling and 0.02 °C rms, quietened by the case
        assert case.min() == pytest.approx(COLD_C, abs=0.15)
        assert case.max() == pytest.approx(HOT_C, abs=0.15)
        middle = (case > -20) & (case < 50)
        assert np.median(np.abs(one.flux_c_per_min[here][middle])) == pytest.approx(rate, rel=0.02)


def test_the_inside_is_behind_by_both_poles(p1: Night) -> None:
    behind = (p1.case_c - inner_temperature(p1, 120.0)).mean(axis=1)
    heating = (p1.case_c[:, 0] > 20) & (p1.case_c[:, 0] < 50) & (p1.flux_c_per_min[:, 0] > 0.5)
    # 1 °C/min for the sum of the time constants; cycling of 0.03 °C averages over 30 min
    assert behind[heating].mean() == pytest.approx(120 * (1 + SECOND_POLE) / 60, rel=0.01)


def test_relays_forget_an_inner_loop() -> None:
    """Return-point memory: after a small excursion the state is as if it had not been."""
    there = np.arange(-40.0, 30.0, 0.1)
    aside = np.concatenate([np.arange(30.0, 5.0, -0.1), np.arange(5.0, 30.0, 0.1)])
    further = np.arange(30.0, 60.0, 0.1)
    straight = relays(12.0).walk(np.concatenate([there, further]))
    around = relays(12.0).walk(np.concatenate([there, aside, further]))
    np.testing.assert_allclose(around[-1], straight[-1], atol=1e-12)
    open_by = around[there.size + 125] - straight[there.size - 125]
    assert abs(open_by) > 0.01  # the loop is open at 17.5 °C


def test_the_loop_has_the_height_it_is_said_to_have(p1: Night) -> None:
    state, temp = loop(p1)[:, 0], p1.case_c.mean(axis=1)
    gaps = []
    for run in range(4):
        here = p1.run == run
        for centre in (5.0, 15.0, 25.0):
            near = here & (np.abs(temp - centre) < 1.0)
            up = near & (p1.flux_c_per_min[:, 0] > 0)
            gaps.append(state[up].mean() - state[near & ~up].mean())
    # within the cells of 2 °C the positions of the readings differ by some 0.2 °C of slope 0.15
    assert np.mean(gaps) == pytest.approx(2.0, rel=0.1)


def test_output_of_an_accelerometer_by_hand(p1: Night) -> None:
    device = Accelerometer(k0_ug=100.0, b1_ug=10.0, b2_ug=0.1, s1_ppm=50.0, s2_ppm=1.0)
    hidden = {"second_order": 20.0, "cross_axis": 7.0, "temperature_rate_bias": 3.0}
    out = output_g(p1, device, hidden, {})
    x = p1.case_c.mean(axis=1) - 25.0
    a_i, a_p = (f(np.deg2rad(p1.angle_deg)) for f in (np.sin, np.cos))
    bias = 100 + 10 * x + 0.1 * x**2 + 20 * a_i**2 + 7 * a_p + 3 * p1.flux_c_per_min.mean(axis=1)
    expected = (1 + 1e-6 * (50 * x + x**2)) * (a_i + 1e-6 * bias)
    # half a second of a ramp is 0.008 °C, of which the squares differ by 1e-5
    np.testing.assert_allclose(out, expected, atol=1e-9)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_drawn_noise_has_the_covariance_it_is_said_to_have(p1: Night, family: str) -> None:
    noise = FAMILIES[family]
    stick = Yardstick.of(p1, noise)
    rng = np.random.default_rng(7)
    total, count = 0.0, 0
    for _ in range(4):
        drawn = noise.draw(p1, rng)
        good = stick.block >= 0
        mean = np.bincount(stick.block[good], weights=drawn[good]) / stick.readings
        white = np.linalg.solve(stick.root, mean)
        total, count = total + float(white @ white), count + white.size
    low, high = stats.chi2.ppf([0.0005, 0.9995], count)
    # block means of a walk are taken as if read at their middle: less than 1 % of the variance
    assert 0.99 * low < total < 1.01 * high


def test_strength_is_what_a_fit_with_known_noise_would_see(p1: Night) -> None:
    stick = Yardstick.of(p1, Noise(white_ug=6.0))
    a_p = np.cos(np.deg2rad(p1.angle_deg))
    used = stick.block >= 0
    # At 0° and 180° the force across is ±1 g and belongs to no term of the baseline but by chance.
    # A position has some 59 readings; there the head's 0.05″ adds to the variance of their mean.
    plain = 2.0 / 6.0 * np.sqrt(np.sum(a_p[used] ** 2))
    head = (HEAD_REPEAT_ARCSEC * UG_PER_ARCSEC) ** 2 / (6.0**2 / 59)
    assert stick.strength(2.0 * a_p) == pytest.approx(plain / np.sqrt(1 + head), rel=0.02)
    assert stick.strength(np.sin(np.deg2rad(p1.angle_deg))) < 1e-6  # that is scale factor


def test_third_order_cannot_be_seen_in_four_positions_and_can_in_eight() -> None:
    for protocol, visible in (("P0", False), ("P1", False), ("P3", True)):
        one = night(protocol)
        stick = Yardstick.of(one, FAMILIES["white+OU"])
        device = Accelerometer()
        change = output_g(one, device, {"third_order": 20.0}, {}) - output_g(one, device, {}, {})
        d = stick.strength(1e6 * change)
        # what is left of it in four positions is its product with the scale factor's tempco
        assert (d > 10) is visible, (protocol, d)
        assert visible or d < 0.1


@pytest.mark.slow  # of the generator; the small blind part uses it
def test_all_effects_reach_the_strength_asked_for(tmp_path: Path) -> None:
    recipe = quiet_recipe(protocol="P3", noise="white+OU", strengths=dict.fromkeys(UNITS, 12.0))
    key = write_set(tmp_path, tmp_path / "key.json", recipe, [1, 1])
    for name, found in key["hidden"].items():  # type: ignore[attr-defined]
        assert found["d"] == pytest.approx(12.0, rel=0.02), name


def test_the_files_are_the_contract_s_and_hold_no_answer(tmp_path: Path) -> None:
    recipe = quiet_recipe(group="single", strengths={"run_in": 30.0})
    key = write_set(tmp_path / "data", tmp_path / "keys/k.json", recipe, [2, 3])
    assert sorted(p.name for p in (tmp_path / "data").iterdir()) == ["run.csv", "run.toml"]
    assert json.loads((tmp_path / "keys/k.json").read_text(encoding="utf-8")) == key
    text = (tmp_path / "data/run.toml").read_text(encoding="utf-8")
    assert not any(name in text for name in UNITS)
    frame = pd.read_csv(tmp_path / "data/run.csv")
    assert list(frame.columns) == [
        "run", "serial", "time_s", "temp_c", "chamber_c", "position_deg", "output", "flag",
    ]  # fmt: skip
    assert len(frame) > 7000
    again = write_set(tmp_path / "again", tmp_path / "keys/again.json", recipe, [2, 3])
    assert again == key
    assert (tmp_path / "again/run.csv").read_bytes() == (tmp_path / "data/run.csv").read_bytes()


def test_events_are_one_high_or_one_rms(p1: Night) -> None:
    once = events(p1, np.random.default_rng(4))
    per_run = [once["turn_on_offset"][p1.run == r][0] for r in range(4)]
    assert np.mean(per_run) == pytest.approx(0.0, abs=1e-12)
    assert np.std(per_run) == pytest.approx(1.0)
    assert set(np.unique(once["bias_step"])) == {0.0, 1.0}
    assert once["slow_wander"].std() == pytest.approx(1.0)


def test_a_fit_finds_the_accelerometer_that_was_put_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing hidden: six coefficients of six accelerometers, judged by their own sigmas."""
    (tmp_path / "TERMS.toml").write_text(FIT, encoding="utf-8")
    worst: list[float] = []
    for seed in range(6):
        recipe = quiet_recipe(protocol=("P1", "P3")[seed % 2], noise="white+OU")
        write_set(tmp_path, tmp_path / "k.json", recipe, [99, seed])
        rng = np.random.default_rng([99, seed])
        make_night(PROTOCOLS[recipe.protocol], rng)  # draws come in this order
        device = Accelerometer.drawn(rng)
        words = ["fit", str(tmp_path / "run.csv"), "--model", str(tmp_path / "TERMS.toml")]
        assert main([*words, "--json"]) == 0
        (one,) = json.loads(capsys.readouterr().out)["accelerometers"]
        truth = {
            "k1": device.k1,
            "k0": device.k0_ug,
            "k0_t1": device.b1_ug,
            "k0_t2": device.b2_ug,
            "k1_t1": device.s1_ppm,
            "k1_t2": device.s2_ppm,
        }
        found = one["coefficients"]
        worst += [(found[n]["value"] - v) / found[n]["sigma"] for n, v in truth.items()]
    # 36 numbers, correlated in sixes; sigmas from few hours of drift are known to some 30 %
    assert np.max(np.abs(worst)) < 5.0
    assert 0.5 < np.sqrt(np.mean(np.square(worst))) < 1.5


def test_the_plans_are_as_large_as_asked_and_cover_the_library() -> None:
    everything = full()
    assert len(everything) >= 200
    assert 30 <= len(medium()) <= 50
    assert 5 <= len(small()) <= 8
    hidden = {(n, r.protocol) for r in everything for n in r.hidden}
    assert {n for n, _ in hidden} == set(UNITS)
    assert not {(n, "P1") for n in ONLY_EIGHT if n != "third_order"} & hidden
    single = [r for r in everything if r.group == "single"]
    assert len(single) == 6 * len(LIBRARY)
    assert {(r.noise, r.protocol) for r in single} >= {
        (noise, protocol) for noise in FAMILIES for protocol in ("P1", "P2", "P3")
    }
