"""An emulated controller that ramps by profiles only: Watlow F4.

The addresses were written down a second time, from the same sources as the drivers' maps and not
from the maps: a slip in one shows as a disagreement.
"""

import math

from drivers.emulators.chamber_bank import ILLEGAL_VALUE, Cell, Controller
from drivers.emulators.modbus_frames import RefusedError


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
            300: self.scaled(lambda: self.static_c, self.set_target),
            602: self.scaled(lambda: self.limits_c[0]),
            603: self.scaled(lambda: self.limits_c[1]),
            606: Cell("h", lambda: self.decimals),
            901: Cell("h", lambda: not self.fahrenheit),
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

    def switch_off(self) -> None:
        """Refuse: no register of an F4 tells of it."""
        raise ValueError("an F4 has no register that tells of a loop that is off")

    def start_profile(self, temp_c: float) -> None:
        """Run the profile of the highest number, a ramp of 5 °C/min and a soak of 99 h."""
        ramp, soak = _empty_step(2), _empty_step(3)
        ramp |= {4043: 50.0, 4044: round(temp_c * self.factor)}
        soak |= {4009: 99.0}
        self.profiles[40] = [ramp, soak, _empty_step(5)]
        self.running, self.step = 40, 0
        self.begin_step()

    def set_target(self, temp_c: float) -> None:
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
        lasts_s = 3600 * step[4009] + 60 * step[4010] + step[4011]
        self.soak_until_s = self.loop.now_s + (lasts_s if step[4003] == 3 else 0.0)
        target_c = step[4044] / self.factor
        if step[4003] == 2 and step[4043] > 0:
            self.loop.go(self.checked(target_c), step[4043] / 10 / 60)
        elif step[4003] == 1:
            way = abs(target_c - self.loop.setpoint_c())
            self.loop.go(self.checked(target_c), way / lasts_s if lasts_s else math.inf)
        elif step[4003] == 5:  # the set point the profile came to becomes the static one
            self.static_c = self.loop.setpoint_c()
            self.running = None

    def tick(self) -> None:
        """Go on to the next step when the ramp has arrived, or the soak is over."""
        while not (
            self.running is None or self.loop.is_ramping() or self.loop.now_s < self.soak_until_s
        ):
            self.step += 1
            self.begin_step()

    def terminate(self, value: float) -> None:
        """End the profile; the static set point is in force again."""
        if value and self.running is not None:
            self.running = None
            self.loop.go(self.static_c)
