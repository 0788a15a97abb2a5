"""The measured thermal loop of a MEMS IMU made by others (../shared/data/imu_thermal_loop)."""

from pathlib import Path

import pytest

from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.foreign.read import import_log

ROOT = Path(__file__).parents[3]
LOG = ROOT.parent / "shared/data/imu_thermal_loop/imu_raw_data.csv"
G = 9.80665
pytestmark = pytest.mark.skipif(not LOG.exists(), reason=f"measured data absent: {LOG}")

# An independent reader's residual std of a cubic and heating minus cooling (its README), m/s².
CUBIC = {"x": 0.0064, "y": 0.0173, "z": 0.0443}
QUINTIC = {"x": 0.0063, "y": 0.0172, "z": 0.0441}
LOOP = {"x": (-0.014, -0.007), "y": (0.033, 0.042), "z": (0.051, 0.146)}


@pytest.fixture(scope="module")
def runs():
    return import_log(LOG, ROOT / "examples/maps/imu_thermal_loop.toml")


@pytest.mark.parametrize("by_hand", [True, False], ids=["cubic", "chosen by the data"])
def test_cubic_residuals_and_the_loop_are_the_published_ones(runs, by_hand: bool) -> None:
    cubic = TermsFile(terms=("k0", "k0_t1", "k0_t2", "k0_t3"))
    for one in fit_runs(runs, terms=cubic if by_hand else None):
        # published to four decimals: half a unit of the last
        assert one.summary.rms_ug * 1e-6 * G == pytest.approx(CUBIC[one.serial], abs=5.1e-5)
        loop = one.summary.loop_at(40.0)
        assert loop is not None
        low, high = LOOP[one.serial]
        assert low <= loop * 1e-6 * G <= high


def test_a_higher_order_does_not_help(runs) -> None:
    for one in fit_runs(runs):
        assert one.selection is not None
        assert one.selection.k0_order in (2, 3)
        fourth = one.selection.trial(4, 0)
        assert fourth is not None
        assert fourth.residual_ug * 1e-6 * G > QUINTIC[one.serial] - 1e-4
        chosen = one.selection.trial(one.selection.k0_order, 0)
        assert chosen is not None
        assert fourth.heldout_ug > chosen.heldout_ug
