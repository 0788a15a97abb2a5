"""A measured thermal loop, made by others: what is missing from a cubic is thermal history."""

from pathlib import Path

import pytest

from thermo.discrepancy import find_discrepancy
from thermo.fitting import TermsFile
from thermo.importing import import_log

ROOT = Path(__file__).parents[2]
LOG = ROOT.parent / "shared/data/imu_thermal_loop/imu_raw_data.csv"
HISTORY = {"thermal_lag", "temperature_rate_bias", "bias_hysteresis"}


@pytest.mark.skipif(not LOG.exists(), reason="the measured log is not beside the project")
def test_the_loop_of_every_axis_is_thermal_history_and_not_a_higher_order() -> None:
    runs = import_log(LOG, ROOT / "data/maps/imu_thermal_loop.toml")
    cubic = TermsFile(terms=("k0", "k0_t1", "k0_t2", "k0_t3"))
    for d in find_discrepancy(runs, model=cubic, draws=100):
        assert d.verdict in ("named", "alias")
        told = {e.name for e in d.effects} | {n for s in d.alias_sets for n in s}
        assert told <= HISTORY
        assert d.rms_after_ug < 0.8 * d.rms_before_ug
        assert d.experiment is not None  # one loop and one position do not decide it
        assert "second_order" in d.invisible
