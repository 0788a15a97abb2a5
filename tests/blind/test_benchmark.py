"""Scoring by hand-made answers, the runner's blindness, and a small part of the benchmark."""

import json
from pathlib import Path

import pandas as pd
import pytest

from benchmarks.blind.benchmark import Bench, run
from benchmarks.blind.chamber.follow_up import protocol_of
from benchmarks.blind.chamber.plan import medium, small
from benchmarks.blind.chamber.truth import write_more, write_set
from benchmarks.blind.scoring import Rate, Scored, acceptance, outcome, score
from benchmarks.blind.summary import OUTCOMES, THERMAL, page, picture, table

LAG, RATE, STEP = "thermal_lag", "temperature_rate_bias", "bias_step"


@pytest.mark.parametrize(
    ("group", "hidden", "verdict", "bare", "aliases", "called"),
    [
        ("nothing", [], "nothing", [], [], "silent"),
        ("nothing", [], "named", [LAG], [], "false"),
        ("nothing", [], "unexplained_noise", [], [], "false"),
        ("invisible", ["third_order"], "nothing", [], [], "silent"),
        ("single", [LAG], "named", [LAG], [], "named"),
        ("single", [LAG], "alias", [], [[LAG, RATE]], "alias"),
        ("single", [LAG], "alias", [], [[STEP, RATE]], "wrong alias"),
        ("single", [LAG], "named", [RATE], [], "wrong name"),
        ("single", [LAG], "named", [LAG, RATE], [], "wrong name"),
        ("single", [LAG], "nothing", [], [], "missed"),
        ("single", [LAG], "unexplained_repeatable", [], [], "unexplained"),
        ("single", [LAG], "failed", [], [], "failed"),
        ("pair", [LAG, STEP], "named", [LAG, STEP], [], "named"),
        ("pair", [LAG, STEP], "alias", [STEP], [[LAG, RATE]], "alias"),
        ("pair", [LAG, STEP], "named", [LAG], [], "in part"),
        ("pair", [LAG, STEP], "named", [LAG, STEP, RATE], [], "wrong name"),
        ("outside", ["wave"], "unexplained_noise", [], [], "unexplained_noise"),
        ("outside", ["wave"], "unexplained_repeatable", [LAG], [], "wrong name"),
        ("outside", ["wave"], "alias", [], [[LAG, RATE]], "wrong alias"),
    ],
)
def test_what_a_verdict_is_called(group, hidden, verdict, bare, aliases, called) -> None:
    assert outcome(group, set(hidden), verdict, bare, aliases) == called
    assert called in {*OUTCOMES, "silent", "false", "unexplained_noise"}


def key(group: str = "single", **hidden: float) -> dict:
    return {
        "group": group,
        "protocol": "P1",
        "noise": "white+OU",
        "hidden": {n: {"size": 1.0, "unit": "µg", "d": d} for n, d in hidden.items()},
    }


def answer(verdict: str, names=(), aliases=(), **more) -> dict:
    document = {
        "verdict": verdict,
        "effects": [{"name": n} for n in names],
        "alias_sets": list(aliases),
        **more,
    }
    return {"json": document, "seconds": 1.0, "exit": 0}


def test_a_leading_member_of_an_alias_set_is_no_bare_name() -> None:
    said = answer("alias", [RATE], [[RATE, LAG]])
    one = score("s", key(thermal_lag=12.0), said)
    assert (one.bare, one.outcome, one.wrong_bare) == ((), "alias", False)


def test_held_out_is_measured_by_the_noise_that_was_drawn() -> None:
    heldout = {"before_ug": 20.0, "after_ug": 5.2, "runs": ["1"]}
    said = answer("named", [LAG], heldout=heldout, floor_ug=6.0)
    opened = {**key(thermal_lag=40.0), "noise_rms_ug": 5.0}
    one = score("s", opened, said)
    assert one.heldout_over_noise == pytest.approx(1.04)
    assert one.heldout_over_floor == pytest.approx(5.2 / 6.0)


def test_a_crash_is_a_failure_not_a_silence() -> None:
    one = score("s", key("nothing"), {"json": None, "seconds": 1.0, "exit": 2})
    assert one.outcome == "failed"


def test_rates_are_of_the_sets_they_name() -> None:
    sets = [
        score("a", key(thermal_lag=12.0), answer("named", [LAG])),
        score("b", key(thermal_lag=12.0), answer("named", [RATE])),
        score("c", key(thermal_lag=8.5), answer("nothing")),
        score("d", key("nothing"), answer("nothing", heldout=None, where=None)),
        score("e", key("pair", thermal_lag=30.0, bias_step=30.0), answer("named", [LAG])),
        score(
            "f",
            key("outside", periodic_in_temperature=30.0),
            answer("unexplained_repeatable", where={"factor": "temperature"}),
        ),
        score("g", key("invisible", third_order=0.0), answer("nothing", invisible=["third_order"])),
    ]
    found = [(r.good, r.of) for r in acceptance(sets)]
    assert found == [
        (0, 1), (0, 0), (1, 2), (0, 1), (1, 4), (0, 1), (1, 1), (0, 0), (1, 1), (0, 0), (0, 0),
        (0, 0), (0, 0), (0, 0), (0, 0), (0, 0),
    ]  # fmt: skip
    text = table(sets, THERMAL)
    assert "1 of 2 = 50.0 %" in text
    assert "temperature_rate_bias 1" in text
    assert "wrong name" in page(sets, THERMAL)
    assert picture(sets, THERMAL)[:4] == b"\x89PNG"


