"""The time that procedures and emulated instruments live in.

A procedure never calls `time.sleep`: it is given a `Clock`. With a `RealClock` an hour takes an
hour; with a `ScaledClock` an emulated station runs at a multiple of real time, and two processes
with the same multiple agree on the time; a `SteppedClock` jumps to each deadline, so that a night
passes as fast as the machine can compute it.
"""

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Seconds on a time base that never runs backwards."""

    def now_s(self) -> float:
        """Return the present time, s."""
        ...

    def sleep_until_s(self, deadline_s: float) -> None:
        """Return at `deadline_s`, or at once when it has passed."""
        ...


class ScaledClock:
    """The machine's monotonic clock, run `speed` times as fast.

    Parameters
    ----------
    speed : float
        Multiple of real time, > 0. All processes of a machine share the time base, so an
        emulator and a controller given the same `speed` agree on the time.

    Raises
    ------
    ValueError
        If `speed` is not positive.
    """

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0:
            raise ValueError(f"speed {speed} must be positive")
        self.speed = speed

    def now_s(self) -> float:
        """Return the present time, s."""
        return time.monotonic() * self.speed

    def sleep_until_s(self, deadline_s: float) -> None:
        """Sleep until `deadline_s`."""
        while (left_s := deadline_s - self.now_s()) > 0:
            time.sleep(left_s / self.speed)


def RealClock() -> ScaledClock:  # noqa: N802  it stands beside the two classes and reads as one
    """Return the clock on the wall."""
    return ScaledClock(1.0)


class SteppedClock:
    """A clock that moves only when somebody waits: it jumps to the deadline asked for.

    It is shared by a procedure and the emulators it talks to, in one process.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Return the present time, s."""
        with self._lock:
            return self._now_s

    def sleep_until_s(self, deadline_s: float) -> None:
        """Move the present to `deadline_s`, unless it lies in the past."""
        with self._lock:
            self._now_s = max(self._now_s, deadline_s)
