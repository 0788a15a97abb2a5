"""An emulated ESP301 with one rotary stage connected, on a plant.

Codes and texts are the controller's: 6 command does not exist, 7 parameter out of range, 9 axis
number out of range, 37 axis number missing, 38 parameter missing; of axis n, n01 parameter out of
range, n06 and n07 software limits, n08 stage not connected, n10 maximum velocity exceeded, n11
maximum acceleration exceeded, n13 motor not enabled.
"""

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.plant import Plant
from drivers.emulators.serial_server import SerialServer
from drivers.emulators.served import Served

VERSION = "ESP301 Version 3.0.1 6/1/99"
AXES = 3
BUFFER_DEPTH = 10
TICK_S = 400e-6  # servo cycle, the unit of the time in the error buffer
UNIT_DEGREE = 7

GENERAL = {
    6: "COMMAND DOES NOT EXIST",
    7: "PARAMETER OUT OF RANGE",
    9: "AXIS NUMBER OUT OF RANGE",
    27: "COMMAND NOT ALLOWED",
    37: "AXIS NUMBER MISSING",
    38: "COMMAND PARAMETER MISSING",
}
OF_AXIS = {
    1: "PARAMETER OUT OF RANGE",
    6: "POSITIVE SOFTWARE LIMIT DETECTED",
    7: "NEGATIVE SOFTWARE LIMIT DETECTED",
    8: "MOTOR / STAGE NOT CONNECTED",
    10: "MAXIMUM VELOCITY EXCEEDED",
    11: "MAXIMUM ACCELERATION EXCEEDED",
    13: "MOTOR NOT ENABLED",
}

_COMMAND = re.compile(r"(\d*)\s*(\*IDN|[A-Z]{2})\s*(.*)", re.IGNORECASE)


class _RefusalError(Exception):
    """A command refused with a code."""

    def __init__(self, code: int) -> None:
        super().__init__(str(code))
        self.code = code


@dataclass(slots=True)
class _Axis:
    """The axis' settings; where it is, the plant knows."""

    enabled: bool = False
    target_deg: float = 0.0
    speed: float = 10.0
    max_speed: float = 100.0
    acceleration: float = 200.0
    max_acceleration: float = 1000.0
    left_deg: float = -720.0
    right_deg: float = 720.0
    unit: int = UNIT_DEGREE


