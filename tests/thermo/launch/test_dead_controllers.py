"""A controller is killed: its heartbeat stops, and the guardian's result comes into the store."""

import signal
import time

import pytest

from tests.thermo.station.processes.processes import Controller, newest_test, serving, setpoint_c
from tests.thermo.station.processes.test_kill import SEQUENCE
from thermo.launch.dead_controllers import is_gone, settle_dead_controllers
from thermo.safety.guardian_record import read_record
from thermo.safety.guardian_results import result_file
from thermo.store.operation.alarms import list_alarms
from thermo.store.operation.commands import ask, read_command
from thermo.store.operation.controllers import read_beat
from thermo.store.store import open_store

GENEROUS_S = 120.0


@pytest.fixture
def bench(tmp_path):
    with serving(tmp_path, SEQUENCE) as served:
        yield served


def wait_until(met) -> None:
    give_up_s = time.monotonic() + GENEROUS_S
    while not met():
        assert time.monotonic() < give_up_s
        time.sleep(0.05)


def test_a_killed_controller_is_told_of_and_its_guardian_s_result_is_kept(bench):
    store_path = bench[3]
    controller = Controller(*bench, "-")
    controller.wait_for("event segment")
    test_id = newest_test(store_path)
    with open_store(store_path) as store:
        wait_until(lambda: read_beat(store, test_id) is not None)
        beat = read_beat(store, test_id)
        assert beat is not None
        assert not is_gone(beat)
        assert settle_dead_controllers(store, store_path) == ()
        assert "process" in beat.guardian
        controller.process.send_signal(signal.SIGKILL)
        controller.end()
        number = ask(store, "pause", who="anna", test_id=test_id)
        assert is_gone(beat)
        assert settle_dead_controllers(store, store_path) == (test_id,)
        assert settle_dead_controllers(store, store_path) == ()  # once
        assert store.test(test_id).status == "interrupted"
        assert read_command(store, number).state == "refused"
        path = result_file(store_path, test_id)

        def entered() -> bool:
            settle_dead_controllers(store, store_path)
            return read_record(path) is None

        wait_until(entered)
        events = [e for e in store.events(test_id) if e.kind == "guardian"]
        assert len(events) == 1
        assert setpoint_c(bench[2]) == 25.0
        kinds = [a.kind for a in list_alarms(store, test_id) if a.kind != "late"]
        assert kinds == ["controller lost", "guardian"]
        ended = read_beat(store, test_id)
        assert ended is not None
        assert ended.state == "ended"