def test_limits_are_clopper_and_pearson_s() -> None:
    # 0 of 48: 1 − 0.025^(1/48); 48 of 50 by statsmodels' proportion_confint(48, 50, method="beta")
    assert Rate(text="", good=0, of=48, most=0.02).limits == pytest.approx((0.0, 0.0740), abs=1e-4)
    assert Rate(text="", good=48, of=50, least=0.9).limits == pytest.approx(
        (0.8629, 0.9951), abs=1e-4
    )
    assert Rate(text="", good=0, of=0, least=0.9).met is None


def test_the_keys_stay_closed_until_all_have_answered(tmp_path: Path) -> None:
    bench = Bench(work=tmp_path, recipes=small()[:2], seed=1)
    for k in range(2):
        bench.write(k)
    assert {p.name for p in (tmp_path / "data/set-0000").iterdir()} == {"run.csv", "run.toml"}
    bench.answer(0).parent.mkdir()
    bench.answer(0).write_text(json.dumps(answer("nothing")), encoding="utf-8")
    with pytest.raises(RuntimeError, match="no answer yet to set-0001"):
        bench.scored([0, 1])
    assert bench.answered() == [0]


def test_what_is_answered_is_not_asked_again(tmp_path: Path) -> None:
    bench = Bench(work=tmp_path, recipes=small()[:1], seed=1, program=tmp_path / "nowhere")
    bench.answer(0).parent.mkdir(parents=True)
    bench.answer(0).write_text(json.dumps(answer("nothing")), encoding="utf-8")
    (one,) = run(bench, workers=1)
    assert one.outcome == "silent"
    with pytest.raises(SystemExit, match="another benchmark"):
        run(Bench(work=tmp_path, recipes=small()[:2], seed=1))


SEQUENCE = """
name = "next"
[temperature]
start_c = -40.0
repeats = 2
rest_h = 2.0
[[temperature.segments]]
kind = "hold"
duration_min = 20.0
[[temperature.segments]]
kind = "cycle"
low_c = -40.0
high_c = 60.0
rate_c_per_min = 2.0
soak_min = 15.0
[positions]
angles_deg = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
order = "random"
readings_per_position = 30
[sampling]
period_s = 10.0
"""


def test_a_proposed_sequence_is_carried_out(tmp_path: Path) -> None:
    asked = protocol_of(SEQUENCE)
    assert asked.runs[0] == ((0, -40), (20, -40), (70, 60), (85, 60), (135, -40), (150, -40))
    assert (len(asked.runs), asked.rest_s, asked.dwell_s) == (2, 7200.0, 300.0)
    recipe = next(r for r in small() if r.group == "invisible")
    before = write_set(tmp_path / "set", tmp_path / "k.json", recipe, [4, 4])
    d = write_more(tmp_path / "set/next.csv", before, asked, [4, 4, 1])
    assert before["hidden"]["third_order"]["d"] < 1.0  # type: ignore[index]
    assert d["third_order"] > 10.0
    frame = pd.read_csv(tmp_path / "set/next.csv")
    assert set(frame["run"]) == {"next-1", "next-2"}
    assert len(frame) == 2 * (150 * 6 - 1)
    with pytest.raises(ValueError, match="cannot do"):
        protocol_of(SEQUENCE.replace("duration_min = 20.0", "duration_min = 20.0\ntemp_c = 5.0"))


def wrong(sets: list[Scored]) -> list[tuple]:
    return [(s.outcome, s.hidden, s.bare, s.aliases) for s in sets if s.wrong_bare]


# of the six, one that hides nothing and one that hides an effect of the library
@pytest.mark.parametrize(
    "taken", [slice(2), pytest.param(slice(6), marks=pytest.mark.slow)], ids=["two", "six"]
)
def test_a_small_blind_part(tmp_path: Path, taken: slice) -> None:
    """Seeds fixed: the plain cases are right, nothing is called by a wrong name."""
    sets = run(Bench(work=tmp_path, recipes=small()[taken], seed=20))
    assert len(sets) == taken.stop
    assert wrong(sets) == []
    assert {s.outcome for s in sets if s.group in ("nothing", "invisible")} == {"silent"}
    assert all("third_order" in s.invisible for s in sets if s.group == "invisible")
    single = [s for s in sets if s.group in ("single", "pair")]
    assert [(s.hidden, s.verdict) for s in single if s.outcome not in ("named", "alias")] == []
    strange = [(s.outcome, s.factor) for s in sets if s.group == "outside"]
    assert strange == [("unexplained_repeatable", "temperature")] * (taken.stop == 6)


@pytest.mark.slow
def test_a_medium_blind_part(tmp_path: Path) -> None:
    """Some forty sets: limits are those below which a good workflow falls once in a thousand."""
    sets = run(Bench(work=tmp_path, recipes=medium(), seed=21))
    assert len(wrong(sets)) <= 3  # P(> 3 of 25 | 1 %) = 1e-4
    quiet = [s for s in sets if s.group == "nothing"]
    assert sum(s.outcome != "silent" for s in quiet) <= 4  # P(> 4 of 12 | 5 %) = 2e-4
    single = [s for s in sets if s.group == "single"]
    right = sum(s.outcome in ("named", "alias") for s in single)
    assert len(single) - right <= 3  # P(> 3 of 17 | 2 %) = 3e-4
