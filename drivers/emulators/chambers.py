"""Emulated chamber controllers: their registers, set point machinery, profiles, limits and alarms.

The addresses here were written down a second time, from the same sources as the drivers' maps and
not from the maps: a slip in one shows as a disagreement.
"""

import math
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from drivers.clock import Clock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.modbus_server import ModbusServer, RefusedError, Transport
from drivers.emulators.plant import Plant

Model = Literal["watlow_f4t", "watlow_f4", "eurotherm_3504"]
RUNAWAY_C_PER_S = 0.1
ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3


@dataclass(frozen=True, slots=True)
class Cell:
    """One value in the register space; `put` None: read-only.

    `form` is "h" (int16), "H" (uint16), "E" (uint16 in the first of two registers) or "f" (float,
    low word first).
    """

    form: str
    get: Callable[[], float]
    put: Callable[[float], None] | None = None

    @property
    def size(self) -> int:
        """Registers it takes."""
        return 2 if self.form in "fE" else 1

    def words(self) -> list[int]:
        """Return what a client reads."""
        if self.form == "f":
            high, low = struct.unpack(">HH", struct.pack(">f", self.get()))
            return [low, high]
        value = round(self.get()) & 0xFFFF
        return [value, 0][: self.size]

    def store(self, words: Sequence[int]) -> None:
        """Take what a client wrote."""
        if self.put is None:
            raise RefusedError(ILLEGAL_ADDRESS)
        if self.form == "f":
            if len(words) != 2:
                raise RefusedError(ILLEGAL_VALUE)  # half a float
            value: float = struct.unpack(">f", struct.pack(">HH", words[1], words[0]))[0]
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

    def _drive(self) -> None:
        self._plant.drive_chamber(self.now_s, self.setpoint_c(), self.target_c, self._rate)


class Controller:
    """A register bank over a loop; the models fill in the cells. Thread-safe.

    Parameters
    ----------
    loop : Loop
    clock : Clock
    decimals : int
        Of the integer-scaled models.
    limits_c : (float, float)
        The controller's own set point limits.
    """

    def __init__(
        self, loop: Loop, clock: Clock, *, decimals: int, limits_c: tuple[float, float]
    ) -> None:
        self.loop, self.limits_c, self.decimals = loop, limits_c, decimals
        self.factor = 10.0**decimals
        self._clock = clock
        self._lock = threading.RLock()
        self._cells = self.cells()
        self._owner = {a + i: (a, c) for a, c in self._cells.items() for i in range(c.size)}

    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""
        raise NotImplementedError

    def tick(self) -> None:
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


class F4T(Controller):
    """Watlow F4T, loop 1."""

    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""
        self.memory = {"mode": 10.0, "action": 62.0, "scale": 57.0, "rate": 1.0, "profile": 61.0}
        memory, loop = self.memory, self.loop
        cells = {
            1328: Cell("E", lambda: 15),
            2730: self.slot(memory, "mode", (10, 54, 62), "E"),
            2774: Cell("f", lambda: self.limits_c[0]),
            2776: Cell("f", lambda: self.limits_c[1]),
            2778: Cell("f", lambda: 0.0),
            2782: Cell("f", lambda: loop.target_c, self.set_target),
            2794: self.slot(memory, "action", (62, 88, 85, 13), "E"),
            2796: self.slot(memory, "scale", (57, 39), "E"),
            2798: Cell("f", lambda: memory["rate"], self.set_rate),
            2810: Cell("f", loop.setpoint_c),
            2814: Cell("E", lambda: memory["mode"]),
            2820: Cell("f", lambda: math.nan if loop.broken else loop.temp_c()),
            11250: Cell("E", lambda: 28 if loop.tripped or loop.broken else 61),
            11264: Cell("E", lambda: 138),
            11288: Cell("E", lambda: 65 if loop.broken else 61),
            16566: Cell("E", lambda: 61, self.act_on_profile),
            16568: self.slot(memory, "profile", (61, 149, 146, 1783), "E"),
        }
        for i in range(4):  # the first alarm is a high process alarm
            cells[1356 + 100 * i] = Cell(
                "E", lambda i=i: 37 if i == 0 and (loop.alarm or loop.broken) else 61
            )
        return cells

    def tick(self) -> None:
        """Switching the ramp off lets the set point jump to its target."""
        if self.memory["action"] in (62, 88) and self.loop.is_ramping():
            self.loop.go(self.loop.target_c)

    def set_target(self, temp_c: float) -> None:
        """Take a set point; the ramp action says how to get there."""
        per_s = 60.0 if self.memory["scale"] == 57 else 3600.0
        ramps = self.memory["action"] in (85, 13)
        self.loop.go(self.checked(temp_c), self.memory["rate"] / per_s if ramps else math.inf)

    def set_rate(self, rate: float) -> None:
        """Take a ramp rate; a ramp under way goes on with it."""
        if not 0 <= rate <= 99999:
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["rate"] = rate
        if self.loop.is_ramping():
            self.set_target(self.loop.target_c)

    def act_on_profile(self, code: float) -> None:
        """Pause or terminate a profile."""
        if code not in (146, 148):
            raise RefusedError(ILLEGAL_VALUE)
        if self.memory["profile"] != 61:
            self.memory["profile"] = 146.0 if code == 146 else 61.0


