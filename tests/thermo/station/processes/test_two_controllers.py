"""Two controllers of one chamber: the second commands nothing."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from drivers.station import StationConfig
from tests.thermo.station.processes.guard_bench import until
from tests.thermo.station.processes.processes import Controller, chamber_config, hold, setpoint_c
from thermo.launch.real import run_on_station
from thermo.planning.sequence import load_sequence
from thermo.safety.chamber_lock import ChamberHeldError
from thermo.safety.guarded_sitting import take_lock
from thermo.station.job import make_job
from thermo.store.store import open_store


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
