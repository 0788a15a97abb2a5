"""Controllers stopped and silent: the guardian relieves them, and Ctrl-Z is refused."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.thermo.station.processes.guard_bench import (
    ROOT,
    SILENCE_S,
    SPEED,
    guardian_pid,
    phase_of,
    running,
    until,
)
from tests.thermo.station.processes.processes import chamber_config, hold, newest_test, setpoint_c
from thermo.launch.real import load_station, say_at_once, signals_to
from thermo.planning.silence import silence_limit_s
from thermo.safety.chamber_lock import find_holder
from thermo.safety.guardian_record import read_record
from thermo.safety.guardian_results import result_file
from thermo.station.outcome import RunControl, TestInterruptedError
from thermo.store.store import open_store


def test_a_stopped_controller_is_relieved_and_commands_nothing_when_it_wakes(bench):
    with running(bench, SILENCE_S) as controller:
        os.kill(controller.process.pid, signal.SIGSTOP)
        until(lambda: phase_of(bench) == "safe")
        assert setpoint_c(bench[2]) == 25.0
        holder = find_holder(chamber_config(bench))
        assert holder is not None
        assert f"process {controller.process.pid} (stopped)" in holder.sentence
        os.kill(controller.process.pid, signal.SIGCONT)
        lines = controller.end()
        assert lines[-1].startswith(
            "outcome failed True the guardian took over: the controller was silent for "
        )
        assert lines[-1].endswith("more than 3 s")
        assert setpoint_c(bench[2]) == 25.0
    with open_store(bench[3]) as store:
        assert store.test(newest_test(bench[3])).status == "failed"


def toml_of(table: dict, where: str = "") -> str:
    """Write nested tables and lists of tables."""
    plain = {k: v for k, v in table.items() if not isinstance(v, dict | type(None))}
    lists = {k: v for k, v in plain.items() if isinstance(v, list) and isinstance(v[0], dict)}
    lines = [f"{k} = {json.dumps(v)}" for k, v in plain.items() if k not in lists]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += [f"[{where}{key}]", toml_of(value, f"{where}{key}.")]
        for one in lists.get(key, ()):
            lines += [f"[[{where}{key}]]", toml_of(one, f"{where}{key}.")]
    return "\n".join(lines)


@pytest.mark.slow
def test_the_program_ends_with_exit_code_1_after_the_limit_of_its_station_file(bench, tmp_path):
    """The command as it is used: the limit from the station file's time-outs and margin."""
    station = json.loads(Path(bench[2]).read_text(encoding="utf-8"))
    station["digitiser"] |= {"timeout_s": 2.0}
    station["head"] |= {"timeout_s": 0.5}
    station |= {"guardian": {"margin_s": 1.0}, "emulation": {"speed": SPEED}}
    path = tmp_path / "station.toml"
    path.write_text(toml_of(station), encoding="utf-8")
    limit_s = silence_limit_s(load_station(path))
    store = tmp_path / "store.sqlite"
    program = subprocess.Popen(
        [sys.executable, "-c", "import sys; from accelbench.cli import main; sys.exit(main())",
         "run", bench[1], "--station", str(path), "--store", str(store), "--json"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )  # fmt: skip
    try:
        guardian = guardian_pid(bench)
        assert program.poll() is None
        assert guardian != program.pid
        program.send_signal(signal.SIGSTOP)
        hold(chamber_config(bench), 50.0)
        path = result_file(store, newest_test(str(store)))
        until(lambda: (r := read_record(path)) is not None and r.phase == "safe")
        assert setpoint_c(bench[2]) == 25.0
        program.send_signal(signal.SIGCONT)
        out, _ = program.communicate(timeout=180)
    finally:
        program.kill()
        program.wait()
    assert program.returncode == 1
    document = json.loads(out)
    assert document["status"] == "failed"
    assert document["reason"].endswith(f"more than {limit_s:g} s")
    assert setpoint_c(bench[2]) == 25.0


@pytest.mark.slow
def test_what_a_controller_wrote_beside_its_fence_is_taken_back(bench):
    """A write that had its leave before the fence and went out after it."""
    with running(bench, SILENCE_S) as controller:
        os.kill(controller.process.pid, signal.SIGSTOP)
        until(lambda: phase_of(bench) == "safe")
        hold(chamber_config(bench), 60.0)
        until(lambda: setpoint_c(bench[2]) == 25.0)


@pytest.mark.slow
def test_ctrl_z_is_refused_with_a_line(bench):
    with running(bench, stderr=subprocess.PIPE) as controller:
        os.kill(controller.process.pid, signal.SIGTSTP)
        os.kill(controller.process.pid, signal.SIGTTIN)
        os.kill(controller.process.pid, signal.SIGTTOU)
        seen = len(controller.lines)
        until(lambda: len(controller.lines) > seen + 3)
        assert not controller.is_stopped()
        controller.process.terminate()
        assert controller.end()[-1] == "outcome interrupted True stopped by SIGTERM"
        assert controller.process.stderr is not None
        with controller.process.stderr as stderr:
            assert "Ctrl-Z is refused" in stderr.read()


def test_the_handlers_of_a_sitting_refuse_to_be_stopped(capfd):
    control = RunControl()
    with signals_to(control):
        for number in (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU):
            os.kill(os.getpid(), number)
        control.check()  # none of them ended the test
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(TestInterruptedError, match="stopped by SIGTERM"):
            control.check()
    assert capfd.readouterr().err.count("Ctrl-Z is refused") == 1
    assert signal.getsignal(signal.SIGTSTP) == signal.SIG_DFL


def test_a_line_that_nobody_reads_is_not_waited_for(monkeypatch):
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    with os.fdopen(writing, "w") as full, monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", full)
        say_at_once("a line")  # would never return
    os.close(reading)
