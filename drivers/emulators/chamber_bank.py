"""Parts of emulated chamber controllers: register cells and a set point in time."""

import math
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.clock import Clock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.modbus_frames import RefusedError
from drivers.emulators.plant import Plant
from drivers.station import PanelAction

RUNAWAY_C_PER_S = 0.1
ROOM_C, DRIFT_C_PER_S = 23.0, 1.0 / 60.0  # where a chamber without power goes, and how fast
PANEL_STEP_C = 20.0  # what somebody adds at the panel, if nothing else is said
ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3


@dataclass(frozen=True, slots=True)
class Cell:
    """One value in the register space; `put` None: read-only.

    `form` is "h" (int16), "H" (uint16), "E" (uint16 in the first of two registers), "f" (float,
    low word first) or "F" (float, high word first).
    """

    form: str
    get: Callable[[], float]
    put: Callable[[float], None] | None = None

    @property
    def size(self) -> int:
        """Registers it takes."""
        return 2 if self.form in "fFE" else 1

    def words(self) -> list[int]:
        """Return what a client reads."""
        if self.form in "fF":
            high, low = struct.unpack(">HH", struct.pack(">f", self.get()))
            return [low, high] if self.form == "f" else [high, low]
        value = round(self.get()) & 0xFFFF
        return [value, 0][: self.size]

    def store(self, words: Sequence[int]) -> None:
        """Take what a client wrote."""
        if self.put is None:
            raise RefusedError(ILLEGAL_ADDRESS)
        if self.form in "fF":
            if len(words) != 2:
                raise RefusedError(ILLEGAL_VALUE)  # half a float
            high, low = words if self.form == "F" else (words[1], words[0])
            value: float = struct.unpack(">f", struct.pack(">HH", high, low))[0]
            if not math.isfinite(value):
                raise RefusedError(ILLEGAL_VALUE)
        else:
            value = words[0] - 0x10000 if self.form == "h" and words[0] > 0x7FFF else words[0]
        self.put(float(value))


class Loop:
    """The set point in emulated time, and the heater behind it; not locked, its owner is.

    Parameters
    ----------
    plant : Plant
        Is told where the set point goes.
    faults : FaultPlan
        Asked for the states: stuck temperature, sensor break, over-temperature.
    start_c : float
        Set point at the beginning.
    now_s : float
        The beginning.
    trip_c : float
        Above it the limit controller cuts the runaway heater off.
    """

    def __init__(
        self, plant: Plant, faults: FaultPlan, *, start_c: float, now_s: float, trip_c: float
    ) -> None:
        self._plant, self._faults, self._trip_c = plant, faults, trip_c
        self.now_s = now_s
        self.tripped = False
        self.broken = False
        self.alarm = False
        self.powered = True
        self._away = False
        self._stuck_c: float | None = None
        self._begin_s, self._from_c, self.target_c, self._rate = now_s, start_c, start_c, math.inf

    def go(
        self, target_c: float, rate_c_per_s: float = math.inf, from_c: float | None = None
    ) -> None:
        """Send the set point to `target_c`, by default from where it is, at once."""
        self._from_c = self.setpoint_c() if from_c is None else from_c
        self._begin_s, self.target_c, self._rate = self.now_s, target_c, rate_c_per_s
        if not self.tripped:
            self._drive()

    def setpoint_c(self) -> float:
        """Return the set point in force now."""
        way = self.target_c - self._from_c
        if math.isinf(self._rate) or self._rate * (self.now_s - self._begin_s) >= abs(way):
            return self.target_c
        return self._from_c + math.copysign(self._rate * (self.now_s - self._begin_s), way)

    def switch(self, *, powered: bool) -> None:
        """Let the loop heat and cool, or leave the chamber to the room."""
        if powered != self.powered:
            self.powered = powered
            if not self.tripped:
                self._drive()

    def is_ramping(self) -> bool:
        """Tell whether the set point moves now."""
        return self.setpoint_c() != self.target_c

    def temp_c(self) -> float:
        """Return what the sensor shows."""
        if self._faults.active("stuck_temperature"):
            if self._stuck_c is None:
                self._stuck_c = self._plant.air_temp_c(self.now_s)
            return self._stuck_c
        self._stuck_c = None
        return self._plant.air_temp_c(self.now_s)

    def advance(self, now_s: float) -> None:
        """Bring the states of the faults up to date."""
        self.now_s = max(now_s, self.now_s)
        self.broken = self._faults.active("sensor_break")
        self.alarm = self._faults.active("over_temperature")
        if self.alarm and not self._away and not self.tripped:
            self._away = True
            self._plant.break_away(self.now_s, RUNAWAY_C_PER_S)
        if self._away and self._plant.air_temp_c(self.now_s) > self._trip_c:
            self.tripped, self._away = True, False
            self._plant.break_away(self.now_s, 0.0)  # the heater is cut off
        if not self.alarm and (self._away or self.tripped):
            self.tripped = self._away = False
            self._plant.break_away(self.now_s, None)
            self._drive()

    def take_panel_actions(self) -> list[tuple[PanelAction, float | None]]:
        """Return what somebody has done at the panel since."""
        return self._faults.take_panel_actions()

    def _drive(self) -> None:
        if not self.powered:
            air_c = self._plant.air_temp_c(self.now_s)
            self._plant.drive_chamber(self.now_s, air_c, ROOM_C, DRIFT_C_PER_S)
            return
        self._plant.drive_chamber(self.now_s, self.setpoint_c(), self.target_c, self._rate)


