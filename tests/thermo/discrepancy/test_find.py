"""Effects hidden in simulated chamber runs: named, told as alias sets, or left alone."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pytest

from tests.thermo.discrepancy.examples import QUICK, hidden_runs
from thermo.discrepancy.find import Discrepancy, find_discrepancy
from thermo.discrepancy.smallest import smallest_nameable
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.library import thermal_library
from thermo.library.effects import ThermalEffect
from thermo.planning.default_station import default_station
from thermo.planning.plan import make_plan

# effect hidden, its size in the simulator's terms, the parameter it must come out as, its truth
SINGLE = {
    "bias_hysteresis": ({"loop": 15.0}, "bias_hysteresis", 15.0),
    "temperature_rate_bias": ({"rate": 8.0}, "temperature_rate_bias", 8.0),
    "thermal_lag": ({"lag": 20.0}, "thermal_lag", 20.0),
}

# beside a quick library, the whole one in the acceptance runs; the default run searches the whole
# for a loop, in several runs and in one
LIBRARIES = pytest.mark.parametrize(
    "effects", [QUICK, pytest.param(None, marks=pytest.mark.slow)], ids=["few", "all"]
)
Library = Sequence[ThermalEffect] | None


def found(
    seed: int,
    hidden: Mapping[str, float] | None = None,
    model: Literal["bare"] | None = None,
    effects: Library = None,
    **kw: object,
) -> Discrepancy:
    runs = hidden_runs(seed, hidden, **kw)  # type: ignore[arg-type]
    (one,) = find_discrepancy(runs, model=model, effects=effects, draws=120)
    return one


def names(d: Discrepancy) -> set[str]:
    """Return what was named, and what could not be told from it."""
    return {e.name for e in d.effects} | {n for s in d.alias_sets for n in s}


@pytest.mark.slow  # a loop by default from the files, in the tests of the commands
@pytest.mark.parametrize("name", list(SINGLE))
def test_a_hidden_effect_is_named_with_its_size(name: str) -> None:
    hidden, parameter, truth = SINGLE[name]
    d = found(1, hidden)
    assert d.verdict == "named"
    assert [e.name for e in d.effects] == [name]
    value = d.effects[0].parameters[parameter]
    assert abs(value.value - truth) < 4.0 * value.sigma
    assert d.heldout is not None
    # the figure asked for: what a new run is predicted to, against what noise alone would leave
    assert d.heldout.after_ug < 1.05 * d.floor_ug
    assert d.heldout.after_ug < d.heldout.before_ug


@LIBRARIES
def test_nothing_is_named_where_nothing_is_missing(effects: Library) -> None:
    d = found(2, model="bare", effects=effects)
    assert (d.verdict, d.effects, d.where) == ("nothing", (), None)
    # at 0°, ±90° and 180° it is scale factor; the chamber was not recorded
    assert d.invisible == ("third_order", "heat_flow")
    assert d.experiment is not None
    assert d.experiment.separates == ("third_order",)
    sequence = d.experiment.sequence
    assert sequence is not None
    make_plan(sequence, default_station(sequence))  # raises when a station cannot run it


@pytest.mark.slow  # an alias set at eight positions, below
@LIBRARIES
def test_the_squared_term_and_a_readout_with_two_gains_are_one_alias_set_at_four_positions(
    effects: Library,
) -> None:
    d = found(3, {"k2": 5.0}, "bare", effects)
    assert d.verdict == "alias"
    assert d.alias_sets == (("second_order", "output_nonlinearity"),)
    assert d.experiment is not None
    assert set(d.experiment.separates) == {"second_order", "output_nonlinearity"}
    assert d.experiment.d_before == pytest.approx(0.0, abs=0.5)
    assert (d.experiment.d_after or 0.0) > 3.0


@LIBRARIES
def test_a_misalignment_and_a_heads_harmonics_are_one_alias_set_at_eight_positions(
    effects: Library,
) -> None:
    """At multiples of 45° a head's second to fourth harmonics make cos θ: no size tells them."""
    d = found(1, {"cross": 4.0}, "bare", effects, every_45=True)
    assert d.alias_sets == (("cross_axis", "indexer_harmonic"),)
    value = d.effects[0].parameters["delta_o"]
    assert abs(value.value - 4.0) < 4.0 * value.sigma
    assert d.experiment is not None
    assert set(d.experiment.separates) == {"cross_axis", "indexer_harmonic"}
    assert (d.experiment.d_after or 0.0) > 5.0


