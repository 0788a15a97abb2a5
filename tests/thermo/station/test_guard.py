"""Nobody is believed alive: controllers and guardians stopped, killed, doubled and relieved."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest

from accelbench.cli import main
from accelbench.commands.run import make_safe_work as commands_safe
from drivers.devices import SafeResult
from drivers.errors import FencedError, LinkError
from drivers.station import StationConfig
from tests.thermo.station.processes import (
    Controller,
    chamber_config,
    hold,
    newest_test,
    serving,
    setpoint_c,
)
from tests.thermo.station.there_and_stay import there_and_stay
from thermo.launch import make_safe as making_safe
from thermo.launch.make_safe import make_station_safe
from thermo.launch.real import (
    load_station,
    run_on_station,
    say_at_once,
    signals_to,
)
from thermo.planning.sequence import load_sequence
from thermo.planning.silence import silence_limit_s
from thermo.safety import guardian_process
from thermo.safety.chamber_lock import ChamberHeldError, find_holder
from thermo.safety.commanded_note import Commanded, forget_commanded, note_commanded, read_commanded
from thermo.safety.guarded_sitting import Guard, take_lock
from thermo.safety.guardian_record import read_record
from thermo.safety.guardian_results import result_file
from thermo.safety.processes import process_state
from thermo.station.job import make_job
from thermo.station.outcome import RunControl, TestInterruptedError
from thermo.store.store import open_store

ROOT = Path(__file__).parents[3]
SPEED = 60.0
SILENCE_S = "3"  # real; three times what a loaded machine was seen to keep a process waiting
SEQUENCE = there_and_stay(
    serials="A", hold_min=0.5, to_c=45.0, rate_c_per_min=0.5, stay_min=300.0, period_s=60.0
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("guard"), SEQUENCE, SPEED) as served:
        yield served


def until(condition: Callable[[], object], patience_s: float = 180) -> None:
    give_up = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)


@contextmanager
def running(
    bench, *args: str, stderr: int = subprocess.DEVNULL, **env: str
) -> Iterator[Controller]:
    """A test whose ramp has begun; killed at the end, with the guardian done."""
    controller = Controller(*bench, "-", *args, stderr=stderr, **env)
    try:
        controller.wait_for("event segment", 180)
        until(lambda: controller.lines.count("event segment") > 1)  # the ramp
        yield controller
    finally:
        controller.process.kill()
        controller.end()
        take_lock(chamber_config(bench)).release()


def guardian_pid(bench) -> int:
    found: list[int] = []

    def asked() -> bool:
        holder = find_holder(chamber_config(bench))
        if holder is not None and holder.guardian_pid is not None:
            found.append(holder.guardian_pid)
        return bool(found)

    until(asked)
    return found[-1]


def phase_of(bench) -> str:
    record = read_record(result_file(bench[3], newest_test(bench[3])))
    return "" if record is None else record.phase


def station_file(bench, folder: Path) -> Path:
    path = folder / "station.toml"
    path.write_text(
        f'[chamber]\nmodel = "watlow_f4t"\nurl = "{chamber_config(bench).url}"\n'
        '[digitiser]\nurl = "serial:///dev/null"\n[head]\nurl = "serial:///dev/null"\n'
        '[[inputs]]\nserial = "A"\noutput_channel = 101\nthermistor_channel = 201\n',
        encoding="utf-8",
    )
    return path


def make_safe(path: Path, *options: str) -> tuple[int, dict]:
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from accelbench.cli import main; sys.exit(main())",
         "make-safe", str(path), "--json", *options],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    return done.returncode, json.loads(done.stdout)


# ---- the controller is silent


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


# ---- the guardian is dead, stopped, or cannot be replaced


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


@pytest.fixture
def sitting(bench, tmp_path):
    """A controller's hold on the chamber, in this process."""
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    with Guard(config, take_lock(config.chamber), limit_s=60.0) as made:
        yield made
    take_lock(config.chamber).release()


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


# ---- two controllers


