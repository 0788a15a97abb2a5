"""A measured thermal loop, made by others: what is missing from a cubic is thermal history."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.thermo.discrepancy.examples import QUICK
from thermo.discrepancy.find import find_discrepancy
from thermo.fitting.fit import TermsFile
from thermo.library import thermal_library
from thermo.library.effects import ThermalEffect
from thermo.recording.files import RecordedRuns
from thermo.recording.foreign.read import import_log

ROOT = Path(__file__).parents[3]
LOG = ROOT.parent / "shared/data/imu_thermal_loop/imu_raw_data.csv"
HISTORY = {"thermal_lag", "temperature_rate_bias", "bias_hysteresis"}


pytestmark = pytest.mark.skipif(
    not LOG.exists(), reason="the measured log is not beside the project"
)


def measured_loop() -> RecordedRuns:
    return import_log(LOG, ROOT / "examples/maps/imu_thermal_loop.toml")


FEW = [e for e in thermal_library().effects if e in QUICK or e.name in HISTORY]


@pytest.mark.parametrize(
    ("serials", "effects"),
    [(("x",), FEW), pytest.param(("x", "y", "z"), None, marks=pytest.mark.slow)],
    ids=["one axis", "all"],
)
def test_the_loop_of_every_axis_is_thermal_history_and_not_a_higher_order(
    serials: tuple[str, ...], effects: Sequence[ThermalEffect] | None
) -> None:
    cubic = TermsFile(terms=("k0", "k0_t1", "k0_t2", "k0_t3"))
    whole = measured_loop()
    runs = whole if len(serials) == 3 else whole.select(*serials)
    found = find_discrepancy(runs, model=cubic, effects=effects, draws=100)
    assert tuple(d.serial for d in found) == serials
    for d in found:
        assert d.verdict in ("named", "alias")
        told = {e.name for e in d.effects} | {n for s in d.alias_sets for n in s}
        assert told <= HISTORY
        assert d.rms_after_ug < 0.8 * d.rms_before_ug
        assert d.experiment is not None  # one loop and one position do not decide it
        assert "second_order" in d.invisible


@pytest.mark.slow
def test_history_is_found_beside_an_order_that_the_baseline_lacks() -> None:
    """With k0 quadratic, x and z lack a third order too, which does not quiet the loop."""
    found = {d.serial: d for d in find_discrepancy(measured_loop(), model="bare")}
    for serial in ("x", "z"):
        names = {e.name for e in found[serial].effects}
        assert "bias_temperature_order" in names
        assert names & HISTORY