class Eurotherm(Controller):
    """Eurotherm 3504, loop 1."""

    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""
        self.memory = {"rate": 0.0, "no_rate": 1.0, "mode": 0.0, "remote": 0.0, "program": 1.0}
        memory, loop = self.memory, self.loop
        return {
            1: self.scaled(lambda: 999.9 if loop.broken else loop.temp_c()),
            2: self.scaled(lambda: loop.target_c, self.set_target),
            3: Cell("h", lambda: 0),
            4: Cell("h", lambda: 0),
            5: self.scaled(loop.setpoint_c),
            35: Cell("h", lambda: memory["rate"], self.set_rate),
            75: Cell("H", self.status),
            78: self.slot(memory, "no_rate", (0, 1)),
            273: self.slot(memory, "mode", (0, 1)),
            276: self.slot(memory, "remote", (0, 1)),
            5195: self.slot(memory, "program", (1, 2, 4, 8, 16)),
            5229: Cell("h", lambda: 0, self.reset_program),
        }

    def tick(self) -> None:
        """Disabling the rate limit lets the working set point jump to its target."""
        if self.memory["no_rate"] and self.loop.is_ramping():
            self.loop.go(self.loop.target_c)

    def set_target(self, temp_c: float) -> None:
        """Take a target set point; the rate limit says how to get there."""
        rate, free = self.memory["rate"], bool(self.memory["no_rate"])
        limited = rate > 0 and not free
        self.loop.go(self.checked(temp_c), rate / 10 / 60 if limited else math.inf)

    def set_rate(self, raw: float) -> None:
        """Take the rate limit, tenths of °C/min; 0 is off."""
        if raw < 0:
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["rate"] = raw
        if self.loop.is_ramping():
            self.set_target(self.loop.target_c)

    def status(self) -> float:
        """Return the status word."""
        alarm = self.loop.alarm or self.loop.tripped
        return alarm | self.loop.broken << 5 | self.loop.is_ramping() << 13

    def reset_program(self, value: float) -> None:
        """End the program."""
        if value:
            self.memory["program"] = 1.0


def _empty_step(kind: int) -> dict[int, float]:
    """Return a profile step with nothing filled in."""
    fields = (4009, 4010, 4011, 4012, 4043, 4044, 4048, 4060)
    return {4003: float(kind)} | dict.fromkeys(fields, 0.0)


