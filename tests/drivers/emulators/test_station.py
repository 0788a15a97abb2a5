import os
import socket

import pytest

from drivers.clock import ScaledClock, SteppedClock
from drivers.devices import ScanChannel
from drivers.emulators.station import EmulatedStation
from drivers.opening import open_station
from tests.drivers.conftest import BenchPlant
from tests.drivers.test_opening import station_config

CHANNELS = (
    ScanChannel(number=101, quantity="voltage", full_scale=10.0),
    ScanChannel(number=111, quantity="resistance", full_scale=1e6),
)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as s:
        return s.getsockname()[1]


def run_through(station, clock) -> None:
    """Use all three: they are one station on one plant."""
    station.identify()
    station.chamber.hold_temp_c(40.0)
    station.head.move_to_deg(45.0)
    station.digitiser.configure(CHANNELS)
    clock.sleep_until_s(clock.now_s() + 30.0)
    assert not station.head.is_moving()
    assert station.head.read_position_deg() == 45.0
    assert station.chamber.read_temp_c() == pytest.approx(40.0, abs=0.1)
    readings = station.digitiser.scan()
    assert [r.channel for r in readings] == [101, 111]
    assert readings[1].value == 11_100.0


@pytest.mark.parametrize(
    "urls",
    [
        ("modbus+tcp://127.0.0.1:0", "serial://auto", "serial:///auto"),
        ("modbus+rtu://auto", "socket://127.0.0.1:0", "serial://auto"),
        ("modbus+rtu+tcp://127.0.0.1:0", "serial://auto", "socket://127.0.0.1:0"),
    ],
)
def test_free_ports_are_picked_and_told(urls):
    sections = zip(("chamber", "digitiser", "head"), urls, strict=True)
    wanted = station_config(**{name: {"url": url} for name, url in sections})
    clock = SteppedClock()
    with EmulatedStation(wanted, BenchPlant(), clock) as emulated:
        config = emulated.config
        for section in ("chamber", "digitiser", "head"):
            url = getattr(config, section).url
            assert not url.endswith((":0", "auto"))
            assert url.split(":")[0] == getattr(wanted, section).url.split(":")[0]
        assert config.inputs == wanted.inputs
        with open_station(config, clock=clock) as station:
            run_through(station, clock)
    if "pts" in (path := os.path.realpath(config.digitiser.url.removeprefix("serial://"))):
        pytest.fail(f"the link to {path} was left behind")


@pytest.mark.parametrize("model", ["watlow_f4t", "watlow_f4", "eurotherm_3504"])
def test_addresses_and_links_are_made_as_asked(tmp_path, model):
    port = free_port()
    wanted = station_config(
        chamber={"url": f"modbus+rtu://{tmp_path}/chamber", "model": model},
        digitiser={"url": f"serial://{tmp_path}/meter"},
        head={"url": f"socket://127.0.0.1:{port}", "axis": 3},
    )
    clock = SteppedClock()
    with EmulatedStation(wanted, BenchPlant(), clock) as emulated:
        assert emulated.config == wanted
        with open_station(wanted, clock=clock) as station:
            run_through(station, clock)
    assert list(tmp_path.iterdir()) == []


def test_on_a_running_clock_time_passes_between_scans():
    clock = ScaledClock(200.0)
    with (
        EmulatedStation(station_config(), BenchPlant(), clock) as emulated,
        open_station(emulated.config, clock=clock) as station,
    ):
        station.digitiser.configure(CHANNELS)
        called_s = clock.now_s()
        first = station.digitiser.scan()[0]
        back_s = clock.now_s()
        # 1e-4 V/s, over and over every 1e4 s: the value tells when it was measured
        after_s = (first.value - 1.01) / 1e-4 - called_s % 1e4
        assert -0.1 <= after_s % 1e4 <= back_s - called_s + 0.1


def test_planned_and_injected_faults_reach_their_device():
    faults = {"faults": [{"device": "head", "kind": "silence", "at_s": 5.0}]}
    wanted = station_config(emulation=faults)
    clock = SteppedClock(100.0)
    emulated = EmulatedStation(wanted, BenchPlant(), clock)
    clock.sleep_until_s(200.0)  # a plan counts from the start
    with emulated, open_station(emulated.config) as station:
        station.identify()
        assert station.head.counters.retries == 0
        clock.sleep_until_s(206.0)
        station.head.read_position_deg()
        assert station.head.counters.retries == 1
        emulated.inject("digitiser", "dropped_connection")
        emulated.inject("chamber", "dropped_connection")
        station.digitiser.identify()
        station.chamber.read_temp_c()
        assert station.digitiser.counters.reconnects == 1
        assert station.chamber.counters.reconnects >= 1
        with pytest.raises(ValueError, match="expected one of chamber, digitiser, head"):
            emulated.inject("oven", "silence")


def test_nothing_is_left_running_when_one_cannot_start(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        wanted = station_config(
            digitiser={"url": f"serial://{tmp_path}/meter"},
            head={"url": f"socket://127.0.0.1:{taken.getsockname()[1]}"},
        )
        emulated = EmulatedStation(wanted, BenchPlant(), SteppedClock())
        with pytest.raises(OSError, match="in use"):
            emulated.start()
        assert list(tmp_path.iterdir()) == []
        with pytest.raises(RuntimeError, match="not started"):
            _ = emulated.config
    emulated.start()  # the address is free now
    emulated.close()
    emulated.close()
