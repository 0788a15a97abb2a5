"""Newport ESP301 motion controller: one rotary axis, over its serial port.

Facts relied on, from the maker's manual: a command is ``axis, two letters, value`` ended by CR,
replies end with CR LF; commands answer nothing, so the error buffer is asked after each
(``TB?`` answers ``code, time, text``, 0 when empty; codes of axis n are n00 to n99); a motor is
off after power-up; ``MD?`` is 1 when no motion is going on; ``SN?`` is 7 when an axis counts in
degrees; the port uses RTS/CTS.
"""

import logging
import re
from collections.abc import Callable
from typing import TypeVar

from drivers.devices import Range
from drivers.errors import DeviceError, InstrumentError, LimitError, LinkError, ProtocolError
from drivers.links.serial_instrument import SerialInstrument
from drivers.links.serial_link import SerialLink
from drivers.station import HeadConfig

log = logging.getLogger(__name__)

T = TypeVar("T")

MODEL = "ESP301"
UNIT_DEGREE = 7.0
ERROR_BUFFER = 10
ANGLE_DECIMALS = 5
SAME_DEG = 0.01  # a target read back within this is the one that was sent

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([Ee][+-]?\d+)?")
_ERROR = re.compile(r"\s*(\d{1,3})\s*,(?:\s*(\d+)\s*,)?\s*([^\d\s].*)")
_VERSION = re.compile(r".*ESP\s?\d{3}.*", re.IGNORECASE)


def parse_number(reply: str) -> float:
    """Parse a position, a speed or a limit.

    Raises
    ------
    ProtocolError
        If the reply is not one finite decimal number.
    """
    if _NUMBER.fullmatch(reply.strip()) is None:
        raise ProtocolError(f"reply {reply[:60]!r}, expected a number")
    value = float(reply)
    if abs(value) > 1e9:  # also the infinity of an overflowing exponent
        raise ProtocolError(f"reply {reply[:60]!r}, expected a number of an axis")
    return value


def parse_flag(reply: str) -> bool:
    """Parse the answer to MD? or MO?.

    Raises
    ------
    ProtocolError
        If it is neither 0 nor 1.
    """
    if reply.strip() not in ("0", "1"):
        raise ProtocolError(f"reply {reply[:60]!r}, expected 0 or 1")
    return reply.strip() == "1"


def parse_esp301_error(reply: str) -> tuple[int, str]:
    """Parse the answer to TB?.

    Returns
    -------
    tuple of int and str
        Code and text; code 0 when the buffer was empty.

    Raises
    ------
    ProtocolError
        If it is not ``code, time, text``.
    """
    match = _ERROR.fullmatch(reply)
    if match is None:
        raise ProtocolError(f"reply {reply[:60]!r} to TB?, expected code, time, text")
    return int(match[1]), match[3].strip()


def angle_text(angle_deg: float) -> str:
    """Write an angle as the controller reads it: plain decimals, no exponent, no minus zero."""
    text = f"{angle_deg:.{ANGLE_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


