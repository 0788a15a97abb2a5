"""Whoever looks at a test, and whatever becomes of him, the test is not held up by it."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest

from drivers.chambers.open import open_chamber
from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from tests.accelbench.commands.run.display_process import (
    ENVIRONMENT,
    PATIENCE_S,
    ROOT,
    SHORT,
    asked,
    count,
    ended,
    events,
    program,
    screen,
    started,
    wait_until,
)

STATION = ROOT / "examples/stations/f4t.toml"
READINGS = 112  # of examples/sequences/short.toml: 2 runs of 7 min, every 15 s, 2 accelerometers
pytestmark = pytest.mark.timeout(600)


@contextmanager
def a_reader_that_has_gone():
    """The writing end of a pipe that nobody reads."""
    read, write = os.pipe()
    os.close(read)
    try:
        yield write
    finally:
        os.close(write)


@pytest.fixture
def bench(tmp_path):
    """A station file whose instruments are served by another process."""
    text = STATION.read_text(encoding="utf-8").replace("/dev/ttyUSB", str(tmp_path / "tty"))
    text += "\n[emulation]\nspeed = 120.0\n"
    station = tmp_path / "station.toml"
    station.write_text(text.replace("192.0.2.10:502", "127.0.0.1:0"), encoding="utf-8")
    command = program("emulate", station, "--json")
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as served:
        assert served.stdout is not None
        url = json.loads(served.stdout.readline())["urls"]["chamber"]
        station.write_text(text.replace("modbus+tcp://192.0.2.10:502", url), encoding="utf-8")
        yield station


@pytest.mark.slow
def test_ctrl_s_stops_neither_the_readings_nor_the_end(bench, tmp_path):
    store = tmp_path / "s.sqlite"
    command = program("run", SHORT, "--station", bench, "--store", store, still_s=0.5)
    with screen() as terminal:
        ends = {"stdout": terminal.slave, "stderr": terminal.slave}
        with started(command, stdin=terminal.slave, **ends) as process:
            terminal.read_along()
            wait_until(lambda: count(store) > 10 and b"run 1" in terminal.seen, process)
            terminal.press(b"\x13")
            then = count(store)
            wait_until(lambda: count(store) > then + 20, process)
            process.send_signal(signal.SIGTERM)
            # it still is stopped: nobody has pressed Ctrl-Q
            assert process.wait(PATIENCE_S) == 1
    assert b"interrupted" not in terminal.seen
    assert ended(store) == ("interrupted", "stopped by SIGTERM", True)
    chamber = read_toml(bench, StationConfig).chamber
    with_chamber = open_chamber(chamber)
    try:
        assert with_chamber.read_setpoint_c() == chamber.safe_temp_c
    finally:
        with_chamber.close()


@pytest.mark.slow
def test_what_was_held_back_by_ctrl_s_comes_with_ctrl_q(tmp_path):
    store = tmp_path / "s.sqlite"
    command = program("run", SHORT, "--store", store, still_s=PATIENCE_S)
    with (
        screen() as terminal,
        started(
            command, stdin=terminal.slave, stdout=terminal.slave, stderr=terminal.slave
        ) as process,
    ):
        terminal.read_along()
        wait_until(lambda: count(store) > 10, process)
        terminal.press(b"\x13")
        wait_until(lambda: asked(store, "select 1 from tests where status = 'finished'"), process)
        terminal.press(b"\x11")
        assert process.wait(PATIENCE_S) == 0
    assert b"finished: all runs done" in terminal.seen
    assert b"safe condition verified" in terminal.seen


def test_a_terminal_that_nobody_drains_from_the_start_changes_nothing(tmp_path):
    store = tmp_path / "s.sqlite"
    command = program("run", SHORT, "--store", store, still_s=0.5)
    with screen() as terminal:
        terminal.fill()
        with started(command, stdout=terminal.slave, stderr=terminal.slave) as process:
            assert process.wait(PATIENCE_S) == 0
    assert ended(store) == ("finished", "all runs done", True)
    assert count(store) == READINGS


@pytest.mark.slow
def test_a_result_gets_where_it_goes_though_the_terminal_stands_still(tmp_path):
    store, result = tmp_path / "s.sqlite", tmp_path / "result.json"
    command = program("run", SHORT, "--store", store, "--json", still_s=0.5)
    with screen() as terminal, result.open("wb") as file:
        terminal.fill()
        with started(command, stdout=file, stderr=terminal.slave) as process:
            assert process.wait(PATIENCE_S) == 0
    document = json.loads(result.read_text(encoding="utf-8"))
    assert (document["status"], document["readings"]) == ("finished", READINGS)


@pytest.mark.parametrize("stop", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_reader_that_goes_away_is_told_in_the_store_and_the_code_is_the_tests(tmp_path, stop):
    store = tmp_path / "s.sqlite"
    more = ("--speed", "200") if stop else ()
    command = program("run", SHORT, "--store", store, *more)
    with (
        a_reader_that_has_gone() as pipe,
        started(command, stdout=pipe, stderr=pipe) as process,
    ):
        if stop:
            wait_until(lambda: events(store, "display lost"), process)
            process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == (1 if stop else 0)
    (told,) = events(store, "display lost")
    assert "Broken pipe" in told
    ((outcome, safe),) = asked(store, "select outcome, safe_result_json from tests")
    assert outcome == ("stopped by SIGTERM" if stop else "all runs done")
    assert json.loads(safe)["verified"] is True


@pytest.mark.parametrize(
    "closed",
    [
        *(pytest.param(one, marks=pytest.mark.slow) for one in (">&-", "2>&-", ">&- 2>&-")),
        "<&- >&- 2>&-",
    ],
)
def test_streams_that_are_closed_from_the_start(tmp_path, closed):
    store = tmp_path / "s.sqlite"
    command = shlex.join(program("run", SHORT, "--store", store, "--out", tmp_path / "run.csv"))
    done = subprocess.run(
        ["bash", "-c", f"{command} {closed}"], env=ENVIRONMENT, capture_output=True, check=False
    )
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    assert ended(store) == ("finished", "all runs done", True)
    assert len((tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()) == READINGS + 1


@pytest.mark.parametrize(
    "what", ["fit", *(pytest.param(one, marks=pytest.mark.slow) for one in ("run", "runs"))]
)
def test_head_takes_one_line_and_the_work_is_done_all_the_same(tmp_path, two_runs, what):
    store, model = tmp_path / "s.sqlite", tmp_path / "model.json"
    arguments = {
        "run": ("run", SHORT, "--store", store),
        "fit": ("fit", two_runs, "--out", model),
        "runs": ("runs", "--store", store),
    }[what]
    if what == "runs":
        made = program("run", SHORT, "--store", store)
        subprocess.run(made, env=ENVIRONMENT, capture_output=True, check=True)
    line = f"set -o pipefail; {shlex.join(program(*arguments))} | head -1"
    done = subprocess.run(["bash", "-c", line], env=ENVIRONMENT, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(b"\n") == 1
    assert b"Traceback" not in done.stderr
    if what == "fit":
        assert model.is_file()
    if what == "run":
        assert ended(store) == ("finished", "all runs done", True)


@pytest.mark.slow
def test_a_full_disk_under_the_result_is_told_and_only_a_tests_code_stands(tmp_path, two_runs):
    for arguments, code in (
        (("fit", two_runs), 2),
        (("run", SHORT, "--store", tmp_path / "s.sqlite"), 0),
    ):
        with open("/dev/full", "wb") as full:
            done = subprocess.run(
                program(*arguments),
                env=ENVIRONMENT,
                stdout=full,
                stderr=subprocess.PIPE,
                check=False,
            )
        assert done.returncode == code
        last = done.stderr.splitlines()[-1]
        assert last == b"accelbench: standard output: cannot be written: No space left on device"


def test_ctrl_c_over_and_over_does_not_keep_the_outcome_from_being_told(tmp_path):
    store = tmp_path / "s.sqlite"
    command = program("run", SHORT, "--store", store, "--speed", "200", "--json")
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: count(store) > 4, process)
        give_up = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < give_up:
            process.send_signal(signal.SIGINT)
            time.sleep(0.002)
        assert process.returncode == 1
        assert process.stdout is not None
        document = json.loads(process.stdout.read())
    assert document["reason"] == "stopped by SIGINT"
    assert document["safe"]["verified"] is True
    assert ended(store) == ("interrupted", "stopped by SIGINT", True)


@pytest.mark.slow
def test_a_folder_that_vanishes_hides_neither_the_outcome_nor_the_way_to_the_readings(tmp_path):
    store, folder = tmp_path / "s.sqlite", tmp_path / "out"
    folder.mkdir()
    out = folder / "run.csv"
    command = program("run", SHORT, "--store", store, "--out", out, "--json")
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: count(store) > 4, process)
        shutil.rmtree(folder)
        assert process.stdout is not None
        document = json.loads(process.stdout.read())
        assert process.wait(PATIENCE_S) == 1
    assert document["status"] == "finished"
    assert document["safe"]["verified"] is True
    assert document["exported"] == []
    problem, way = document["problems"]
    assert problem.startswith(f"not exported to {out}: ")
    folder.mkdir()
    _, arguments = way.split("accelbench ", 1)
    again = subprocess.run(
        program(*shlex.split(arguments)), env=ENVIRONMENT, capture_output=True, check=False
    )
    assert again.returncode == 0, again.stderr
    assert len(out.read_text(encoding="utf-8").splitlines()) == READINGS + 1
