"""An emulated chamber on a wire, with everything that belongs to it."""

import contextlib

from drivers.chambers.models import CHAMBER_MODELS
from drivers.chambers.open import open_chamber
from drivers.clock import SteppedClock
from drivers.devices import Chamber
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.errors import LinkError, ProtocolError
from drivers.station import ChamberConfig
from tests.drivers.ideal_plant import IdealPlant

MODELS = tuple(CHAMBER_MODELS)
TRANSPORTS = ("tcp", "rtu", "rtu+tcp")
PATIENT_S = 2.0  # where no time limit is to run out, however busy the machine
TIMEOUT_S = 0.08
LATE_S = 0.12  # after the asker gave up, before the line has been quiet for another time limit
VERY_LATE_S = 0.3  # after that too
RESOLUTION_C = 0.051  # of a controller with one decimal, and rounding


class Bench:
    """An emulated chamber with everything that belongs to it."""

    def __init__(
        self,
        model: str,
        transport: str,
        *,
        lag_s: float = 0.0,
        late_s: float = LATE_S,
        decimals: int = 1,
    ) -> None:
        self.decimals = decimals
        self.clock = SteppedClock(1000.0)
        self.plant = IdealPlant(air_c=23.4, lag_s=lag_s)
        self.faults = FaultPlan([], "chamber", self.clock, late_s=late_s)
        self.emulator = ChamberEmulator(
            model, self.plant, self.clock, self.faults, transport=transport, decimals=decimals
        )
        self.emulator.start()
        self.model = model
        self.opened: list[Chamber] = []
        self.chamber = self.recognised()

    def recognised(self, **more) -> Chamber:
        chamber = self.open(**more)
        sooner_or_later(chamber.identify)
        return chamber

    def open(self, **more) -> Chamber:
        settings = {"timeout_s": PATIENT_S, "baud": 115200, "decimals": self.decimals} | more
        config = ChamberConfig(model=self.model, url=self.emulator.url, **settings)
        self.opened.append(open_chamber(config))
        return self.opened[-1]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until_s(self.clock.now_s() + seconds)

    def reopen(self, **more) -> None:
        self.chamber.close()
        self.chamber = self.recognised(**more)

    def close(self) -> None:
        for chamber in self.opened:
            chamber.close()
        self.emulator.close()


def sooner_or_later(ask):
    """Ask until there is an answer: a busy machine is no fault of the link's."""
    for _ in range(10):
        with contextlib.suppress(LinkError, ProtocolError):
            return ask()
    return ask()
