"""A chamber without surprises, to try a controller's emulator on: air of one time constant."""

import math
import threading
from dataclasses import dataclass


@dataclass(slots=True)
class _Course:
    """The set point from one command on, and the air when it came."""

    begin_s: float
    air_c: float
    start_c: float
    target_c: float
    rate_c_per_s: float


class IdealPlant:
    """Chamber air that follows the set point with one time constant; thread-safe.

    It satisfies `drivers.emulators.plant.Plant`; head and channels are not there.

    Parameters
    ----------
    air_c : float
        Temperature at the beginning, °C.
    lag_s : float
        Time constant of the air, s; 0: it is always at the set point.
    """

    def __init__(self, *, air_c: float = 23.0, lag_s: float = 0.0) -> None:
        self._lag_s = lag_s
        self._lock = threading.Lock()
        self._course = _Course(-math.inf, air_c, air_c, air_c, math.inf)
        self._away: tuple[float, float, float] | None = None  # since, from, °C/s

    def drive_chamber(
        self, now_s: float, start_c: float, target_c: float, rate_c_per_s: float
    ) -> None:
        """From `now_s` the set point goes from `start_c` to `target_c` uniformly."""
        with self._lock:
            self._course = _Course(now_s, self._air_c(now_s), start_c, target_c, rate_c_per_s)

    def break_away(self, now_s: float, rate_c_per_s: float | None) -> None:
        """Let the air run away at a rate, whatever the set point; None: back to normal."""
        with self._lock:
            air_c = self._air_c(now_s)
            course = self._course
            if rate_c_per_s is None and self._away is not None:
                self._course = _Course(now_s, air_c, course.target_c, course.target_c, math.inf)
            self._away = None if rate_c_per_s is None else (now_s, air_c, rate_c_per_s)

    def air_temp_c(self, now_s: float) -> float:
        """Return the temperature at the controller's sensor, °C."""
        with self._lock:
            return self._air_c(now_s)

    def turn_head(self, now_s: float, target_deg: float, speed_deg_per_s: float) -> None:
        """Do nothing: there is no head."""

    def stop_head(self, now_s: float) -> None:
        """Do nothing: there is no head."""

    def head_deg(self, now_s: float) -> float:
        """Return 0: there is no head."""
        return 0.0

    def head_is_moving(self, now_s: float) -> bool:
        """Return False: there is no head."""
        return False

    def channel_value(self, now_s: float, channel: int) -> float:
        """Return nan: nothing is wired."""
        return math.nan

    def _air_c(self, now_s: float) -> float:
        if self._away is not None:
            since_s, from_c, rate = self._away
            return from_c + rate * (now_s - since_s)
        course = self._course
        if math.isinf(course.begin_s):
            return course.air_c
        way = course.target_c - course.start_c
        lasts_s = 0.0 if math.isinf(course.rate_c_per_s) else abs(way) / course.rate_c_per_s
        elapsed_s = max(0.0, now_s - course.begin_s)
        slope = math.copysign(course.rate_c_per_s, way) if lasts_s else 0.0
        during_s = min(elapsed_s, lasts_s)
        air_c = self._follow(course.air_c, course.start_c, slope, during_s)
        if elapsed_s >= lasts_s:
            air_c = self._follow(air_c, course.target_c, 0.0, elapsed_s - lasts_s)
        return air_c

    def _follow(self, air_c: float, setpoint_c: float, slope: float, for_s: float) -> float:
        """Return the air after following a set point that moves evenly."""
        if self._lag_s == 0:
            return setpoint_c + slope * for_s
        left = math.exp(-for_s / self._lag_s)
        behind = slope * self._lag_s
        return setpoint_c + slope * for_s - behind + (air_c - setpoint_c + behind) * left
