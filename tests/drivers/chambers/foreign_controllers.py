"""An F4 and an F4T on pyModbusTCP's server, written for the tests from the makers' tables alone.

They share no code with the drivers, nor with the project's emulators: a register file of their
own, a plant that moves, and a record of every write that reached them.
"""

import math
import struct
import time

from pyModbusTCP.server import DataBank, ModbusServer

MINUTE_S = 0.5  # real time that a minute of the plant takes


class MovingPlant:
    """Air that goes to its set point at 10 °C/min, whatever unit a panel shows."""

    def __init__(self, temp_c: float) -> None:
        self._since_s, self._from_c, self.target_c = time.monotonic(), temp_c, temp_c

    def temp_c(self) -> float:
        way = self.target_c - self._from_c
        done = 10.0 * (time.monotonic() - self._since_s) / MINUTE_S
        return self._from_c + math.copysign(min(abs(way), done), way)

    def go(self, target_c: float) -> None:
        self._from_c, self._since_s = self.temp_c(), time.monotonic()
        self.target_c = target_c


class QuickServer(ModbusServer):
    """The server, which looks for its end fifty times a second, not twice."""

    def _serve(self) -> None:
        self._evt_running.set()
        try:
            self._service.serve_forever(poll_interval=0.02)
        finally:
            self._evt_running.clear()


class ForeignController(DataBank):
    """A register file over a plant; what it has not is refused with exception 2."""

    def __init__(
        self, *, temp_c=23.4, limits_c=(-70.0, 180.0), fahrenheit=False, without=()
    ) -> None:
        super().__init__(virtual_mode=True)
        self.plant = MovingPlant(temp_c)
        self.limits_c, self.fahrenheit, self.without = limits_c, fahrenheit, set(without)
        self.setpoint_c = temp_c
        self.writes: list[tuple[int, list[int]]] = []
        self.kept: dict[int, list[int]] = {}
        self.odd: dict[int, list[int]] = {}  # words shown whatever the state
        self.server = QuickServer("127.0.0.1", 0, no_block=True, data_bank=self)
        self.server.start()
        port = self.server._service.server_address[1]  # it does not tell which port it was given
        self.url = f"modbus+tcp://127.0.0.1:{port}"

    def close(self) -> None:
        self.server.stop()

    # ---- pyModbusTCP asks here

    def get_holding_registers(self, address, number=1, srv_info=None):
        words = self.space()
        asked = range(address, address + number)
        if any(a not in words or a in self.without for a in asked):
            return None
        return [words[a] for a in asked]

    def set_holding_registers(self, address, word_list, srv_info=None):
        self.writes.append((address, list(word_list)))
        return self.take(address, list(word_list)) if address not in self.without else None

    def space(self) -> dict[int, int]:
        """Return what every register holds now."""
        cells = self.cells() | self.kept | self.odd
        return {a + i: word & 0xFFFF for a, words in cells.items() for i, word in enumerate(words)}

    def shown(self, temp_c: float) -> float:
        return 1.8 * temp_c + 32.0 if self.fahrenheit else temp_c

    def meant(self, number: float) -> float:
        return (number - 32.0) / 1.8 if self.fahrenheit else number

    def go(self, number: float) -> None:
        self.setpoint_c = self.meant(number)
        self.plant.go(self.setpoint_c)


class ForeignF4(ForeignController):
    """16-bit integers, scaled by the decimals at 606, in the unit at 901."""

    def __init__(self, *, decimals=1, **more) -> None:
        self.decimals = decimals
        self.state, self.profile_c = 1, 70.0
        super().__init__(**more)

    def cells(self):
        def raw(temp_c):
            return [max(-32768, min(32767, round(self.shown(temp_c) * 10**self.decimals)))]

        return {
            100: raw(self.plant.temp_c()), 101: [0], 200: [self.state], 300: raw(self.setpoint_c),
            602: raw(self.limits_c[0]), 603: raw(self.limits_c[1]), 606: [self.decimals],
            901: [0 if self.fahrenheit else 1], 1218: [40], 4100: [3], 4122: raw(self.profile_c),
        }  # fmt: skip

    def take(self, address, words):
        if address == 300:
            number = struct.unpack(">h", struct.pack(">H", words[0]))[0]
            self.go(number / 10**self.decimals)
        elif address == 1217:
            self.state = 1
        else:
            return None
        return True


class ForeignF4T(ForeignController):
    """Floats in the unit of the port, low word first unless it is set otherwise."""

    def __init__(self, *, high_first=False, profile=61, mode=10, **more) -> None:
        self.high_first, self.profile, self.mode = high_first, profile, mode
        self.ramp = 62
        super().__init__(**more)
        self.kept = {2796: [57], 2798: self.floats(1.0)}

    def floats(self, number):
        words = struct.unpack(">HH", struct.pack(">f", number))
        return list(words if self.high_first else words[::-1])

    def cells(self):
        degrees = [30 if self.fahrenheit else 15]
        setpoint = self.floats(self.shown(self.setpoint_c))
        force = self.floats(self.shown(70.0)) if self.profile == 149 else setpoint
        return {
            1328: degrees, 6730: degrees, 2730: [self.mode], 2782: setpoint, 2810: force,
            2774: self.floats(self.shown(self.limits_c[0])),
            2776: self.floats(self.shown(self.limits_c[1])),
            2794: [self.ramp], 2820: self.floats(self.shown(self.plant.temp_c())),
            16568: [self.profile],
        }  # fmt: skip

    def take(self, address, words):
        if address == 2782:
            pair = words if self.high_first else words[::-1]
            self.go(struct.unpack(">f", struct.pack(">HH", *pair))[0])
        elif address == 16566 and words == [148]:
            self.profile = 61
        elif address == 2730:
            self.mode = words[0]
        elif address == 2794:
            self.ramp = words[0]
        elif address in self.kept:
            self.kept[address] = words
        else:
            return None
        return True
