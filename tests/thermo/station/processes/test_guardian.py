"""The guardian dead, stopped, or not to be replaced."""

import os
import signal
import threading

import pytest

from drivers.devices import SafeResult
from drivers.errors import FencedError, LinkError
from tests.thermo.station.processes.guard_bench import guardian_pid, phase_of, running, until
from tests.thermo.station.processes.processes import chamber_config, hold, setpoint_c
from thermo.safety import guardian_process
from thermo.safety.commanded_note import Commanded, forget_commanded, note_commanded, read_commanded
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian_record import read_record
from thermo.safety.processes import process_state


@pytest.mark.slow
def test_a_killed_guardian_is_replaced_and_its_successor_guards(bench):
    with running(bench) as controller:
        first = guardian_pid(bench)
        os.kill(first, signal.SIGKILL)
        controller.wait_for("event guardian", 180)
        assert guardian_pid(bench) != first
        controller.process.kill()
        until(lambda: phase_of(bench) == "safe")
        assert setpoint_c(bench[2]) == 25.0


def test_a_stopped_guardian_is_ended_and_replaced(bench, sitting, tmp_path, monkeypatch):
    sitting.start("T", {}, tmp_path / "g.json")
    first = guardian_pid(bench)
    os.kill(first, signal.SIGSTOP)
    monkeypatch.setattr(guardian_process, "ANSWER_S", 0.5)
    events: list[str] = []
    until(lambda: events.extend(sitting.beat()) or events)
    assert "does not answer the heartbeat" in events[0]
    assert process_state(first)[0] == "gone"
    assert guardian_pid(bench) != first
    sitting.permit()
    done = SafeResult(verified=True, steps=())
    assert sitting.end(done) is done
    assert not (tmp_path / "g.json").exists()
    assert read_commanded(chamber_config(bench)) is None


def test_a_guardian_that_cannot_be_replaced_ends_the_test_once(
    bench, sitting, tmp_path, monkeypatch
):
    sitting.start("T", {}, tmp_path / "g.json")
    monkeypatch.setattr(guardian_process.sys, "executable", "/no/such/python")
    os.kill(guardian_pid(bench), signal.SIGKILL)
    with pytest.raises(LinkError, match="cannot be replaced"):
        until(lambda: sitting.beat() and False)
    assert sitting.beat() == ()  # the clean-up goes on, and may command
    sitting.permit()
    assert sitting.end(SafeResult(verified=True, steps=())).verified


def test_a_killed_guardian_is_replaced_within_one_look(bench, sitting, tmp_path):
    sitting.start("T", {}, tmp_path / "g.json")
    first = guardian_pid(bench)
    os.kill(first, signal.SIGKILL)
    until(lambda: process_state(first)[0] == "gone")
    (event,) = sitting.beat()
    assert f"process {first}, has ended" in event
    assert sitting.beat() == ()
    second = guardian_pid(bench)
    assert second != first
    note = read_commanded(chamber_config(bench))
    assert note is not None
    assert note.guardian_pid == second
    hold(chamber_config(bench), 40.0)
    sitting.end(SafeResult(verified=False, steps=()))  # left to the second one
    until(lambda: setpoint_c(bench[2]) == 25.0)


def test_without_a_guardian_nothing_may_be_written(sitting):
    with pytest.raises(FencedError, match="there is no guardian"):
        sitting.permit()


def test_a_guardian_that_cannot_keep_its_file_is_no_guardian(sitting, tmp_path):
    with pytest.raises(LinkError, match="No such file"):
        sitting.start("T", {}, tmp_path / "missing" / "g.json")


def test_a_fenced_sitting_stays_fenced(bench, sitting, tmp_path):
    config = chamber_config(bench)
    hold(config, 40.0)
    sitting._limit_s = 1.0
    sitting.start("T", {}, tmp_path / "g.json")
    sitting.permit()
    until(lambda: setpoint_c(bench[2]) == 25.0)
    for call in (sitting.permit, sitting.beat, sitting.permit):
        with pytest.raises(FencedError, match=r"the guardian took over: .* silent for"):
            call()
    safe = sitting.end(SafeResult(verified=False, steps=(), commanded=False))
    assert safe.verified
    assert sitting.taken_over
    assert "silent" in safe.steps[0]


def test_a_chamber_is_not_left_to_a_stopped_guardian(bench, sitting, tmp_path):
    sitting.start("T", {}, tmp_path / "g.json")
    first = guardian_pid(bench)
    hold(chamber_config(bench), 40.0)
    os.kill(first, signal.SIGSTOP)
    until(lambda: process_state(first)[0] == "stopped")
    sitting.end(SafeResult(verified=False, steps=("no answer",)))
    until(lambda: setpoint_c(bench[2]) == 25.0)
    assert process_state(first)[0] == "gone"


def test_a_guardian_that_took_over_just_before_it_was_dismissed_is_heard(bench, sitting, tmp_path):
    sitting._limit_s = 0.5
    sitting.start("T", {}, tmp_path / "g.json")
    until(lambda: (r := read_record(tmp_path / "g.json")) is not None and r.phase == "safe")
    safe = sitting.end(SafeResult(verified=True, steps=("held",)))
    assert sitting.taken_over
    assert safe.verified
    assert not safe.commanded


def test_an_earlier_test_s_chamber_stays_noted_until_it_is_safe(bench, sitting, tmp_path):
    config = chamber_config(bench)
    note_commanded(config, Commanded(chamber_url=config.url, test_id="earlier", recognition={}))
    sitting.start("T", {}, tmp_path / "g.json")
    sitting.end(SafeResult(verified=False, steps=(), commanded=False))  # it never commanded
    assert read_commanded(config) is not None
    forget_commanded(config)


def test_another_thread_s_beat_is_no_sign_of_control(bench, sitting, tmp_path):
    sitting._limit_s = 1.5
    sitting.start("T", {}, tmp_path / "g.json")
    hold(chamber_config(bench), 40.0)
    over = threading.Event()

    def beat() -> None:
        while not over.wait(0.1):
            sitting.beat()

    helper = threading.Thread(target=beat)
    helper.start()
    try:
        until(lambda: setpoint_c(bench[2]) == 25.0)
    finally:
        over.set()
        helper.join()
    sitting.end(SafeResult(verified=False, steps=(), commanded=False))


@pytest.mark.slow
def test_a_guardian_stopped_while_its_controller_dies_goes_on_when_the_chamber_is_wanted(bench):
    with running(bench) as controller:
        guardian = guardian_pid(bench)
        os.kill(guardian, signal.SIGSTOP)
        controller.process.kill()
        controller.process.wait(30)
        assert setpoint_c(bench[2]) > 25.0 or process_state(guardian)[0] == "stopped"
        take_lock(chamber_config(bench)).release()
        assert setpoint_c(bench[2]) == 25.0
