"""The search on the rig filter's innovations, on runs of the separate simulator."""

from pathlib import Path

import pytest

from sinscal.discrepancy import RigDiscrepancy, find_rig_discrepancy
from sinscal.recording import read_rig_run
from tests.hidden.rig_setup import EFFECTS, Setup, multirate
from tests.hidden.rig_truth import write_rig_run


def found_in(folder: Path, *effects: str, seed: int = 21, minutes: float = 3.0) -> RigDiscrepancy:
    setup = Setup(programme=tuple(multirate(minutes)), period_s=0.05, angles=True, warm_up_c=15.0)
    path = folder / "run.csv"
    write_rig_run(path, seed=seed, setup=setup, effects=effects)
    return find_rig_discrepancy(read_rig_run(path))


def test_nothing_hidden_gives_no_name(tmp_path: Path) -> None:
    found = found_in(tmp_path)
    assert found.verdict == "nothing"
    assert found.effects == ()
    assert (found.where, found.heldout) == (None, ())


@pytest.mark.parametrize("name", ["lever_arm", "rig_time_offset"])
def test_a_hidden_effect_is_named_and_sized(tmp_path: Path, name: str) -> None:
    found = found_in(tmp_path, name)
    assert found.verdict == "named"
    assert [e.effect.name for e in found.effects] == [name]
    assert found.where == found.effects[0].effect.follows == "rate"
    parameters = found.effects[0].parameters
    for parameter, true in EFFECTS[name].items():
        one = parameters[parameter]
        # of four values one in 16,000 lies beyond four sigma
        assert abs(one.value - true) < 4.0 * one.sigma, parameter
    for channel, floor in found.floor.items():
        # of 500 innovations the rms has a sigma of 3.2 %; four of them
        assert found.rms_after[channel] < 1.13 * floor, channel
