"""What is looked at before a start: each thing green or red, and nothing is commanded."""

from pathlib import Path

import pytest

from drivers.clock import RealClock
from drivers.errors import InstrumentError
from thermo.launch.arming import all_passed, check_arming
from thermo.launch.emulated import emulated
from thermo.planning.default_station import default_station
from thermo.planning.sequence import Sequence, load_sequence
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian_process import prove_startable

SHORT = Path(__file__).parents[3] / "examples/sequences/short.toml"


@pytest.fixture
def sequence() -> Sequence:
    return load_sequence(SHORT)


@pytest.fixture
def served(sequence):
    with emulated(default_station(sequence), RealClock()) as station:
        yield station.config


def red(checks) -> dict[str, str]:
    assert all(bool(c.remedy) != c.passed for c in checks)
    return {c.name: c.found for c in checks if not c.passed}


def test_a_station_that_is_ready_is_green_and_was_told_nothing(sequence, served, tmp_path):
    checks = check_arming(sequence, served, str(tmp_path / "store.sqlite"))
    assert all_passed(checks), red(checks)
    names = ["limits", "store", "disk", "chamber free", "chamber", "digitiser", "head", "guardian"]
    assert [c.name for c in checks] == names
    assert not (tmp_path / "store.sqlite").exists()


def test_emulated_instruments_need_no_more_than_store_and_disk(sequence, tmp_path):
    checks = check_arming(sequence, None, str(tmp_path / "store.sqlite"))
    assert all_passed(checks)


def test_what_is_not_good_is_red_with_what_to_do(sequence, served, tmp_path):
    gone = served.model_copy(
        update={"head": served.head.model_copy(update={"url": "serial:///dev/nowhere"})}
    )
    found = red(check_arming(sequence, gone, str(tmp_path / "none/store.sqlite")))
    assert set(found) == {"store", "instruments"}
    hot = sequence.model_copy(
        update={"temperature": sequence.temperature.model_copy(update={"start_c": 400.0})}
    )
    assert set(red(check_arming(hot, served, "store.sqlite"))) == {"limits"}


def test_a_chamber_that_somebody_holds_is_asked_nothing(sequence, served, tmp_path):
    lock = take_lock(served.chamber)
    try:
        found = red(check_arming(sequence, served, str(tmp_path / "store.sqlite")))
    finally:
        lock.release()
    assert set(found) == {"chamber free"}
    assert "held by" in found["chamber free"]


def test_a_guardian_that_cannot_start_is_told(monkeypatch):
    prove_startable()
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    with pytest.raises(InstrumentError, match="cannot be started"):
        prove_startable()
