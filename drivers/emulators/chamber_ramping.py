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
        self.static_c = loop.target_c
        cells = {
            1328: Cell("E", self.units),
            2730: Cell("E", lambda: memory["mode"], self.set_mode),
            2774: Cell(self.float_form, lambda: self.limits_c[0]),
            2776: Cell(self.float_form, lambda: self.limits_c[1]),
            2778: Cell(self.float_form, lambda: 0.0),
            2782: Cell(self.float_form, lambda: self.static_c, self.set_target),
            2794: self.slot(memory, "action", (62, 88, 85, 13), "E"),
            2796: self.slot(memory, "scale", (57, 39), "E"),
            2798: Cell(self.float_form, lambda: memory["rate"], self.set_rate),
            2810: Cell(self.float_form, loop.setpoint_c),
            2814: Cell("E", lambda: memory["mode"]),
            2820: Cell(self.float_form, lambda: math.nan if loop.broken else loop.temp_c()),
            11250: Cell("E", lambda: 28 if loop.tripped or loop.broken else 61),
            11264: Cell("E", lambda: 138),
            11288: Cell("E", lambda: 65 if loop.broken else 61),
            6730: Cell("E", self.units),
            14080: Cell("E", self.units),
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

    def units(self) -> float:
        """Return the code of the unit."""
        return 30 if self.fahrenheit else 15

    def set_mode(self, code: float) -> None:
        """Take a control mode; off and manual, with no power here, leave the chamber alone."""
        if code not in (10, 54, 62):
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["mode"] = code
        self.loop.switch(powered=code == 10)

    def switch_off(self) -> None:
        """Switch the loop off."""
        self.set_mode(62)

    def start_profile(self, temp_c: float) -> None:
        """Have a profile put the set point in force; the static one waits."""
        self.memory["profile"] = 149.0
        self.loop.go(temp_c)

    def set_target(self, temp_c: float) -> None:
        """Take a set point, in force unless a profile runs; the ramp action says how fast."""
        self.static_c = self.checked(temp_c)
        if self.memory["profile"] != 61:
            return
        per_s = 60.0 if self.memory["scale"] == 57 else 3600.0
        ramps = self.memory["action"] in (85, 13)
        self.loop.go(temp_c, self.memory["rate"] / per_s if ramps else math.inf)

    def set_rate(self, rate: float) -> None:
        """Take a ramp rate; a ramp under way goes on with it."""
        if not 0 <= rate <= 99999:
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["rate"] = rate
        if self.loop.is_ramping():
            self.set_target(self.static_c)

    def act_on_profile(self, code: float) -> None:
        """Pause or terminate a profile."""
        if code not in (146, 148):
            raise RefusedError(ILLEGAL_VALUE)
        if self.memory["profile"] != 61:
            self.memory["profile"] = 146.0 if code == 146 else 61.0
            if code == 148:
                self.set_target(self.static_c)


class Eurotherm(Controller):
    """Eurotherm 3504, loop 1."""

    def cells(self) -> dict[int, Cell]:
        """Return the register space by address."""
        self.memory = {"rate": 0.0, "no_rate": 1.0, "mode": 0.0, "remote": 0.0, "program": 1.0}
        memory, loop = self.memory, self.loop
        self.static_c = loop.target_c
        return {
            0x8002: Cell("F", lambda: 999.9 if loop.broken else loop.temp_c()),
            0x8004: Cell("F", lambda: self.static_c),
            1: self.scaled(lambda: 999.9 if loop.broken else loop.temp_c()),
            2: self.scaled(lambda: self.static_c, self.set_target),
            3: Cell("h", lambda: 0),
            4: Cell("h", lambda: 0),
            5: self.scaled(loop.setpoint_c),
            35: Cell("h", lambda: memory["rate"], self.set_rate),
            75: Cell("H", self.status),
            78: self.slot(memory, "no_rate", (0, 1)),
            273: Cell("h", lambda: memory["mode"], self.set_mode),
            276: self.slot(memory, "remote", (0, 1)),
            5195: self.slot(memory, "program", (1, 2, 4, 8, 16)),
            5229: Cell("h", lambda: 0, self.reset_program),
        }

    def tick(self) -> None:
        """Disabling the rate limit lets the working set point jump to its target."""
        if self.memory["no_rate"] and self.loop.is_ramping():
            self.loop.go(self.loop.target_c)

    def set_target(self, temp_c: float) -> None:
        """Take a target, in force unless a program runs; the rate limit says how fast."""
        self.static_c = self.checked(temp_c)
        if self.memory["program"] != 1:
            return
        rate, free = self.memory["rate"], bool(self.memory["no_rate"])
        limited = rate > 0 and not free
        self.loop.go(temp_c, rate / 10 / 60 if limited else math.inf)

    def set_rate(self, raw: float) -> None:
        """Take the rate limit, tenths of °C/min; 0 is off."""
        if raw < 0:
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["rate"] = raw
        if self.loop.is_ramping():
            self.set_target(self.static_c)

    def status(self) -> float:
        """Return the status word."""
        alarm = self.loop.alarm or self.loop.tripped
        return alarm | self.loop.broken << 5 | self.loop.is_ramping() << 13

    def reset_program(self, value: float) -> None:
        """End the program."""
        if value and self.memory["program"] != 1:
            self.memory["program"] = 1.0
            self.set_target(self.static_c)

    def set_mode(self, code: float) -> None:
        """Take a control mode; manual, with no power here, leaves the chamber alone."""
        if code not in (0, 1):
            raise RefusedError(ILLEGAL_VALUE)
        self.memory["mode"] = code
        self.loop.switch(powered=code == 0)

    def switch_off(self) -> None:
        """Go to manual: there is no off here."""
        self.set_mode(1)

    def start_profile(self, temp_c: float) -> None:
        """Have a program put the working set point in force; the target waits."""
        self.memory["program"] = 2.0
        self.loop.go(temp_c)
