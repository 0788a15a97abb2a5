"""The plant behind the instruments of `bench.py`, and the log of what they say."""

import json
import math
import os
import threading
import time
from pathlib import Path

LAG_S = 60.0  # of an accelerometer behind the air


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