class HeadEmulator(Served):
    """An ESP301 on a port.

    Parameters
    ----------
    plant : Plant
        The head that turns.
    clock : Clock
        The emulation's clock; it is read, never moved.
    faults : FaultPlan
        How it misbehaves.
    url : str
        Where: ``serial:///path``, ``serial://auto`` or ``socket://host:port``.
    axis : int
        The axis the stage is connected to, 1 to 3.
    max_speed_deg_per_s : float
        Speeds above are refused.
    version : str
        The answer to ``VE?``.
    """

    def __init__(
        self,
        plant: Plant,
        clock: Clock,
        faults: FaultPlan,
        *,
        url: str = "serial://auto",
        axis: int = 1,
        max_speed_deg_per_s: float = 100.0,
        version: str = VERSION,
    ) -> None:
        self.faults = faults
        self._plant = plant
        self._clock = clock
        self._number = axis
        self._version = version
        self._axis = _Axis(max_speed=max_speed_deg_per_s)
        self._errors: list[tuple[int, int]] = []
        self._start_s = clock.now_s()
        self._lock = threading.Lock()
        self._server = SerialServer(url, self, faults)
        self._queries: dict[str, Callable[[], str]] = {
            "TP": lambda: _text(self._plant.head_deg(self._clock.now_s())),
            "TV": lambda: _text(self._axis.speed if self._moving() else 0.0),
            "DP": lambda: _text(self._axis.target_deg),
            "PA": lambda: _text(self._axis.target_deg),
            "MD": lambda: str(int(not self._moving())),
            "MO": lambda: str(int(self._axis.enabled)),
            "MF": lambda: str(int(self._axis.enabled)),
            "VA": lambda: _text(self._axis.speed),
            "VU": lambda: _text(self._axis.max_speed),
            "AC": lambda: _text(self._axis.acceleration),
            "AU": lambda: _text(self._axis.max_acceleration),
            "SL": lambda: _text(self._axis.left_deg),
            "SR": lambda: _text(self._axis.right_deg),
            "SN": lambda: str(self._axis.unit),
            "ID": lambda: "URS75CC, SN0001",
        }
        self._actions: dict[str, Callable[[str], None]] = {
            "PA": lambda v: self._move(_value(v)),
            "PR": lambda v: self._move(self._plant.head_deg(self._clock.now_s()) + _value(v)),
            "MO": lambda _: self._enable(True),
            "MF": lambda _: self._enable(False),
            "ST": lambda _: self._stop(),
            "AB": lambda _: self._stop(),
            "VA": lambda v: self._set_speed(_value(v)),
            "AC": lambda v: self._set_acceleration(_value(v)),
            "SL": lambda v: setattr(self._axis, "left_deg", _value(v)),
            "SR": lambda v: setattr(self._axis, "right_deg", _value(v)),
            "WS": lambda _: None,  # nothing here waits in a queue of commands
        }

    def refuse(self) -> None:
        """Put an error into the buffer."""
        with self._lock:
            self._push(27)

    def respond(self, line: str) -> str | None:
        """Do what a line says.

        Returns
        -------
        str or None
            The replies of its queries, a line each; None when there are none.
        """
        replies: list[str] = []
        with self._lock:
            for command in filter(None, (c.strip() for c in line.split(";"))):
                try:
                    reply = self._run(command)
                except _RefusalError as err:
                    self._push(err.code)
                    continue
                if reply is not None:
                    replies.append(reply)
        return "\r\n".join(replies) if replies else None

    # ---- commands

    def _run(self, command: str) -> str | None:
        match = _COMMAND.fullmatch(command)
        if match is None:
            raise _RefusalError(6)
        axis, name, value = match[1], match[2].upper(), match[3].strip()
        if name in ("VE", "*IDN"):
            return self._version
        if name == "TB":
            return self._pop_with_text()
        if name == "TE":
            return str(self._pop()[0])
        if name == "AB" and not axis:  # stops every axis
            axis = str(self._number)
        if name not in self._queries and name not in self._actions:
            raise _RefusalError(6)
        if not axis:
            raise _RefusalError(37)
        if not 1 <= int(axis) <= AXES:
            raise _RefusalError(9)
        if int(axis) != self._number:
            raise _RefusalError(100 * int(axis) + 8)
        if value == "?" or name in ("TP", "TV"):
            if name not in self._queries:
                raise _RefusalError(6)
            return self._queries[name]()
        if name not in self._actions:
            raise _RefusalError(27)
        self._actions[name](value)
        return None

    def _refusal(self, code: int) -> _RefusalError:
        return _RefusalError(100 * self._number + code)

    def _moving(self) -> bool:
        return self._plant.head_is_moving(self._clock.now_s())

    def _move(self, target_deg: float) -> None:
        if not self._axis.enabled:
            raise self._refusal(13)
        if target_deg > self._axis.right_deg:
            raise self._refusal(6)
        if target_deg < self._axis.left_deg:
            raise self._refusal(7)
        self._axis.target_deg = target_deg
        self._plant.turn_head(self._clock.now_s(), target_deg, self._axis.speed)

    def _stop(self) -> None:
        now_s = self._clock.now_s()
        self._plant.stop_head(now_s)
        self._axis.target_deg = self._plant.head_deg(now_s)

    def _enable(self, on: bool) -> None:
        if not on and self._moving():
            self._stop()
        self._axis.enabled = on

    def _set_speed(self, speed: float) -> None:
        if speed > self._axis.max_speed:
            raise self._refusal(10)
        if not speed > 0:
            raise self._refusal(1)
        self._axis.speed = speed

    def _set_acceleration(self, acceleration: float) -> None:
        if acceleration > self._axis.max_acceleration:
            raise self._refusal(11)
        if not acceleration > 0:
            raise self._refusal(1)
        self._axis.acceleration = acceleration

    # ---- errors

    def _push(self, code: int) -> None:
        self._errors.append((code, self._ticks()))
        del self._errors[:-BUFFER_DEPTH]

    def _pop(self) -> tuple[int, int]:
        return self._errors.pop(0) if self._errors else (0, self._ticks())

    def _pop_with_text(self) -> str:
        code, ticks = self._pop()
        if code == 0:
            text = "NO ERROR DETECTED"
        elif code < 100:
            text = GENERAL[code]
        else:
            text = f"AXIS-{code // 100} {OF_AXIS[code % 100]}"
        return f"{code}, {ticks}, {text}"

    def _ticks(self) -> int:
        return int((self._clock.now_s() - self._start_s) / TICK_S)


def _value(text: str) -> float:
    """Read a parameter."""
    if not text:
        raise _RefusalError(38)
    try:
        value = float(text)
    except ValueError:
        raise _RefusalError(7) from None
    if not abs(value) < 1e9:
        raise _RefusalError(7)
    return value


def _text(value: float) -> str:
    """Write a number with the display resolution of a rotary stage."""
    return f"{value:.5f}"