def test_a_controller_that_finds_the_chamber_held_commands_nothing(bench, sitting, tmp_path):
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    other = config.chamber.model_copy(
        update={"url": config.chamber.url.replace("127.0.0.1", "localhost"), "unit_id": 2}
    )
    hold(config.chamber, 40.0)
    with pytest.raises(ChamberHeldError, match=f"process {os.getpid()}, .*not commanded"):
        run_on_station(
            make_job(
                load_sequence(bench[1]),
                tmp_path / "other.sqlite",
                config.model_copy(update={"chamber": other}),
            )
        )
    assert setpoint_c(bench[2]) == 40.0
    with open_store(tmp_path / "other.sqlite") as store:
        assert not store.tests()


@pytest.mark.slow
def test_of_two_controllers_the_second_commands_nothing(bench, tmp_path):
    """Other spelling, other TMPDIR, other store, 0.2 s later."""
    speed, sequence, config_path, _ = bench
    text = Path(config_path).read_text(encoding="utf-8")
    other = tmp_path / "other.json"
    other.write_text(text.replace("127.0.0.1", "localhost"), encoding="utf-8")
    assert "localhost" in other.read_text(encoding="utf-8")
    first = Controller(*bench, "-")
    time.sleep(0.2)
    second = Controller(
        speed,
        sequence,
        str(other),
        str(tmp_path / "other.sqlite"),
        "-",
        stderr=subprocess.PIPE,
        TMPDIR=str(tmp_path),
    )
    try:
        # whichever came first with its imports has the chamber
        until(lambda: first.process.poll() is not None or second.process.poll() is not None)
        winner, loser = (second, first) if first.process.poll() is not None else (first, second)
        assert loser.process.returncode != 0
        assert not any(line.startswith(("outcome", "event")) for line in loser.end())
        if loser is second:
            assert second.process.stderr is not None
            told = second.process.stderr.read()
            assert f"process {first.process.pid}" in told
            assert "not commanded" in told
        winner.wait_for("event segment", 180)
        winner.process.terminate()
        assert winner.end()[-1] == "outcome interrupted True stopped by SIGTERM"
    finally:
        for controller in (first, second):
            controller.process.kill()
            controller.end()
            if controller.process.stderr is not None:
                controller.process.stderr.close()
        take_lock(chamber_config(bench)).release()


# ---- make-safe


@pytest.mark.slow
def test_a_chamber_whose_controller_and_guardian_died_is_made_safe_by_command(bench, tmp_path):
    path = station_file(bench, tmp_path)
    with running(bench) as controller:
        os.kill(guardian_pid(bench), signal.SIGKILL)
        controller.process.kill()
        controller.process.wait(30)
        hold(chamber_config(bench), 50.0)  # nobody is left who would notice
        record = read_record(result_file(bench[3], newest_test(bench[3])))
        assert record is not None
        assert record.needs_help
        code, document = make_safe(path, "--interrupted")
        assert (code, document["verified"]) == (0, True)
        assert document["interrupted_test"] == newest_test(bench[3])
        assert setpoint_c(bench[2]) == 25.0
        record = read_record(result_file(bench[3], newest_test(bench[3])))
        assert record is not None
        assert record.verified
        assert "make-safe" in record.text
    hold(chamber_config(bench), 40.0)
    code, document = make_safe(path, "--interrupted")
    assert (code, document["needed"], document["commanded"]) == (0, False, False)
    assert setpoint_c(bench[2]) == 40.0
    code, document = make_safe(path)
    assert (code, document["verified"], document["held_by"]) == (0, True, None)
    assert setpoint_c(bench[2]) == 25.0


@pytest.mark.slow
def test_a_test_that_runs_is_not_disturbed_unless_that_is_wanted(bench, tmp_path):
    path = station_file(bench, tmp_path)
    with running(bench) as controller:
        code, document = make_safe(path)
        assert (code, document["verified"], document["commanded"]) == (1, False, False)
        assert f"process {controller.process.pid}" in document["held_by"]
        assert newest_test(bench[3]) in document["held_by"]
        code, document = make_safe(path, "--force")
        assert (code, document["verified"], document["held_by"]) == (0, True, None)
        assert controller.end()[-1] == "outcome interrupted True stopped by SIGTERM"
        assert setpoint_c(bench[2]) == 25.0


