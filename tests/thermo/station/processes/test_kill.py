"""Processes that die: no acknowledged reading is lost, the chamber is made safe every time."""

import json
import os
import random
import signal
import time
from pathlib import Path

import pytest

from tests.thermo.station.processes.processes import (
    Controller,
    chamber_config,
    hold,
    newest_test,
    serving,
    setpoint_c,
)
from tests.thermo.station.there_and_stay import there_and_stay
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian import Charge
from thermo.safety.guardian_process import Guardian
from thermo.safety.guardian_record import GuardianRecord, read_record
from thermo.safety.guardian_results import collect_result, result_file
from thermo.store.records import NewTest
from thermo.store.store import open_store

SEQUENCE = there_and_stay(
    serials="AB",
    hold_min=2.0,
    to_c=25.0,
    rate_c_per_min=1.0,
    stay_min=2.0,
    period_s=10.0,
    more="[after_gap]\nresoak_min = 1.0",
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("bench"), SEQUENCE) as served:
        yield served


def status_of(store_path: str, test_id: str) -> str:
    with open_store(store_path) as store:
        return store.test(test_id).status


def check_after_kill(bench, test_id: str, lines: list[str], acks: set[tuple[str, ...]]) -> None:
    _, _, config, store_path = bench
    path = result_file(store_path, test_id)
    take_lock(chamber_config(bench)).release()
    assert setpoint_c(config) == 25.0
    with open_store(store_path) as store:
        frame = store.readings(test_id)
        ended_itself = store.test(test_id).safe_result_json
    if ended_itself:  # the kill came between the stored end and the end of the process
        assert json.loads(ended_itself)["verified"] is True
    elif "event approach" in lines or "event segment" in lines:
        # it had a guardian, and that has seen to the chamber
        record = read_record(path)
        assert record is not None
        assert record.verified
    stored = {
        (str(r.run), str(r.slot), str(r.attempt), str(r.serial), repr(float(r.output)))
        for r in frame.itertuples()
    }
    assert acks <= stored


def kill_and_resume(bench, kills: int, seed: int) -> int:
    """Return how many kills met a running controller."""
    rng = random.Random(seed)
    test_id, acks, killed = "-", set(), 0
    for _ in range(kills):
        controller = Controller(*bench, test_id)
        controller.wait_for("event ")
        # from the first event to beyond the end of what is left of a run
        time.sleep(rng.uniform(0, 1.5))
        controller.process.kill()
        lines = controller.end()
        if lines[-1].startswith("outcome"):  # it was done before
            break
        test_id = newest_test(bench[3])
        acks |= {tuple(line.split()[1:]) for line in lines if line.startswith("ack ")}
        check_after_kill(bench, test_id, lines, acks)
        killed += 1
        if status_of(bench[3], test_id) == "finished":
            break
    else:
        lines = Controller(*bench, test_id).end()
        # a slot lasts 33 ms: a loaded machine misses some, and that is a complaint
        assert lines[-1].startswith("outcome finished True all runs done"), lines[-3:]
    test_id = newest_test(bench[3])
    assert status_of(bench[3], test_id) == "finished"
    with open_store(bench[3]) as store:
        frame = store.readings(test_id)
        valid = frame[frame.voided == ""]
        kinds = [event.kind for event in store.events(test_id)]
    assert not valid.duplicated(["run", "serial", "slot"]).any()
    assert not frame.duplicated(["run", "serial", "slot", "attempt"]).any()
    assert "guardian: not safe" not in kinds
    return killed


def test_three_kills(bench):
    kill_and_resume(bench, kills=3, seed=1)


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_a_hundred_kills(tmp_path_factory):
    """A hundred kills in all, over as many tests as it takes."""
    left, seed = 100, 10
    while left > 0:
        seed += 1
        with serving(tmp_path_factory.mktemp("bench"), SEQUENCE) as bench:
            left -= kill_and_resume(bench, kills=min(left, 5), seed=seed)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_test_safely_however_often_it_comes(bench, number):
    controller = Controller(*bench, "-")
    controller.wait_for("event segment")
    for _ in range(3):
        controller.process.send_signal(number)
        time.sleep(0.02)
    lines = controller.end()
    assert lines[-1] == f"outcome interrupted True stopped by {signal.Signals(number).name}"
    assert controller.process.returncode == 0
    assert setpoint_c(bench[2]) == 25.0
    with open_store(bench[3]) as store:
        assert store.test(newest_test(bench[3])).status == "interrupted"
    assert not result_file(
        bench[3], newest_test(bench[3])
    ).exists()  # the guardian had nothing to do


# ---- the guardian alone ----


def started(config, path: Path, limit_s: float = 60.0) -> Guardian:
    made = Guardian(Charge(chamber=config, result_path=path, limit_s=limit_s))
    made.wait_until_ready()
    return made


def wait_for_record(path: Path, phase: str) -> GuardianRecord:
    give_up = time.monotonic() + 30
    while (record := read_record(path)) is None or record.phase != phase:
        assert time.monotonic() < give_up, record
        time.sleep(0.02)
    return record


def test_a_dismissed_guardian_leaves_the_chamber_alone(bench, tmp_path):
    config = chamber_config(bench)
    guardian = started(config, tmp_path / "g.json")
    hold(config, 40.0)
    guardian.dismiss()
    assert setpoint_c(bench[2]) == 40.0
    assert not (tmp_path / "g.json").exists()
    guardian.dismiss()  # harmless


def test_a_guardian_is_deaf_to_signals_and_acts_when_it_is_left(bench, tmp_path):
    config = chamber_config(bench)
    with started(config, tmp_path / "g.json") as guardian:
        hold(config, 40.0)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP):
            os.kill(guardian.pid, number)
        assert os.getsid(guardian.pid) == guardian.pid
    assert wait_for_record(tmp_path / "g.json", "safe").verified
    assert setpoint_c(bench[2]) == 25.0


def test_a_guardian_that_cannot_reach_the_chamber_says_so_and_goes_on_trying(tmp_path, bench):
    config = chamber_config(bench).model_copy(update={"url": "modbus+tcp://127.0.0.1:9"})
    with started(config, tmp_path / "g.json") as guardian:
        pass
    try:
        record = wait_for_record(tmp_path / "g.json", "trying")
        assert record.needs_help
        assert record.alive
        assert "keeps trying" in record.text
        assert "attempt" in record.text
    finally:
        os.kill(guardian.pid, signal.SIGKILL)
        os.waitpid(guardian.pid, 0)


def test_what_a_guardian_left_is_entered_once(tmp_path):
    path = tmp_path / "g.json"
    text = {"verified": True, "steps": ["held"], "utc": "2026-01-01", "why": "controller gone"}
    with open_store(tmp_path / "s.sqlite") as store:
        test_id = store.begin_test(NewTest("t", "", "{}"))
        assert collect_result(store, test_id, path) is None
        path.write_text(json.dumps(text), encoding="utf-8")
        assert collect_result(store, test_id, path) is True
        assert collect_result(store, test_id, path) is None
        path.write_text("{torn", encoding="utf-8")
        assert collect_result(store, test_id, path) is False
        assert [e.kind for e in store.events(test_id)] == ["guardian", "guardian: not safe"]
