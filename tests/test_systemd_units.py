"""The units for systemd: commands that the program takes, times that fit one another."""

import configparser
import re
import shlex
from pathlib import Path

import click
import pytest

from accelbench.cli import accelbench
from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.planning.silence import silence_limit_s
from thermo.station.safe_end import RETRY_S

ROOT = Path(__file__).parents[1]
UNITS = sorted((ROOT / "examples/systemd").glob("*.service"))
SECONDS = {"s": 1.0, "min": 60.0}


def read(path: Path) -> configparser.ConfigParser:
    unit = configparser.ConfigParser(interpolation=None, strict=True)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(path.read_text(encoding="utf-8"))
    return unit


def seconds(text: str) -> float:
    match = re.fullmatch(r"(\d+)(s|min)", text)
    assert match is not None
    return float(match[1]) * SECONDS[match[2]]


@pytest.mark.parametrize("path", UNITS, ids=lambda p: p.name)
def test_every_command_of_a_unit_is_one_the_program_takes(path: Path) -> None:
    lines = [v for k, v in read(path)["Service"].items() if k.startswith("Exec")]
    assert lines
    for line in lines:
        program, name, *words = shlex.split(line)
        assert program.endswith("/accelbench")
        context = click.Context(accelbench)
        command = accelbench.get_command(context, name)
        assert command is not None
        command.make_context(name, words)  # raises on an option or argument it does not know


def test_the_guardian_is_before_the_watchdog_and_the_clean_up_before_the_kill() -> None:
    service = read(ROOT / "examples/systemd/accelbench@.service")["Service"]
    for path in (ROOT / "examples/stations").glob("*.toml"):
        limit_s = silence_limit_s(read_toml(path, StationConfig))
        assert limit_s < seconds(service["WatchdogSec"])
    assert seconds(service["TimeoutStopSec"]) > RETRY_S
    assert service["ExecStopPost"].endswith("make-safe station.toml --interrupted")
    assert service["KillMode"] == "mixed"


def test_what_a_failed_test_starts_is_there_and_goes_on_trying() -> None:
    unit = read(ROOT / "examples/systemd/accelbench@.service")
    follower = ROOT / "examples/systemd" / unit["Unit"]["OnFailure"].replace("%i", "")
    assert follower in UNITS
    both = [read(path)["Service"] for path in (UNITS[0], UNITS[1])]
    assert both[0]["User"] == both[1]["User"]
    assert both[0]["WorkingDirectory"] == both[1]["WorkingDirectory"]
    assert read(follower)["Service"]["Restart"] == "on-failure"
    assert read(follower)["Unit"]["StartLimitIntervalSec"] == "0"