class MotionHead(SerialInstrument):
    """An indexing head on one axis of an ESP301; satisfies `drivers.devices.IndexingHead`.

    Parameters
    ----------
    config : HeadConfig
        Where it is, which axis, its limits and speed.
    name : str
        For messages.

    Raises
    ------
    LinkError
        If the port cannot be opened.
    """

    def __init__(self, config: HeadConfig, *, name: str = "head") -> None:
        self._config = config
        self._limits = Range(lo=config.limits_deg[0], hi=config.limits_deg[1])
        self._speed_set = False
        link = SerialLink(
            config.url,
            name=name,
            baud=config.baud,
            timeout_s=config.timeout_s,
            retries=config.retries,
            fences=[("VE?", _VERSION), ("*IDN?", _VERSION)],
            end=b"\r",
            flow="rts_cts",
            resynced=self._empty_error_buffer,
        )
        super().__init__(link)

    @property
    def limits_deg(self) -> Range:
        """Angles outside are refused."""
        return self._limits

    @property
    def speed_deg_per_s(self) -> float:
        """The speed the axis turns at, °/s."""
        return self._config.speed_deg_per_s

    def identify(self) -> str:
        """Ask for the firmware version and check the model and the axis' unit.

        Returns
        -------
        str
            The version line.

        Raises
        ------
        DeviceError
            If it is another controller or the axis does not count in degrees.
        """
        version = self._identity()
        if MODEL not in version.upper().replace(" ", ""):
            raise DeviceError(f"{self._name}: is {version!r}, expected an {MODEL}")
        unit = self._setting("SN?")
        if isinstance(unit, float) and unit != UNIT_DEGREE:
            raise DeviceError(
                f"{self._name}: axis {self._config.axis} counts in unit {unit:g}, "
                f"expected {UNIT_DEGREE:g} (degree)"
            )
        return version

    def read_settings(self) -> dict[str, str | float]:
        """Read version, unit, speed, acceleration and the controller's own limits.

        Returns
        -------
        dict
            What the controller answered; "no answer" where it refused a question.
        """
        settings: dict[str, str | float] = {"identity": self._identity()}
        for key, question in {
            "unit": "SN?",
            "speed_deg_per_s": "VA?",
            "acceleration_deg_per_s2": "AC?",
            "left_limit_deg": "SL?",
            "right_limit_deg": "SR?",
        }.items():
            settings[key] = self._setting(question)
        return settings

    def move_to_deg(self, angle_deg: float) -> None:
        """Start a move to an angle; returns while the axis turns.

        Parameters
        ----------
        angle_deg : float
            Absolute angle, °.

        Raises
        ------
        LimitError
            If the angle is outside the limits or not a number; nothing was sent.
        DeviceError
            If the controller refuses.
        LinkError, ProtocolError
            If it is not known whether the controller took the command.
        """
        if angle_deg not in self._limits:
            raise LimitError(
                f"{self._name}: {angle_deg:g}° is outside "
                f"{self._limits.lo:g} to {self._limits.hi:g}°"
            )
        if not self._ask(f"{self._config.axis}MO?", parse_flag):
            self._command(f"{self._config.axis}MO")
            self._speed_set = False  # a motor that is off may mean a controller that was off
        if not self._speed_set:
            self._command(f"{self._config.axis}VA{angle_text(self._config.speed_deg_per_s)}")
            self._speed_set = True
        self._start(angle_deg)

    def is_moving(self) -> bool:
        """Tell whether the axis still turns."""
        return not self._ask(f"{self._config.axis}MD?", parse_flag)

    def read_position_deg(self) -> float:
        """Read the encoder, °."""
        return self._ask(f"{self._config.axis}TP", parse_number)

    def stop(self) -> None:
        """Stop the axis where it is; stopping twice is harmless, so it is tried again."""
        self._command(f"{self._config.axis}ST")

    # ---- exchanges

    def _identity(self) -> str:
        """Ask for the version, the other way too when the first is not understood."""
        try:
            return self._ask("VE?", _version)
        except (LinkError, DeviceError) as err:
            log.info("%s; trying *IDN?", err)
            return self._ask("*IDN?", _version)

    def _start(self, angle_deg: float) -> None:
        """Send a move once; send it again only when the controller shows another target."""
        command = f"{self._config.axis}PA{angle_text(angle_deg)}"
        for attempt in range(self._config.retries + 1):
            try:
                self._command(command, retries=0)
            except (LinkError, ProtocolError):
                if attempt == self._config.retries:
                    raise
                target_deg = self._ask(f"{self._config.axis}DP?", parse_number)
                if abs(target_deg - angle_deg) <= SAME_DEG:
                    return
                self.counters.retries += 1
                log.warning(
                    "%s: the target is %g°, so %r did not arrive; sent again",
                    self._name,
                    target_deg,
                    command,
                )
            else:
                return

    def _ask(self, question: str, parse: Callable[[str], T], *, retries: int | None = None) -> T:
        """Ask, parse, and look into the error buffer, which also shows the link is in step."""

        def exchange() -> T:
            self._link.send(question)
            answer = self._parsed(self._link.receive(), parse)
            self._check_errors(question)
            return answer

        return self._link.transact(question, exchange, retries=retries)

    def _command(self, command: str, *, retries: int | None = None) -> None:
        """Send a command and look into the error buffer."""

        def exchange() -> None:
            self._link.send(command)
            self._check_errors(command)

        self._link.transact(command, exchange, retries=retries)

    def _setting(self, question: str) -> str | float:
        """Ask for one setting of the axis."""
        try:
            return self._ask(f"{self._config.axis}{question}", parse_number, retries=0)
        except InstrumentError as err:
            log.warning("%s: %s", self._name, err)
            return "no answer"

    def _check_errors(self, what: str) -> None:
        """Read the error buffer; errors of other axes are only logged."""
        mine: list[str] = []
        for code, text in self._read_error_buffer():
            if code >= 100 and code // 100 != self._config.axis:
                log.warning("%s: another axis: %d %s", self._name, code, text)
            else:
                mine.append(f"{code} {text}")
        if mine:
            raise DeviceError(f"{self._name}: {what!r} refused: {'; '.join(mine)}")

    def _read_error_buffer(self) -> list[tuple[int, str]]:
        return self._read_errors("TB?", parse_esp301_error, ERROR_BUFFER)

    def _empty_error_buffer(self) -> None:
        """After getting into step: what is in the buffer belongs to the past."""
        for code, text in self._read_error_buffer():
            log.warning("%s: in the error buffer: %d %s", self._name, code, text)


def _version(reply: str) -> str:
    if _VERSION.fullmatch(reply) is None:
        raise ProtocolError(f"reply {reply[:60]!r} to VE?, expected a version with ESP301 in it")
    return reply.strip()
