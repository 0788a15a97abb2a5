"""What the proposed experiment decides when it is carried out."""

import pytest

from tests.thermo.discrepancy.examples import carried_out, hidden_runs
from thermo.discrepancy.experiment_menu import Limits, menu
from thermo.discrepancy.find import find_discrepancy
from thermo.recording.channel import channel_of
from thermo.recording.files import join_runs

LAG_S = 12.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(21, 25))
def test_a_fast_lag_is_told_from_a_rate_bias_after_the_experiment_proposed(seed: int) -> None:
    runs = hidden_runs(seed, {"lag": LAG_S}, tempco=0.0)
    (before,) = find_discrepancy(runs)
    assert {"thermal_lag", "temperature_rate_bias"} <= set(*before.alias_sets)
    assert before.experiment is not None
    assert before.experiment.sequence is not None
    more = carried_out(seed, before.experiment.sequence, {"lag": LAG_S}, tempco=0.0)
    (after,) = find_discrepancy(join_runs([runs, more]))
    assert [(after.verdict, e.name) for e in after.effects] == [("named", "thermal_lag")]
    (tau,) = (p for p in after.effects[0].parameters.values() if p.unit == "s")
    assert abs(tau.value - LAG_S) < 4.0 * tau.sigma


def test_an_experiment_stays_within_what_the_laboratory_can_do() -> None:
    channel = channel_of(hidden_runs(1), "A")
    limits = Limits(temperatures_c=(0.0, 40.0), angles_deg=(0.0, 180.0))
    for item in menu(channel, limits):
        programme = item.sequence.temperature
        reached = [programme.start_c, *(s.to_c for s in programme.segments if s.kind == "ramp")]
        assert min(reached) >= 0.0
        assert max(reached) <= 40.0
        assert item.sequence.positions.angles_deg == (0.0, 180.0)
        assert "every" not in item.text or "read every" in item.text
