"""A chamber, a multimeter and a head in a process of their own, spoilt on command.

Written from the makers' tables alone: it shares no code with the drivers nor with the emulators of
the project. One plant moves behind all three. Everything that is written to the chamber and every
value that is served goes to a log, a JSON document a line, with the machine's monotonic time.

    fault_bench.py FOLDER SPEED MODEL SERIAL,SERIAL…
"""

import contextlib
import json
import math
import os
import random
import re
import select
import socket
import struct
import sys
import threading
import time
import tty
from pathlib import Path

LAG_S = 60.0  # of an accelerometer behind the air
STEINHART = (0.001129148, 0.000234125, 8.76741e-08)


class Log:
    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def say(self, what: str, **more: object) -> None:
        line = json.dumps({"t": time.monotonic(), "what": what, **more}) + "\n"
        os.write(self._fd, line.encode())


class Plant:
    """Air that follows a set point or a ramp, and accelerometers that lag behind it."""

    def __init__(self, speed: float) -> None:
        self._speed, self._start = speed, time.monotonic()
        self._then_s = 0.0
        self.air_c = self.body_c = 22.3
        self.target_c, self.rate_c_per_min = 22.3, 6.0
        self.work_c = 22.3
        self.angle_deg, self.goal_deg = 0.0, 0.0
        self.lock = threading.RLock()

    def now_s(self) -> float:
        return (time.monotonic() - self._start) * self._speed

    def step(self) -> None:
        with self.lock:
            now_s = self.now_s()
            left_s = now_s - self._then_s
            self._then_s = now_s
            while left_s > 0:
                d_s = min(left_s, 5.0)
                left_s -= d_s
                way = self.target_c - self.work_c
                reach = self.rate_c_per_min * d_s / 60
                self.work_c += math.copysign(min(abs(way), reach), way)
                way = self.work_c - self.air_c
                self.air_c += math.copysign(min(abs(way), 6.0 * d_s / 60), way)
                self.body_c += (self.air_c - self.body_c) * (1 - math.exp(-d_s / LAG_S))
                way = self.goal_deg - self.angle_deg
                self.angle_deg += math.copysign(min(abs(way), 60.0 * d_s), way)


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


class Line:
    """Something that answers lines on a pseudo-terminal."""

    def __init__(self, plant: Plant, log: Log, name: str) -> None:
        self.plant, self.log, self.name = plant, log, name
        self.master, self.slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)
        self.silent = 0
        self.gone = False
        threading.Thread(target=self.serve, daemon=True).start()

    def unplug(self) -> None:
        """Take the port away, as when its cable is pulled."""
        self.gone = True
        os.close(self.slave)
        os.close(self.master)

    def serve(self) -> None:
        pending = b""
        while True:
            try:
                select.select([self.master], [], [], 0.2)
                if not select.select([self.master], [], [], 0)[0]:
                    continue
                pending += os.read(self.master, 4096)
            except (OSError, ValueError):
                return
            while match := re.search(rb"[\r\n]+", pending):
                line, pending = pending[: match.start()].decode(), pending[match.end() :]
                for answer in self.answers(line.strip()):
                    if self.silent > 0:
                        self.silent -= 1
                    elif not self.gone:
                        os.write(self.master, answer.encode() + b"\r\n")

    def answers(self, line: str) -> list[str]:
        raise NotImplementedError


class Digitiser(Line):
    def __init__(self, plant: Plant, log: Log, serials: list[str]) -> None:
        self.serials = serials
        self.scan_list: list[int] = []
        self.lost: set[int] = set()
        self.stuck: dict[int, float] = {}
        self.stick = False
        self.noise = random.Random(5)
        super().__init__(plant, log, "digitiser")

    def panel(self, words: list[str]) -> None:
        what, *rest = words
        if what == "unplug":
            self.unplug()
        elif what == "silent":
            self.silent = int(rest[0])
        elif what == "lose":
            self.lost.add(int(rest[0]))
        elif what == "stick":
            self.stick = True

    def answers(self, line: str) -> list[str]:
        answers: list[str] = []
        for part in line.split(";"):
            part = part.strip().upper()
            if match := re.match(r":?ROUT\w*:SCAN\w* \(@([\d,:]*)\)", part):
                self.scan_list = [int(c) for c in match[1].split(",") if c]
            elif "?" in part:
                answers.append(self.query(part))
        return answers

    def query(self, part: str) -> str:
        if part == "*IDN?":
            return "HEWLETT-PACKARD,34970A,0,13-2-2"
        if part.startswith("SYST") and "ERR" in part:
            return '+0,"No error"'
        if part in ("*OPC?", "*TST?"):
            return "1" if part == "*OPC?" else "0"
        if "SCAN?" in part and "SIZE" not in part:
            listed = ",".join(map(str, self.scan_list))
            text = f"(@{listed})"
            return f"#{len(str(len(text)))}{len(text)}{text}"
        if "SIZE?" in part:
            return str(len(self.scan_list))
        if part == "READ?":
            return self.read()
        if "NPLC?" in part:
            return "+1.00000000E+00"
        self.log.say("unknown", name=self.name, line=part)
        return "0"

    def read(self) -> str:
        self.plant.step()
        answers, served = [], []
        for i, channel in enumerate(self.scan_list):
            value = self.value(channel)
            text = f"{value:+.8E}"
            offset_s = 0.02 * i
            answers.append(f"{text},{offset_s:012.3f},{channel}")
            served.append([channel, float(text)])
        self.log.say(
            "scan", values=served, angle=self.plant.angle_deg, air=self.plant.air_c,
            body=self.plant.body_c,
        )  # fmt: skip
        return ",".join(answers)

    def value(self, channel: int) -> float:
        if channel % 100 > 10:
            if channel in self.lost:
                return 9.9e37
            temp_c = self.plant.body_c + self.noise.gauss(0, 0.002)
            return resistance_ohm(temp_c)
        if channel not in self.stuck or not self.stick:
            g = math.sin(math.radians(self.plant.angle_deg))
            self.stuck[channel] = 1.3 * g + 0.002 * (channel % 100) + self.noise.gauss(0, 2e-5)
        return self.stuck[channel]