def test_a_chamber_that_a_sitting_holds_is_left_to_it(bench, sitting, tmp_path):
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    sitting.start("T7", {}, tmp_path / "g.json")
    hold(config.chamber, 40.0)
    made = make_station_safe(config, patience_s=0.0)
    assert not made.done
    assert not made.safe.commanded
    assert f"process {os.getpid()}" in made.held_by
    assert setpoint_c(bench[2]) == 40.0
    sitting.end(SafeResult(verified=True, steps=()))
    made = make_station_safe(config, interrupted_only=True)
    assert made.done
    assert not made.needed
    assert setpoint_c(bench[2]) == 40.0
    assert make_station_safe(config).done
    assert setpoint_c(bench[2]) == 25.0


def test_one_that_does_not_end_when_asked_is_told_beside_the_safe_chamber(
    bench, sitting, tmp_path, monkeypatch
):
    config = StationConfig.model_validate_json(Path(bench[2]).read_text(encoding="utf-8"))
    sitting.start("T8", {}, tmp_path / "g.json")
    hold(config.chamber, 40.0)
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(making_safe.os, "kill", lambda pid, number: asked.append((pid, number)))
    made = make_station_safe(config, force=True, patience_s=0.0, abort_s=0.0)
    assert asked[0] == (os.getpid(), signal.SIGTERM)
    assert made.safe.verified
    assert not made.done
    assert f"process {os.getpid()}" in made.held_by
    assert setpoint_c(bench[2]) == 25.0
    sitting.end(SafeResult(verified=True, steps=()))


def test_make_safe_takes_no_bad_station_file(tmp_path, capsys):
    path = tmp_path / "station.toml"
    path.write_text("[chamber]\n", encoding="utf-8")
    assert main(["make-safe", str(path)]) == 2
    told = capsys.readouterr().err
    assert str(path) in told
    assert told.count("\n") == 1


def test_a_chamber_out_of_reach_is_told_with_exit_code_1(bench, tmp_path, capsys, monkeypatch):
    path = station_file(bench, tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(chamber_config(bench).url, "modbus+tcp://127.0.0.1:9"))
    monkeypatch.setattr(commands_safe, "make_station_safe", partial(make_station_safe, retry_s=0.0))
    assert main(["make-safe", str(path)]) == 1
    assert "NOT VERIFIED" in capsys.readouterr().out


# ---- the service manager


def test_a_service_manager_hears_a_sitting_s_beats(bench, sitting, tmp_path, monkeypatch):
    where = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(where)
        manager.settimeout(30)
        monkeypatch.setenv("NOTIFY_SOCKET", where)
        monkeypatch.setenv("WATCHDOG_USEC", "1000")
        sitting.start("T", {}, tmp_path / "g.json")
        sitting.beat()
        assert manager.recv(4096) == b"READY=1\nSTATUS=test T"
        assert manager.recv(4096) == b"WATCHDOG=1"
        sitting.end(SafeResult(verified=True, steps=()))


@pytest.mark.slow
def test_a_service_manager_hears_the_test_begin_and_its_heart(bench, tmp_path):
    where = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(where)
        manager.settimeout(60)
        with running(bench, NOTIFY_SOCKET=where) as controller:
            assert manager.recv(4096).startswith(b"READY=1")
            for _ in range(3):
                assert manager.recv(4096) == b"WATCHDOG=1"
            os.kill(controller.process.pid, signal.SIGSTOP)
            until(controller.is_stopped)
            manager.setblocking(False)
            with pytest.raises(BlockingIOError):  # noqa: PT012
                while True:  # what was sent before
                    manager.recv(4096)
            time.sleep(2 * 0.5)  # two beats' time
            with pytest.raises(BlockingIOError):
                manager.recv(4096)
