"""A test on an emulated station in processes of their own, with its guardian."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.thermo.station.processes.processes import Controller, chamber_config, newest_test
from tests.thermo.station.there_and_stay import there_and_stay
from thermo.safety.chamber_lock import find_holder
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian_record import read_record
from thermo.safety.guardian_results import result_file

ROOT = Path(__file__).parents[4]
SPEED = 60.0
SILENCE_S = "3"  # real; three times what a loaded machine was seen to keep a process waiting
SEQUENCE = there_and_stay(
    serials="A", hold_min=0.5, to_c=45.0, rate_c_per_min=0.5, stay_min=300.0, period_s=60.0
)


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
