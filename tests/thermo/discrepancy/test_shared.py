"""Accelerometers that shared a head: what is the head's is alike in all, what differs is not."""

from collections.abc import Mapping
from typing import Literal

import pandas as pd
import pytest

from tests.thermo.discrepancy.examples import QUICK, hidden_runs, recorded
from thermo.discrepancy.find import Discrepancy, find_discrepancy
from thermo.discrepancy.shared import SharedEffect
from thermo.recording.files import RecordedRuns

FEWER = 80  # simulated nulls: the effects here are far beyond luck
EQUATION = {"k2": 17.0, "cross": 310.0, "k3": -9.0, "order": 60.0}


def of_one_head(*hidden: Mapping[str, float]) -> RecordedRuns:
    """Return the runs of accelerometers A, B, … on one head, each with something of its own."""
    frames = [
        hidden_runs(11 + k, own, rates=(2.0, 2.0), every_45=True).frame().assign(serial="ABC"[k])
        for k, own in enumerate(hidden)
    ]
    return recorded([pd.concat(frames)])


def searched(
    *hidden: Mapping[str, float], model: Literal["bare"] | None = "bare"
) -> tuple[Discrepancy, ...]:
    return find_discrepancy(of_one_head(*hidden), model=model, effects=QUICK, draws=FEWER)


def bare_names(d: Discrepancy) -> set[str]:
    aliased = {n for s in d.alias_sets for n in s}
    return {e.name for e in d.effects} - aliased


def test_an_error_of_the_head_is_told_once_with_all_that_show_it() -> None:
    found = searched({"head": 40.0}, {"head": 40.0})
    shared = SharedEffect(effect="indexer_harmonic", serials=("A", "B"), owner="head")
    assert found[0].shared == found[1].shared
    assert shared in found[0].shared
    # at every 45° one mounting cannot tell it from a third order, however many are on the head
    for d in found:
        assert {"indexer_harmonic", "third_order"} <= {n for s in d.alias_sets for n in s}


@pytest.mark.slow
def test_what_came_to_all_at_one_moment_is_told_as_the_runs_and_not_each_one_s() -> None:
    found = find_discrepancy(
        recorded(
            [
                hidden_runs(21 + k, {"step": size}).frame().assign(serial="AB"[k])
                for k, size in enumerate((40.0, -60.0))
            ]
        ),
        draws=FEWER,
    )
    assert all("bias_step" in [e.name for e in d.effects] for d in found)
    shared = SharedEffect(effect="bias_step", serials=("A", "B"), owner="run")
    assert [d.shared for d in found] == [(shared,), (shared,)]


def test_what_differs_between_accelerometers_on_one_head_is_their_own() -> None:
    found = searched({"k3": 20.0}, {"k3": -15.0})
    for d, size in zip(found, (20.0, -15.0), strict=True):
        assert (d.verdict, [e.name for e in d.effects]) == ("named", ["third_order"])
        value = d.effects[0].parameters["k3"]
        assert abs(value.value - size) < 4.0 * value.sigma
        assert "indexer_harmonic" in [u.effect for u in d.refuted]
        assert d.shared == ()


def test_beside_what_fit_would_choose_only_the_hidden_effect_is_missing() -> None:
    (d,) = searched({**EQUATION, "loop": 15.0}, model=None)
    assert (d.verdict, [e.name for e in d.effects]) == ("named", ["bias_hysteresis"])
    value = d.effects[0].parameters["bias_hysteresis"]
    assert abs(value.value - 15.0) < 4.0 * value.sigma
    held = {t.name for t in d.before.model.terms}
    assert {"k2", "k3", "delta_o", "k0_t3"} <= held
    assert not {"cross_axis", "second_order", "third_order"} & set(d.invisible)


@pytest.mark.slow  # beside what fit would choose, above
def test_beside_the_bare_model_several_terms_are_told_at_once_and_none_wrongly() -> None:
    (d,) = searched({**EQUATION, "loop": 15.0})
    true = {
        "second_order", "third_order", "cross_axis", "bias_temperature_order", "bias_hysteresis"
    }  # fmt: skip
    said = {e.name for e in d.effects} | {n for s in d.alias_sets for n in s}
    assert said >= true
    assert bare_names(d) <= true
    assert {"k2", "k3", "delta_o", "k0_t3"} <= set(d.fit_first)
