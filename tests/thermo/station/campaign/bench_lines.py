"""The multimeter and the head of `bench.py`, on pseudo-terminals."""

import math
import os
import random
import re
import select
import threading
import tty
from abc import ABC, abstractmethod

from bench_plant import Log, Plant

STEINHART = (0.001129148, 0.000234125, 8.76741e-08)


class Line(ABC):
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

    @abstractmethod
    def answers(self, line: str) -> list[str]:
        """Return what is said to a line."""


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
