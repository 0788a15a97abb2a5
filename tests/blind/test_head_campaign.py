"""Scoring of campaigns on one head by hand-made answers, and some of them asked."""

from pathlib import Path

import pandas as pd
import pytest

from benchmarks.blind.chamber.head_campaign import (
    HEAD,
    answers_to,
    run_campaigns,
    told,
    write_campaign,
)
from benchmarks.blind.chamber.physics import EIGHT, Protocol, there_and_back

QUICK = Protocol(name="quick", runs=(there_and_back(4.0),) * 3, angles_deg=EIGHT, dwell_s=60.0)
KEY = {"head": {HEAD: 1.0}, "accelerometers": {"A1": {"own": "thermal_lag", "d": 30.0}}}


def said(*names: str, aliases: tuple[tuple[str, ...], ...] = (), shared: bool = True) -> dict:
    one = {
        "serial": "A1",
        "verdict": "named",
        "effects": [{"name": n} for n in names],
        "alias_sets": [list(a) for a in aliases],
    }
    told_once = [{"effect": HEAD, "serials": ["A1", "A2"], "owner": "head"}] if shared else []
    return {"json": {"accelerometers": [one], "shared": told_once}}


@pytest.mark.parametrize(
    ("answer", "right", "wrong"),
    [
        (said("thermal_lag", HEAD), True, ()),
        (said("thermal_lag", HEAD, "second_order"), True, ()),  # it has one
        (said("thermal_lag", HEAD, aliases=(("thermal_lag", "run_in"),)), True, ()),
        (said("thermal_lag", HEAD, shared=False), False, ()),
        (said("thermal_lag"), False, ()),
        (said("thermal_lag", HEAD, "run_in"), False, ("run_in",)),
        (said("thermal_lag", HEAD, "run_in", aliases=(("run_in", "warm_up"),)), False, ()),
        ({"json": None}, False, ()),
    ],
)
def test_what_is_right_and_what_is_a_wrong_name(answer, right, wrong) -> None:
    (one,) = answers_to(0, KEY, answer)
    assert (one.right, one.wrong_bare) == (right, wrong)
    assert ("right: 1 of 1" in told([one])) == right


def test_three_accelerometers_share_the_head_and_nothing_else(tmp_path: Path) -> None:
    key = write_campaign(tmp_path / "data", tmp_path / "key.json", 0, seed=1, protocol=QUICK)
    frame = pd.read_csv(tmp_path / "data/run.csv")
    assert list(frame.columns[:2]) == ["run", "serial"]
    positions = frame.pivot(index=["run", "time_s"], columns="serial", values="position_deg")
    assert (positions.nunique(axis=1) == 1).all()
    outputs = frame.pivot(index=["run", "time_s"], columns="serial", values="output")
    assert (outputs.nunique(axis=1) > 1).mean() > 0.99
    assert HEAD in key["head"]
    assert len({a["own"] for a in key["accelerometers"].values()}) == 3


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_blind_campaigns_on_one_head(tmp_path: Path) -> None:
    """Six campaigns, in two of which the head errs: P(fewer than 15 of 18 | 95 %) is 1 %."""
    every = run_campaigns(tmp_path, range(6), seed=7)
    assert sum(bool(a.wrong_bare) for a in every) <= 1, told(every)  # P(> 1 of 18 | 1 %): 1.4 %
    assert sum(a.right for a in every) >= 15, told(every)
