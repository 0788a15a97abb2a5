"""A test in a process of its own: it outlives who started it and obeys its store."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.thermo.launch.test_dead_controllers import wait_until
from thermo.launch.control import ask_controller
from thermo.launch.detached import NotStartedError, Order, start_detached
from thermo.planning.sequence import load_sequence
from thermo.safety.processes import process_start
from thermo.station.job import make_job
from thermo.store.operation.commands import list_commands
from thermo.store.operation.controllers import read_beat
from thermo.store.operation.planned import arm_test, begin_starting, plan_test, read_planned
from thermo.store.store import open_store

SHORT = Path(__file__).parents[3] / "examples/sequences/short.toml"

# starts a test, tells of it, and is killed by the test; the speed leaves time for that
START = """
import sys, time
from thermo.launch.detached import start_detached
from thermo.planning.sequence import load_sequence
from thermo.station.job import make_job
started = start_detached(make_job(load_sequence(sys.argv[1]), sys.argv[2]), speed=2.0, planned=1)
print(started.test_id, started.pid, flush=True)
time.sleep(1000)
"""


def test_a_detached_test_outlives_its_starter_and_is_aborted_from_the_store(tmp_path):
    path = tmp_path / "store.sqlite"
    with open_store(path) as store:
        text = SHORT.read_text(encoding="utf-8")
        number = plan_test(store, name="short", sequence_toml=text, who="anna")
        arm_test(store, number, who="anna")
        begin_starting(store, number)
        with subprocess.Popen(
            [sys.executable, "-c", START, str(SHORT), str(path)],
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as starter:
            assert starter.stdout is not None
            test_id, pid = starter.stdout.readline().split()
            starter.kill()
        wait_until(lambda: read_beat(store, test_id) is not None)
        assert read_planned(store, number).test_id == test_id
        paused = ask_controller(store, "pause", test_id, who="anna", patience_s=120.0)
        assert paused.state == "done", paused
        ended = ask_controller(store, "abort", test_id, who="anna", patience_s=120.0)
        assert ended.state == "done", ended
        wait_until(lambda: read_planned(store, number).state == "interrupted")
        assert store.test(test_id).status == "interrupted"
        assert json.loads(store.test(test_id).safe_result_json)["verified"] is True
        wait_until(lambda: process_start(int(pid)) is None)
        late = ask_controller(store, "pause", test_id, who="anna")
        assert late.state == "refused"
        assert "no controller is alive" in late.outcome
        assert [c.who for c in list_commands(store, test_id)] == ["anna"] * 3


def test_why_a_test_did_not_begin_is_told(tmp_path):
    job = make_job(load_sequence(SHORT), tmp_path / "nowhere" / "store.sqlite")
    with pytest.raises(NotStartedError, match="no such folder"):
        start_detached(job)


def test_an_order_survives_its_way(tmp_path):
    order = Order(store_url="postgresql://u:secret@h/d", sequence_toml="x", speed=3.0, planned=7)
    assert Order.parse(order.message()) == order
