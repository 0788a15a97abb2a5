"""Controllers and emulated stations in processes of their own."""

import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from drivers.chambers.open import open_chamber
from drivers.station import StationConfig
from thermo.planning.sequence import load_sequence
from thermo.safety.processes import process_state
from thermo.store.store import open_store

HERE = Path(__file__).parent
SPEED = 300.0


class Controller:
    """A controller process and everything it has said."""

    def __init__(self, *args: str, stderr: int = subprocess.DEVNULL, **environment: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "controller_process.py"), *args],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            env=os.environ | environment,
        )
        self.lines: list[str] = []
        self.spoke = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            # a line the kill has torn was not said
            if line.endswith("\n"):
                self.lines.append(line.strip())
                self.spoke.set()

    def end(self) -> list[str]:
        self.process.wait(60)
        self._reader.join(10)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return self.lines

    def is_stopped(self) -> bool:
        return process_state(self.process.pid)[0] == "stopped"

    def wait_for(self, start: str, patience_s: float = 180) -> None:
        give_up = time.monotonic() + patience_s
        while not any(line.startswith(start) for line in self.lines):
            assert time.monotonic() < give_up, self.lines[-5:]
            ended = self.process.poll()
            if ended is not None:
                self._reader.join(10)
                assert any(line.startswith(start) for line in self.lines), (ended, self.lines[-5:])
            time.sleep(0.005)


@contextmanager
def serving(tmp_path, sequence_text, speed=SPEED):
    """An emulated station in a process of its own; yields what a controller has to be told."""
    sequence = tmp_path / "sequence.toml"
    sequence.write_text(sequence_text, encoding="utf-8")
    load_sequence(sequence)
    process = subprocess.Popen(
        [sys.executable, str(HERE / "emulator_process.py"), str(speed), str(sequence)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdin is not None
    try:
        line = process.stdout.readline()
        config = tmp_path / "station.json"
        config.write_text(line, encoding="utf-8")
        yield str(speed), str(sequence), str(config), str(tmp_path / "store.sqlite")
    finally:
        process.stdin.close()
        process.stdout.close()
        process.wait(20)


def setpoint_c(config_path: str) -> float:
    config = StationConfig.model_validate_json(Path(config_path).read_text(encoding="utf-8"))
    chamber = open_chamber(config.chamber)
    try:
        return chamber.read_setpoint_c()
    finally:
        chamber.close()


def newest_test(store_path: str) -> str:
    with open_store(store_path) as store:
        tests = store.tests()
    return tests[-1].id if tests else "-"


def chamber_config(bench):
    text = Path(bench[2]).read_text(encoding="utf-8")
    return StationConfig.model_validate_json(text).chamber


def hold(config, temp_c: float) -> None:
    chamber = open_chamber(config)
    chamber.identify()  # nothing is written to what was not recognised
    chamber.hold_temp_c(temp_c)
    chamber.close()