class Controller(ABC):
    """A register bank over a loop; the models fill in the cells. Thread-safe.

    Parameters
    ----------
    loop : Loop
    clock : Clock
    decimals : int
        Of the integer-scaled models.
    word_order : "low" or "high"
        Which half of a float the F4T sends first.
    limits_c : (float, float)
        The controller's own set point limits.
    """

    def __init__(
        self,
        loop: Loop,
        clock: Clock,
        *,
        decimals: int,
        word_order: Literal["low", "high"] = "low",
        limits_c: tuple[float, float],
    ) -> None:
        self.loop, self.limits_c, self.decimals = loop, limits_c, decimals
        self.float_form = "f" if word_order == "low" else "F"
        self.fahrenheit = False  # what the registers say of the unit
        self.factor = 10.0**decimals
        self._clock = clock
        self._lock = threading.RLock()
        self._cells = self.cells()
        self._owner = {a + i: (a, c) for a, c in self._cells.items() for i in range(c.size)}

    @abstractmethod
    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""

    @abstractmethod
    def set_target(self, temp_c: float) -> None:
        """Take a set point, from a client or at the panel."""

    @abstractmethod
    def switch_off(self) -> None:
        """Take the loop out of control, as somebody does at the panel."""

    @abstractmethod
    def start_profile(self, temp_c: float) -> None:
        """Run somebody's profile, which goes to `temp_c` and stays."""

    def operate(self, action: PanelAction, temp_c: float | None = None) -> None:
        """Do what somebody does at the panel.

        Parameters
        ----------
        action : PanelAction
            "setpoint_changed", "loop_off" or "foreign_profile".
        temp_c : float, optional
            The set point he enters, °C; 20 °C more than the present one if not given.
        """
        with self._lock:
            self._advance()
            self._do_at_panel(action, temp_c)

    def tick(self) -> None:  # noqa: B027  most controllers have nothing that becomes due
        """Do what became due; called before every access."""

    def read(self, address: int, count: int) -> list[int]:
        """Return words; refuses when one of them does not exist."""
        with self._lock:
            self._advance()
            return [self._word(a) for a in range(address, address + count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Store words, whole cells only."""
        with self._lock:
            self._advance()
            at = 0
            while at < len(words):
                cell = self._cells.get(address + at)
                if cell is None:
                    raise RefusedError(ILLEGAL_ADDRESS)
                cell.store(words[at : at + cell.size])
                at += cell.size

    def _advance(self) -> None:
        self.loop.advance(self._clock.now_s())
        self.tick()
        for action, temp_c in self.loop.take_panel_actions():
            self._do_at_panel(action, temp_c)

    def _do_at_panel(self, action: PanelAction, temp_c: float | None) -> None:
        if temp_c is None:
            temp_c = min(self.loop.target_c + PANEL_STEP_C, self.limits_c[1])
        if action == "setpoint_changed":
            self.set_target(temp_c)
        elif action == "loop_off":
            self.switch_off()
        else:
            self.start_profile(temp_c)

    def _word(self, address: int) -> int:
        if address not in self._owner:
            raise RefusedError(ILLEGAL_ADDRESS)
        start, cell = self._owner[address]
        return cell.words()[address - start]

    # ---- makers of cells

    def scaled(self, get: Callable[[], float], put: Callable[[float], None] | None = None) -> Cell:
        """Return a cell of a temperature times 10 to the decimals; what does not fit is cut."""

        def show() -> float:
            return max(-32768.0, min(32767.0, get() * self.factor))

        def take(raw: float) -> None:
            if put is not None:
                put(raw / self.factor)

        return Cell("h", show, None if put is None else take)

    def slot(self, memory: dict[str, float], key: str, allowed: Sequence[int] = (), form: str = "h"
             ) -> Cell:  # fmt: skip
        """Return a cell that keeps what is written, of the allowed values."""

        def put(value: float) -> None:
            if allowed and value not in allowed:
                raise RefusedError(ILLEGAL_VALUE)
            memory[key] = value

        return Cell(form, lambda: memory[key], put)

    def checked(self, temp_c: float) -> float:
        """Return a set point that lies in the limits, or refuse."""
        if not self.limits_c[0] <= temp_c <= self.limits_c[1]:
            raise RefusedError(ILLEGAL_VALUE)
        return temp_c