class F4(Controller):
    """Watlow F4, channel 1, with its memory of 40 profiles."""

    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""
        self.profiles: dict[int, list[dict[int, float]]] = {}
        self.names = {a: 32.0 for a in range(3500, 3900)}
        self.chosen = {"profile": 1.0, "step": 1.0}
        self.running: int | None = None
        self.step = 0
        loop = self.loop
        cells = {
            25: Cell("h", lambda: 0, lambda value: None),
            100: self.scaled(lambda: 999.9 if loop.broken else loop.temp_c()),
            101: Cell("h", lambda: loop.broken),
            200: Cell("h", lambda: 1 if self.running is None else 2),
            300: self.scaled(lambda: self.static_c, self.set_static),
            602: self.scaled(lambda: self.limits_c[0]),
            603: self.scaled(lambda: self.limits_c[1]),
            606: Cell("h", lambda: self.decimals),
            901: Cell("h", lambda: 1),
            1217: Cell("h", lambda: 0, self.terminate),
            1218: Cell("h", lambda: 40 - len(self.profiles)),
            4000: self.slot(self.chosen, "profile", range(1, 41)),
            4001: self.slot(self.chosen, "step", range(1, 257)),
            4002: Cell("h", lambda: 0, self.act),
            4100: Cell("h", lambda: self.running or 0),
            4101: Cell("h", lambda: self.step + 1 if self.running else 0),
            4122: self.scaled(loop.setpoint_c),
        }
        self.static_c = loop.target_c
        cells |= {a: Cell("h", lambda: 0) for a in range(1916, 1922)}
        cells |= {a: self.field(a) for a in _empty_step(5)}
        for a in self.names:
            cells[a] = Cell("h", lambda a=a: self.names[a], lambda v, a=a: self.set_name(a, v))
        return cells

    def field(self, address: int) -> Cell:
        """Return the cell of one field of the chosen step."""

        def get() -> float:
            profile = self.profiles.get(int(self.chosen["profile"]), [])
            at = int(self.chosen["step"]) - 1
            # past the end there is nothing; a step type above 5 says so
            return profile[at][address] if at < len(profile) else (6.0 if address == 4003 else 0.0)

        def put(value: float) -> None:
            self.chosen_step()[address] = value

        return Cell("h", get, put)

    def chosen_step(self) -> dict[int, float]:
        """Return the step the edit registers speak of."""
        profile = self.profiles.get(int(self.chosen["profile"]))
        at = int(self.chosen["step"]) - 1
        if profile is None or at >= len(profile):
            raise RefusedError(ILLEGAL_VALUE)
        return profile[at]

    def set_name(self, address: int, value: float) -> None:
        """Take one character of a profile's name."""
        self.names[address] = value

    def set_static(self, temp_c: float) -> None:
        """Take the static set point; it is in force when no profile runs."""
        self.static_c = self.checked(temp_c)
        if self.running is None:
            self.loop.go(temp_c)

    def act(self, code: float) -> None:
        """Do an edit action or start a profile."""
        number, at = int(self.chosen["profile"]), int(self.chosen["step"]) - 1
        if code == 1:
            free = [n for n in range(1, 41) if n not in self.profiles]
            if not free:
                raise RefusedError(ILLEGAL_VALUE)
            self.profiles[free[0]] = [_empty_step(5)]
            self.chosen["profile"] = float(free[0])
        elif code == 2 and number in self.profiles and at < len(self.profiles[number]):
            self.profiles[number].insert(at, _empty_step(3))
        elif code == 3 and number in self.profiles:
            del self.profiles[number]
        elif code == 5 and number in self.profiles and at < len(self.profiles[number]):
            self.terminate(1)
            self.checked(self.profiles[number][at][4044] / self.factor)
            self.running, self.step = number, at
            self.begin_step()
        else:
            raise RefusedError(ILLEGAL_VALUE)

    def begin_step(self) -> None:
        """Start the present step of the running profile."""
        assert self.running is not None
        step = self.profiles[self.running][self.step]
        self.step_begin_s = self.loop.now_s
        target_c = step[4044] / self.factor
        if step[4003] == 2 and step[4043] > 0:
            self.loop.go(self.checked(target_c), step[4043] / 10 / 60)
        elif step[4003] == 1:
            seconds = 3600 * step[4009] + 60 * step[4010] + step[4011]
            way = abs(target_c - self.loop.setpoint_c())
            self.loop.go(self.checked(target_c), way / seconds if seconds else math.inf)
        elif step[4003] == 5:  # the set point the profile came to becomes the static one
            self.static_c = self.loop.setpoint_c()
            self.running = None

    def tick(self) -> None:
        """Go on to the next step when the ramp has arrived."""
        while self.running is not None and not self.loop.is_ramping():
            self.step += 1
            self.begin_step()

    def terminate(self, value: float) -> None:
        """End the profile; the static set point is in force again."""
        if value and self.running is not None:
            self.running = None
            self.loop.go(self.static_c)


_CONTROLLERS: Mapping[Model, type[Controller]] = {
    "watlow_f4t": F4T,
    "watlow_f4": F4,
    "eurotherm_3504": Eurotherm,
}


class ChamberEmulator:
    """A chamber controller on a real socket or pseudo-terminal.

    Parameters
    ----------
    model : str
        As in the station file.
    plant : Plant
        The chamber's physics.
    clock : Clock
        The emulation's time.
    faults : FaultPlan
        What goes wrong.
    transport : "tcp", "rtu+tcp" or "rtu"
    unit_id, decimals : int
        As in the station file.
    limits_c : (float, float)
        The controller's own set point limits, °C.
    trip_c : float
        Temperature at which the limit controller trips, °C.
    host, port, path
        Where to listen; port 0 takes a free one. `path` is the symbolic link to the
        pseudo-terminal, None: in a new temporary directory.
    """

    def __init__(
        self,
        model: Model,
        plant: Plant,
        clock: Clock,
        faults: FaultPlan,
        *,
        transport: Transport = "tcp",
        unit_id: int = 1,
        decimals: int = 1,
        limits_c: tuple[float, float] = (-75.0, 180.0),
        trip_c: float = 100.0,
        host: str = "127.0.0.1",
        port: int = 0,
        path: Path | None = None,
    ) -> None:
        now_s = clock.now_s()
        start_c = min(max(plant.air_temp_c(now_s), limits_c[0]), limits_c[1])
        loop = Loop(plant, faults, start_c=start_c, now_s=now_s, trip_c=trip_c)
        self.controller = _CONTROLLERS[model](loop, clock, decimals=decimals, limits_c=limits_c)
        self._server = ModbusServer(
            self.controller, faults, transport=transport, unit_id=unit_id,
            host=host, port=port, path=path,
        )  # fmt: skip

    @property
    def url(self) -> str:
        """What goes into the station file; known once started."""
        return self._server.url

    def start(self) -> None:
        """Open the port and serve."""
        self._server.start()

    def close(self) -> None:
        """Stop serving; harmless when done twice."""
        self._server.close()

    def __enter__(self) -> "ChamberEmulator":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
