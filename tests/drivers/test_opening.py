import math

import pytest
from pydantic import ValidationError

from drivers import opening
from drivers.clock import SteppedClock
from drivers.emulators.station import EmulatedStation
from drivers.errors import DeviceError, LimitError, LinkError
from drivers.opening import open_station
from drivers.station import StationConfig
from tests.drivers.conftest import BenchPlant


def station_config(**sections) -> StationConfig:
    data = {
        "chamber": {
            "model": "watlow_f4t",
            "url": "modbus+tcp://127.0.0.1:0",
            "timeout_s": 0.2,
            "limits_c": (-40.0, 80.0),
        },
        "digitiser": {"url": "serial://auto", "timeout_s": 0.2},
        "head": {"url": "serial://auto", "timeout_s": 0.2, "limits_deg": (-180.0, 180.0)},
        "inputs": [{"serial": "QA-1", "output_channel": 101, "thermistor_channel": 111}],
    }
    for name, more in sections.items():
        data[name] = data.get(name, {}) | more
    return StationConfig.model_validate(data)


@pytest.fixture
def emulated():
    with EmulatedStation(station_config(), BenchPlant(), SteppedClock()) as station:
        yield station


def test_opens_what_the_emulators_serve(emulated):
    with open_station(emulated.config) as station:
        said = station.identify()
        assert set(said) == {"chamber", "digitiser", "head"}
        assert "34970A" in said["digitiser"]
        assert "ESP301" in said["head"]
        settings = station.read_settings()
        assert settings["head"]["unit"] == 7.0
        assert station.config is emulated.config


def test_limits_of_every_device_come_from_the_file(emulated):
    with open_station(emulated.config) as station:
        station.identify()
        before = {name: d.counters.exchanges for name, d in station.devices.items()}
        for refused in (81.0, -41.0, math.nan):
            with pytest.raises(LimitError):
                station.chamber.hold_temp_c(refused)
        for refused in (181.0, -181.0, math.nan):
            with pytest.raises(LimitError):
                station.head.move_to_deg(refused)
        assert {name: d.counters.exchanges for name, d in station.devices.items()} == before


def test_opening_says_nothing_to_the_instruments(emulated):
    with open_station(emulated.config) as station:
        assert all(d.counters.exchanges == 0 for d in station.devices.values())


class Recorded:
    """A device that keeps whether it was closed."""

    def __init__(self, name: str, fails: bool = False) -> None:
        self.name, self.fails, self.closed = name, fails, 0

    def close(self) -> None:
        self.closed += 1
        if self.fails:
            raise OSError("stuck")

    def identify(self) -> str:
        return self.name


def test_what_was_opened_is_closed_when_the_next_cannot_be(monkeypatch):
    chamber, digitiser = Recorded("chamber", fails=True), Recorded("digitiser")
    monkeypatch.setattr(opening, "open_chamber", lambda *_, **__: chamber)
    monkeypatch.setattr(opening, "ScanningMultimeter", lambda *_, **__: digitiser)
    config = station_config(head={"url": "serial:///no/such/port"})
    with pytest.raises(LinkError, match=r"head at serial:///no/such/port: cannot be opened"):
        open_station(config)
    assert chamber.closed == digitiser.closed == 1


def test_all_are_closed_when_one_fails_to(monkeypatch):
    devices = [Recorded("chamber", fails=True), Recorded("digitiser", fails=True), Recorded("head")]
    monkeypatch.setattr(opening, "open_chamber", lambda *_, **__: devices[0])
    monkeypatch.setattr(opening, "ScanningMultimeter", lambda *_, **__: devices[1])
    monkeypatch.setattr(opening, "MotionHead", lambda *_: devices[2])
    station = open_station(station_config())
    station.close()
    assert [d.closed for d in devices] == [1, 1, 1]


@pytest.mark.parametrize("section", ["chamber", "digitiser", "head"])
@pytest.mark.parametrize("url", ["", "file:///etc/passwd", "ftp://x", "/dev/ttyUSB0"])
def test_a_url_of_another_scheme_is_refused_with_the_station_file(section, url):
    with pytest.raises(ValidationError, match=r"url .*: expected ") as caught:
        station_config(**{section: {"url": url}})
    assert [error["loc"] for error in caught.value.errors()] == [(section, "url")]


@pytest.mark.parametrize(
    ("section", "url"),
    [
        *(("chamber", u) for u in ("modbus+tcp://", "modbus+rtu://", "modbus+tcp://[::1:3")),
        *(("digitiser", u) for u in ("serial://", "socket://[::1:3", "socket://x")),
        *(("head", u) for u in ("serial://", "socket://[::1:3", "socket://x")),
    ],
)
def test_a_url_that_leads_nowhere_is_one_line_with_the_device(section, url):
    wrong = {section: getattr(station_config(**{section: {"url": url}}), section)}
    with EmulatedStation(station_config(), BenchPlant(), SteppedClock()) as emulated:
        config = emulated.config.model_copy(update=wrong)
        with pytest.raises(LinkError) as caught:
            open_station(config)
    assert str(caught.value).startswith(section)
    assert "\n" not in str(caught.value)


def test_the_wrong_instrument_on_a_port_is_noticed(emulated):
    swapped = emulated.config.model_copy(
        update={
            "digitiser": emulated.config.digitiser.model_copy(
                update={"url": emulated.config.head.url, "retries": 0}
            ),
            "head": emulated.config.head.model_copy(
                update={"url": emulated.config.digitiser.url, "retries": 0}
            ),
        }
    )
    with open_station(swapped) as station:
        with pytest.raises((LinkError, DeviceError)):
            station.digitiser.identify()
        with pytest.raises((LinkError, DeviceError)):
            station.head.identify()
