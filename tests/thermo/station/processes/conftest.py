"""An emulated station, served for a module's tests, and a controller's hold on its chamber."""

from pathlib import Path

import pytest

from drivers.station import StationConfig
from tests.thermo.station.processes.guard_bench import SEQUENCE, SPEED
from tests.thermo.station.processes.processes import serving
from thermo.safety.guarded_sitting import Guard, take_lock


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("guard"), SEQUENCE, SPEED) as served:
        yield served


@pytest.fixture
def sitting(bench, tmp_path):
    """A controller's hold on the chamber, in this process."""
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    with Guard(config, take_lock(config.chamber), limit_s=60.0) as made:
        yield made
    take_lock(config.chamber).release()
