"""Emulated controllers with a ramp of the set point of their own: Watlow F4T, Eurotherm 3504.

The addresses were written down a second time, from the same sources as the drivers' maps and not
from the maps: a slip in one shows as a disagreement.
"""

import math

from drivers.emulators.chamber_bank import ILLEGAL_VALUE, Cell, Controller
from drivers.emulators.modbus_frames import RefusedError


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