def resistance_ohm(temp_c: float) -> float:
    a, b, c = STEINHART
    low, high = math.log(10.0), math.log(1e7)
    for _ in range(60):
        middle = (low + high) / 2
        if 1 / (a + b * middle + c * middle**3) - 273.15 > temp_c:
            low = middle
        else:
            high = middle
    return math.exp(low)


class Head(Line):
    def __init__(self, plant: Plant, log: Log) -> None:
        self.stuck = False
        super().__init__(plant, log, "head")

    def panel(self, words: list[str]) -> None:
        if words[0] == "stick":
            self.stuck = True
        elif words[0] == "unplug":
            self.unplug()
        elif words[0] == "silent":
            self.silent = int(words[1])

    def answers(self, line: str) -> list[str]:
        answers: list[str] = []
        for part in line.split(";"):
            part = part.strip().upper()
            self.plant.step()
            if match := re.match(r"(\d?)PA([-+.\dE]+)$", part):
                if not self.stuck:
                    self.plant.goal_deg = float(match[2])
            elif re.match(r"\d?ST$", part):
                self.plant.goal_deg = self.plant.angle_deg
            elif re.match(r"\d?MD\??$", part) and part.endswith("?"):
                answers.append(str(int(self.plant.goal_deg == self.plant.angle_deg)))
            elif re.match(r"\d?TP\??$", part):
                answers.append(f"{self.plant.angle_deg:.5f}")
            elif part.startswith("TB"):
                answers.append("0, 0, NO ERROR DETECTED")
            elif part.startswith("TE"):
                answers.append("0")
            elif part.startswith("VE"):
                answers.append("ESP301 Version 3.0.1 6/1/99")
            elif re.match(r"\d?SN\?$", part):
                answers.append("7")  # degrees
            elif part.endswith("?"):
                self.log.say("unknown", name=self.name, line=part)
                answers.append("1" if "MO" in part else "20.0")
        return answers


def control(folder: Path, chamber: Chamber, digitiser: Digitiser, head: Head) -> None:
    """Answer a command a connection until the socket is asked to end."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(folder / "panel"))
    listener.listen(8)
    sys.stdout.write(json.dumps({"port": chamber.port, "digitiser": digitiser.path,
                                 "head": head.path}) + "\n")  # fmt: skip
    sys.stdout.flush()
    while True:
        connection, _ = listener.accept()
        with connection:
            device, *words = connection.recv(4096).decode().split()
            if device == "end":
                return
            if device == "chamber":
                chamber.log.say("panel", words=words)
                chamber.panel(words)
            elif device == "digitiser":
                digitiser.panel(words)
            elif device == "head":
                head.panel(words)
            state = {
                "setpoint_c": chamber.setpoint_c, "mode": chamber.mode, "ramp": chamber.ramp,
                "profile": chamber.profile, "state": chamber.state, "air_c": chamber.plant.air_c,
                "t": time.monotonic(),
            }  # fmt: skip
            connection.sendall(json.dumps(state).encode())


def main() -> None:
    folder, speed, model, serials = sys.argv[1:5]
    log = Log(Path(folder) / "bench.jsonl")
    plant = Plant(float(speed))
    names = serials.split(",")
    chamber = Chamber(plant, log, model)
    threading.Thread(target=orphaned, daemon=True).start()
    control(Path(folder), chamber, Digitiser(plant, log, names), Head(plant, log))


def orphaned() -> None:
    """End when nobody is left to ask for it."""
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main()
