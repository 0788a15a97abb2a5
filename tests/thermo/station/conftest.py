"""A station without wires: devices in memory on the physical twin, and whatever goes wrong."""

import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.clock import SteppedClock
from drivers.devices import ChannelReading, LinkCounters, Range, SafeResult, ScanChannel
from drivers.opening import Station
from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.planning.sequence import Sequence, parse_sequence
from thermo.store.store import Store, open_store
from thermo.twin.plant import Twin, make_plant

ROOT = Path(__file__).parents[3]
Hook = Callable[[str], None]


@dataclass
class World:
    """The plant, the clock, and a hook that may raise before any call on any device."""

    config: StationConfig
    plant: Twin
    clock: SteppedClock
    hook: Hook = lambda _: None
    calls: list[str] = field(default_factory=list)
    setpoint_c: float = 25.0
    ramping: bool = False

    def call(self, name: str) -> float:
        self.calls.append(name)
        self.hook(name)
        return self.clock.now_s()

    @property
    def is_safe(self) -> bool:
        return not self.ramping and self.setpoint_c == self.config.chamber.safe_temp_c


class FakeDevice:
    def __init__(self, world: World, name: str) -> None:
        self.world = world
        self.name = name
        self.counters = LinkCounters()

    def identify(self) -> str:
        self.world.call(f"{self.name}.identify")
        return f"fake {self.name}"

    def read_settings(self) -> Mapping[str, str | float]:
        return {}

    def close(self) -> None:
        pass


class FakeChamber(FakeDevice):
    limits_c = Range(lo=-55, hi=85)
    rate_limits_c_per_min = Range(lo=0.05, hi=5)
    stuck_c: float | None = None
    alarms: tuple[str, ...] = ()

    recognition: Mapping[str, float | str] = {}
    occupation: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()

    def read_occupation(self) -> tuple[str, ...]:
        self.world.call("chamber.read_occupation")
        return self.occupation

    def read_foreign_changes(self) -> tuple[str, ...]:
        self.world.call("chamber.read_foreign_changes")
        return self.foreign

    def read_temp_c(self) -> float:
        now_s = self.world.call("chamber.read_temp_c")
        here_c = self.world.plant.air_temp_c(now_s)
        return here_c if self.stuck_c is None else self.stuck_c

    def read_setpoint_c(self) -> float:
        self.world.call("chamber.read_setpoint_c")
        return self.world.setpoint_c

    def hold_temp_c(self, temp_c: float) -> None:
        now_s = self.world.call("chamber.hold_temp_c")
        self.world.setpoint_c, self.world.ramping = temp_c, False
        self.world.plant.drive_chamber(now_s, temp_c, temp_c, math.inf)

    def ramp_to_c(self, temp_c: float, rate_c_per_min: float) -> None:
        now_s = self.world.call("chamber.ramp_to_c")
        self.world.setpoint_c, self.world.ramping = temp_c, True
        start_c = self.world.plant.air_temp_c(now_s)
        self.world.plant.drive_chamber(now_s, start_c, temp_c, rate_c_per_min / 60)

    def read_alarms(self) -> tuple[str, ...]:
        self.world.call("chamber.read_alarms")
        return self.alarms

    def make_safe(self, temp_c: float) -> SafeResult:
        self.world.call("chamber.make_safe")
        self.world.setpoint_c, self.world.ramping = temp_c, False
        now_s = self.world.clock.now_s()
        self.world.plant.drive_chamber(now_s, temp_c, temp_c, math.inf)
        return SafeResult(verified=True, steps=("held", "read back"))


class FakeDigitiser(FakeDevice):
    channels: Many[ScanChannel] = ()
    spoil: Callable[[ChannelReading], ChannelReading] = staticmethod(lambda reading: reading)

    def configure(self, channels: Many[ScanChannel], *, nplc: float = 1.0) -> None:
        self.world.call("digitiser.configure")
        self.channels = channels

    def scan(self) -> tuple[ChannelReading, ...]:
        now_s = self.world.call("digitiser.scan")
        return tuple(
            self.spoil(
                ChannelReading(
                    channel=c.number,
                    value=self.world.plant.channel_value(now_s, c.number),
                    offset_s=0.02 * k,
                )
            )
            for k, c in enumerate(self.channels)
        )


class FakeHead(FakeDevice):
    limits_deg = Range(lo=-360, hi=360)
    speed_deg_per_s = 40.0

    def move_to_deg(self, angle_deg: float) -> None:
        now_s = self.world.call("head.move_to_deg")
        self.world.plant.turn_head(now_s, angle_deg, self.speed_deg_per_s)

    def is_moving(self) -> bool:
        return self.world.plant.head_is_moving(self.world.call("head.is_moving"))

    def read_position_deg(self) -> float:
        return self.world.plant.head_deg(self.world.call("head.read_position_deg"))

    def stop(self) -> None:
        self.world.plant.stop_head(self.world.call("head.stop"))


@pytest.fixture
def config() -> StationConfig:
    return read_toml(ROOT / "examples/stations/f4t.toml", StationConfig)


@pytest.fixture
def world(config: StationConfig) -> World:
    return World(config=config, plant=make_plant(config), clock=SteppedClock())


@pytest.fixture
def station(world: World) -> Station:
    return Station(
        chamber=FakeChamber(world, "chamber"),
        digitiser=FakeDigitiser(world, "digitiser"),
        head=FakeHead(world, "head"),
        config=world.config,
    )


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    # in memory where that can be had: every reading and event waits for the disk otherwise, and
    # what a store survives is tested with the store
    memory = Path("/dev/shm")
    where = memory if os.access(memory, os.W_OK) else tmp_path
    with (
        tempfile.TemporaryDirectory(dir=where) as folder,
        open_store(Path(folder) / "store.sqlite") as opened,
    ):
        yield opened


@pytest.fixture
def edit_sequence() -> Callable[..., Sequence]:
    """Return a function that reads examples/sequences/short.toml with pieces of text exchanged."""

    def edited(*pairs: tuple[str, str]) -> Sequence:
        text = (ROOT / "examples/sequences/short.toml").read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in text, old
            text = text.replace(old, new, 1)
        return parse_sequence(text)

    return edited


@pytest.fixture
def short(edit_sequence: Callable[..., Sequence]) -> Sequence:
    return edit_sequence()
