"""How long silence may last, and what a service manager hears."""

import os
import socket
from pathlib import Path

import pytest

from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.planning.silence import longest_step_s, silence_limit_s
from thermo.safety.heartbeat import notify_service, watchdog_s

ROOT = Path(__file__).parents[3]


@pytest.fixture
def config() -> StationConfig:
    return read_toml(ROOT / "examples/stations/f4t.toml", StationConfig)


def test_the_limit_is_the_longest_step_and_the_margin_of_the_station_file(
    config: StationConfig,
) -> None:
    # 34970A: 3 attempts of 5 × 10 s and six channels of 40 ms, 60 ms and 40 characters at 57600
    channels_s = 6 * (0.04 + 0.06 + 400 / 57600)
    assert longest_step_s(config) == pytest.approx(3 * (50 + channels_s))
    assert silence_limit_s(config) == pytest.approx(longest_step_s(config) + 30)
    guarded = config.model_copy(update={"guardian": config.guardian.model_copy(
        update={"margin_s": 5.0})})  # fmt: skip
    assert silence_limit_s(guarded) == pytest.approx(longest_step_s(config) + 5)


@pytest.mark.parametrize("name", ["chamber", "digitiser", "head"])
@pytest.mark.parametrize("key", ["timeout_s", "retries"])
def test_a_more_patient_instrument_never_shortens_the_limit(
    config: StationConfig, name: str, key: str
) -> None:
    before_s = longest_step_s(config)
    patient = getattr(config, name).model_copy(update={key: 20})
    assert longest_step_s(config.model_copy(update={name: patient})) > before_s


def test_a_store_that_may_take_longer_sets_the_limit(config: StationConfig) -> None:
    assert longest_step_s(config, store_s=1000.0) == 1000.0


def test_a_serial_controller_is_given_the_time_to_come_into_step(config: StationConfig) -> None:
    slow = config.chamber.model_copy(update={"timeout_s": 10.0})
    over_rtu = slow.model_copy(update={"url": "modbus+rtu:///dev/ttyUSB0"})
    times_s = [longest_step_s(config.model_copy(update={"chamber": c})) for c in (slow, over_rtu)]
    assert times_s[1] == 2 * times_s[0]


@pytest.mark.parametrize("abstract", [False, True])
def test_the_service_manager_hears_what_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, abstract: bool
) -> None:
    where = f"@accelbench-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + where[1:] if abstract else where)
        manager.settimeout(10)
        monkeypatch.setenv("NOTIFY_SOCKET", where)
        notify_service("READY=1", "STATUS=test T")
        assert manager.recv(4096) == b"READY=1\nSTATUS=test T"


@pytest.mark.parametrize("where", ["", "relative", "/no/such/socket", "@nobody-listens"])
def test_where_nobody_listens_nothing_fails(monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", where)
    notify_service("WATCHDOG=1")


def test_a_manager_that_does_not_read_delays_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(where)
        monkeypatch.setenv("NOTIFY_SOCKET", where)
        for _ in range(5000):  # far more than its queue holds: a waiting send would never return
            notify_service("WATCHDOG=1")


@pytest.mark.parametrize(("text", "expected"), [("30000000", 30.0), ("x", None), ("", None)])
def test_the_watchdog_s_time_is_read(
    monkeypatch: pytest.MonkeyPatch, text: str, expected: float | None
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", text)
    assert watchdog_s() == expected
    monkeypatch.delenv("WATCHDOG_USEC")
    assert watchdog_s() is None
