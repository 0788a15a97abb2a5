import pytest

from drivers.station import StationConfig
from errormodel.errors import InputError, StoreError
from tests.thermo.station.running import run_test
from thermo.planning import plan as planning
from thermo.planning.default_station import default_station
from thermo.planning.sequence import sequence_toml
from thermo.station.job import make_job, make_resumed_job
from thermo.store.records import NewTest
from thermo.store.store import open_store


def begun(path, sequence, station: StationConfig) -> str:
    with open_store(path) as store:
        return store.begin_test(
            NewTest(sequence.name, sequence_toml(sequence), station.model_dump_json())
        )


def test_a_new_job_opens_and_writes_nothing(short, config, tmp_path):
    job = make_job(short, tmp_path / "s.sqlite", config)
    assert (job.sequence, job.station, job.resume, job.emulated) == (short, config, None, False)
    assert make_job(short, tmp_path / "s.sqlite").emulated
    assert list(tmp_path.iterdir()) == []


def test_a_resumed_job_has_sequence_and_station_from_the_store(short, config, tmp_path):
    test_id = begun(tmp_path / "s.sqlite", short, config)
    job = make_resumed_job(test_id, tmp_path / "s.sqlite")
    assert (job.sequence, job.station, job.resume, job.emulated) == (short, config, test_id, False)
    other = config.model_copy(update={"name": "other"})
    assert make_resumed_job(test_id, tmp_path / "s.sqlite", other).station == other


def test_emulated_instruments_are_made_anew(short, tmp_path):
    made = default_station(short)
    served = made.model_copy(
        update={"chamber": made.chamber.model_copy(update={"url": "modbus+tcp://127.0.0.1:45678"})}
    )
    job = make_resumed_job(begun(tmp_path / "s.sqlite", short, served), tmp_path / "s.sqlite")
    assert job.emulated
    assert job.station == made
    assert job.served_at(served).station == served


def test_another_sequence_or_an_unknown_test_is_refused(short, edit_sequence, config, tmp_path):
    path = tmp_path / "s.sqlite"
    test_id = begun(path, short, config)
    other = edit_sequence(("period_s = 15.0", "period_s = 20.0"))
    with pytest.raises(
        StoreError, match=f"mine.toml: is a different sequence from that of test {test_id}"
    ):
        make_resumed_job(test_id, path, sequence=other, source="mine.toml")
    assert make_resumed_job(test_id, path, sequence=short).sequence == short
    with pytest.raises(StoreError, match="nosuch"):
        make_resumed_job("nosuch", path)
    with pytest.raises(InputError, match="no such store"):
        make_resumed_job(test_id, tmp_path / "none.sqlite")


def test_a_job_is_planned_once(short, station, store, world, monkeypatch):
    made = []
    real = planning._check_wiring  # every planning goes through it
    monkeypatch.setattr(planning, "_check_wiring", lambda *a: (made.append(a), real(*a)))
    assert run_test(short, station, store, world.clock).clean
    assert len(made) == 1