STEP = tuple(e for e in thermal_library().effects if e in QUICK or e.name == "bias_step")


@pytest.mark.parametrize(
    "effects", [STEP, pytest.param(None, marks=pytest.mark.slow)], ids=["few", "all"]
)
def test_a_step_is_found_and_not_predicted(effects: Library) -> None:
    d = found(4, {"step": 30.0}, effects=effects)
    assert "bias_step" in names(d)
    assert abs(d.effects[0].parameters["bias_step_at_h"].value - 9.0) < 0.05  # three blocks
    assert d.heldout is not None
    assert not d.heldout.predictive


@pytest.mark.slow
def test_offsets_between_runs_and_a_misalignment_at_four_positions() -> None:
    assert "turn_on_offset" in names(found(4, {"offset": 25.0}))
    assert set(found(1, {"cross": 4.0}, "bare").alias_sets[0]) == {"cross_axis", "indexer_harmonic"}


@pytest.mark.slow  # tests/accelbench/commands/demo/test_hidden.py has one of no library
@LIBRARIES
def test_a_wave_over_temperature_has_no_name_but_a_place(effects: Library) -> None:
    d = found(5, {"wave": 20.0}, effects=effects)
    assert d.verdict == "unexplained_repeatable"
    assert d.effects == ()
    assert d.where is not None
    assert d.where.name == "temperature"


@pytest.mark.slow
def test_a_short_lag_without_scale_tempco_is_told_as_an_alias_of_the_rate_bias() -> None:
    sets = [found(seed, {"lag": 12.0}, tempco=0.0) for seed in (6, 7)]
    assert all("thermal_lag" in names(d) for d in sets)
    assert any("temperature_rate_bias" in names(d) for d in sets)


@pytest.mark.slow
def test_smallest_nameable_is_the_size_of_strength_seven() -> None:
    smallest = smallest_nameable(found(7, model="bare"))
    assert "third_order" not in smallest
    size = smallest["temperature_rate_bias"].value
    d = found(7, {"rate": 2.0 * size}, "bare")
    assert "temperature_rate_bias" in names(d)
    # twice the size of strength seven; an estimate of strength has a sigma of one
    assert abs(d.effects[0].strength_d - 14.0) < 4.0


@pytest.mark.slow  # the command does both with its files
@LIBRARIES
def test_the_larger_model_is_fitted_and_applied_as_it_is(effects: Library) -> None:
    runs = hidden_runs(1, {"loop": 15.0})
    (d,) = find_discrepancy(runs, effects=effects, draws=100)
    terms = tuple(t.name for t in d.after.model.terms)
    start = {p.name: d.after.values[p.name] for p in d.after.model.parameters}
    (fitted,) = fit_runs(runs, terms=TermsFile(terms=terms, start=start))
    assert fitted.summary.rms_ug < 1.02 * d.rms_after_ug


def test_one_run_names_thermal_history_and_proposes_what_would_decide() -> None:
    d = found(8, {"loop": 60.0}, rates=(1.0,))
    assert d.heldout is None
    assert "bias_hysteresis" in names(d)
    assert "turn_on_offset" in d.invisible
    assert d.experiment is not None
    assert d.experiment.text.startswith("one run and one loop")


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_rates_of_right_and_of_false_verdicts_over_many_seeds() -> None:
    """Forty seeds each of nothing and of four effects: a part of the blind benchmark, by itself."""
    false = sum(found(100 + s).verdict != "nothing" for s in range(40))
    assert false <= 3  # 2 % asked for: P(more than 3 of 40) is 0.9 %
    right = [
        name in names(found(200 + s, hidden))
        for s in range(10)
        for name, (hidden, _, _) in SINGLE.items()
    ]
    assert np.mean(right) >= 0.98 - 1.0 / 40
