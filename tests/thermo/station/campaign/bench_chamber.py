"""The chamber of `bench.py`: a Watlow F4T or F4 on Modbus TCP, and its panel."""

import contextlib
import math
import os
import random
import socket
import struct
import threading
import time

from bench_plant import Log, Plant


class Chamber:
    """A Watlow F4T or F4 on Modbus TCP."""

    def __init__(self, plant: Plant, log: Log, model: str) -> None:
        self.plant, self.log, self.model = plant, log, model
        self.setpoint_c = 22.3
        self.mode, self.ramp, self.profile, self.state = 10, 62, 61, 1
        self.rate, self.scale = 1.0, 57
        self.decimals, self.fahrenheit, self.high_first = 1, False, False
        self.frozen_c: float | None = None
        self.spoil: list[tuple[str, float]] = []
        self.spoil_temps = 0
        self.free = 40
        self.kept = dict.fromkeys([*range(3500, 3600), *range(4000, 4070)], 0)
        self.steps: list[dict[int, int]] = []
        self.lock = threading.RLock()
        self.port = 0
        self._listener: socket.socket | None = None
        self._open: list[socket.socket] = []
        self.revive()

    # ---- panel

    def panel(self, words: list[str]) -> None:
        with self.lock:
            what, *rest = words
            if what == "setpoint":
                self.go(float(rest[0]))
            elif what == "off":
                self.mode = 62
            elif what == "profile":
                self.profile, self.state = 149, 2
                self.plant.target_c = float(rest[0])
            elif what == "profile_ended":
                self.profile, self.state = 61, 1
            elif what == "freeze":
                self.plant.step()
                self.frozen_c = self.plant.air_c
            elif what == "decimals":
                self.decimals = int(rest[0])
            elif what == "fahrenheit":
                self.fahrenheit = True
            elif what == "celsius":
                self.fahrenheit = False
            elif what == "words":
                self.high_first = not self.high_first
            elif what == "nan":
                self.spoil_temps = int(rest[0])
            elif what == "dead":
                self.die()
            elif what == "alive":
                self.revive()
            else:  # late, silent, reset, drop, exception, garbage: COUNT and seconds
                self.spoil += [(what, float(rest[1]) if len(rest) > 1 else 0.0)] * int(rest[0])

    def go(self, temp_c: float) -> None:
        self.plant.step()
        self.setpoint_c = temp_c
        with self.plant.lock:
            self.plant.target_c = temp_c
            ramping = self.ramp in (85, 13)
            self.plant.rate_c_per_min = (
                (self.rate if self.scale == 57 else self.rate / 60) if ramping else 1e6
            )
            if ramping:
                self.plant.work_c = self.plant.air_c

    def shown(self, temp_c: float) -> float:
        return 1.8 * temp_c + 32 if self.fahrenheit else temp_c

    def meant(self, number: float) -> float:
        return (number - 32) / 1.8 if self.fahrenheit else number

    def floats(self, number: float) -> list[int]:
        words = struct.unpack(">HH", struct.pack(">f", number))
        return list(words if self.high_first else words[::-1])

    def raw(self, temp_c: float) -> list[int]:
        number = round(self.shown(temp_c) * 10**self.decimals)
        return [max(-32768, min(32767, number)) & 0xFFFF]

    def temperature_c(self) -> float:
        self.plant.step()
        noise = random.uniform(-0.01, 0.01)
        return (self.plant.air_c if self.frozen_c is None else self.frozen_c) + (
            noise if self.frozen_c is None else 0.0
        )

    def cells(self) -> dict[int, int]:
        temp_c = self.temperature_c()
        if self.model == "watlow_f4":
            blocks = {
                100: self.raw(temp_c), 101: [0], 200: [self.state], 300: self.raw(self.setpoint_c),
                602: self.raw(-70.0), 603: self.raw(180.0), 606: [self.decimals],
                901: [0 if self.fahrenheit else 1], 1218: [self.free], 4100: [3],
                4122: self.raw(self.plant.work_c), 1916: [12, 30, 1, 1, 1, 2026],
            }  # fmt: skip
            if self.spoil_temps:
                blocks[101] = [3]
        else:
            number = math.nan if self.spoil_temps else self.shown(temp_c)
            degrees = [30 if self.fahrenheit else 15]
            blocks = {
                1328: degrees, 6730: degrees, 2730: [self.mode], 2794: [self.ramp],
                2782: self.floats(self.shown(self.setpoint_c)),
                2810: self.floats(self.shown(self.plant.work_c)),
                2774: self.floats(self.shown(-70.3)), 2776: self.floats(self.shown(180.7)),
                2796: [self.scale], 2798: self.floats(self.rate), 2820: self.floats(number),
                16568: [self.profile], 1356: [61], 1456: [61], 1556: [61], 1656: [61],
            }  # fmt: skip
        self._served_c = temp_c
        cells = {a + i: w for a, words in blocks.items() for i, w in enumerate(words)}
        at = self.kept[4001] - 1
        step = self.steps[at] if 0 <= at < len(self.steps) else {}
        return cells | self.kept | step if self.model == "watlow_f4" else cells

    def take(self, address: int, words: list[int]) -> bool:
        pair = words if self.high_first else words[::-1]
        number = struct.unpack(">f", struct.pack(">HH", *pair))[0] if len(words) == 2 else 0.0
        if self.model == "watlow_f4":
            return self.take_f4(address, words)
        if address == 2782:
            self.go(self.meant(number))
        elif address == 2730:
            self.mode = words[0]
        elif address == 2794:
            self.ramp = words[0]
        elif address == 2796:
            self.scale = words[0]
        elif address == 2798:
            self.rate = number
        elif address == 16566:
            if words == [148]:
                self.profile = 61
        else:
            return False
        return True

    def take_f4(self, address: int, words: list[int]) -> bool:
        signed = struct.unpack(">h", struct.pack(">H", words[0]))[0]
        if address == 300:
            self.go(self.meant(signed / 10**self.decimals))
        elif address == 1217:
            self.state, self.profile = 1, 61
            self.plant.rate_c_per_min = 1e6
            self.plant.target_c = self.setpoint_c
        elif address == 4002:
            self.edit(words[0])
        elif 4003 <= address < 4070 and self.steps:
            self.steps[self.kept[4001] - 1][address] = words[0]
        elif address in self.kept:
            for i, word in enumerate(words):
                self.kept[address + i] = word
        else:
            return False
        return True

    def edit(self, action: int) -> None:
        """Create, insert, delete or start, as register 4002 of an F4 is told."""
        at = self.kept[4001] - 1
        if action == 1:
            self.free, self.steps = self.free - 1, [{4003: 5}]
            self.kept[4000] = 3
        elif action == 2:
            self.steps.insert(at, {})
        elif action == 3:
            self.free, self.steps = self.free + 1, []
        elif action == 5:
            step = self.steps[at]
            target = struct.unpack(">h", struct.pack(">H", step[4044]))[0] / 10**self.decimals
            if step[4003] == 1:
                minutes = 60 * step[4009] + step[4010] + step[4011] / 60
                rate = abs(self.meant(target) - self.plant.air_c) / max(minutes, 1e-6)
            else:
                rate = step[4043] / 10
            self.state = 2
            self.plant.step()
            self.plant.work_c = self.plant.air_c
            self.plant.target_c, self.plant.rate_c_per_min = self.meant(target), rate

    # ---- wire

    def die(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        for connection in self._open:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self._open.clear()

    def revive(self) -> None:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        listener.listen(8)
        self._listener = listener
        threading.Thread(target=self.accept, args=(listener,), daemon=True).start()

    def accept(self, listener: socket.socket) -> None:
        while True:
            try:
                connection, peer = listener.accept()
            except OSError:
                return
            if self._listener is not listener:
                connection.close()
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._open.append(connection)
            self.log.say("connect", peer=peer[1])
            threading.Thread(target=self.serve, args=(connection, peer[1]), daemon=True).start()

    def serve(self, connection: socket.socket, peer: int) -> None:
        try:
            while True:
                head = self.receive(connection, 7)
                body = self.receive(connection, struct.unpack(">H", head[4:6])[0] - 1)
                with self.lock:
                    spoil = self.spoil.pop(0) if self.spoil else None
                if spoil and spoil[0] == "late":
                    time.sleep(spoil[1])
                if spoil and spoil[0] in ("reset", "drop"):
                    if spoil[0] == "reset":
                        connection.setsockopt(
                            socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
                        )
                    connection.close()
                    return
                if spoil and spoil[0] == "exception":
                    answer = bytes((body[0] | 0x80, 4))
                else:
                    with self.lock:
                        answer = self.answer(body, peer)
                if spoil and spoil[0] == "silent":
                    continue
                if spoil and spoil[0] == "garbage":
                    connection.sendall(os.urandom(13))
                    continue
                frame = head[:4] + struct.pack(">H", len(answer) + 1) + head[6:7] + answer
                if spoil and spoil[0] == "torn":
                    connection.sendall(frame[:-1])
                    continue
                connection.sendall(frame)
        except (OSError, EOFError, struct.error):
            connection.close()

    @staticmethod
    def receive(connection: socket.socket, count: int) -> bytes:
        got = b""
        while len(got) < count:
            piece = connection.recv(count - len(got))
            if not piece:
                raise EOFError
            got += piece
        return got

    def answer(self, body: bytes, peer: int) -> bytes:
        function, address, count = struct.unpack(">BHH", body[:5])
        if function == 3:
            cells = self.cells()
            words = [cells.get(a) for a in range(address, address + count)]
            if any(w is None for w in words):
                return bytes((0x83, 2))
            at = 100 if self.model == "watlow_f4" else 2820
            if address <= at < address + count:
                if self.spoil_temps:
                    self.spoil_temps -= 1
                else:
                    self.log.say("temp", c=self._served_c)
            return struct.pack(f">BB{count}H", 3, 2 * count, *words)
        if function == 6:
            words = [count]
        elif function == 16:
            words = list(struct.unpack(f">{count}H", body[6:]))
        else:
            return bytes((function | 0x80, 1))
        done = self.take(address, words)
        self.log.say("write", address=address, words=words, peer=peer, done=done,
                     setpoint=self.setpoint_c)  # fmt: skip
        if not done:
            return bytes((function | 0x80, 2))
        return body[:5]
