"""Recognition of a controller as the station file's, before anything is written to it.

A number with the wrong scale, unit or word order reads back as it was written: nothing that is
read after a write can show the error. So scale, unit and word order are proven by registers that
were not written, and until they are, the link lets no write through.
"""

import logging
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from drivers.chambers.limits import ChamberLimits
from drivers.chambers.registers import ControllerRegisters
from drivers.devices import CHAMBER_C, Range
from drivers.errors import DeviceError, RecognitionError
from drivers.links.modbus_link import RefusalError
from drivers.station import ChamberConfig

log = logging.getLogger(__name__)

Evidence = Mapping[str, float | str]
ROOM_C = Range(lo=-20.0, hi=50.0)  # a chamber at rest, in whatever hall it stands
BEYOND_LIMITS_C = 10.0  # an overshoot, or a chamber coming back from outside its limits
# No sensor resolves a microkelvin and nobody sets one: such a number is a float with its halves
# swapped, whose exponent is made of bits that were the mantissa's last.
SMALLEST_C = 1e-6
# Between the set point limits of a chamber that goes anywhere. Whole tenths up to 300 °C whose
# words come in the other order are within 2.01 °C of zero: such limits are never taken for limits.
NARROWEST_C = 5.0


def find_problem(limits_c: tuple[float, float] | None, shown_c: Mapping[str, float]) -> str:
    """Return why numbers cannot be a chamber's in °C, or an empty string.

    Parameters
    ----------
    limits_c : (float, float) or None
        The controller's set point limits, where it has any.
    shown_c : mapping
        What it shows, by name: "temperature" must be one that a room or this chamber can have,
        the others one that any chamber can.

    Returns
    -------
    str
        In a few words, of the first that cannot be.
    """
    named = dict(shown_c)
    if limits_c is not None:
        named = {"low set point limit": limits_c[0], "high set point limit": limits_c[1]} | named
    for name, value in named.items():
        if value not in CHAMBER_C:
            return f"{name} {value:g}, expected {CHAMBER_C.lo:g} to {CHAMBER_C.hi:g} °C"
        if 0.0 < abs(value) < SMALLEST_C:
            return f"{name} {value:g}, a float whose words come in the other order"
    if limits_c is None:
        return ""
    lo, hi = limits_c
    if not hi - lo >= NARROWEST_C:
        apart = f"the high {NARROWEST_C:g} °C above the low"
        return f"set point limits {lo:g} and {hi:g}, expected {apart}"
    temp_c = shown_c.get("temperature", lo)
    coldest = min(lo - BEYOND_LIMITS_C, ROOM_C.lo)
    hottest = max(hi + BEYOND_LIMITS_C, ROOM_C.hi)
    if not coldest <= temp_c <= hottest:
        return f"temperature {temp_c:g}, expected {coldest:g} to {hottest:g} °C"
    return ""


def swap_words(value: float) -> float:
    """Return the float that the two words of a float32 make in the other order."""
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    return float(struct.unpack(">f", struct.pack(">HH", low, high))[0])


class RecognisedController(ControllerRegisters, ABC):
    """A controller that is written to only once it has been recognised.

    Parameters
    ----------
    config : ChamberConfig
        Model, link, limits and scaling.
    name : str
        The instrument's name, for messages.
    permit : callable, optional
        Called right before every write; what it raises keeps it from being sent.
    recognition : mapping, optional
        What another process recognised the same controller by.

    Raises
    ------
    ValueError
        If the URL cannot be understood or there is no map of the model.
    """

    def __init__(
        self,
        config: ChamberConfig,
        *,
        name: str = "chamber",
        permit: Callable[[], None] | None = None,
        recognition: Evidence | None = None,
    ) -> None:
        super().__init__(config, name=name, permit=permit)
        self._limits = ChamberLimits(config, self._map, name=name)
        self._commanding = threading.RLock()  # making safe must not be undone by a ramp half set
        self._known = dict(recognition or {})  # what it was recognised by before, here or elsewhere

    @property
    def recognition(self) -> Evidence:
        """Values by which `identify` recognised the controller; empty before."""
        return dict(self._evidence)

    # ---- what a model shows

    @abstractmethod
    def _read_scale(self) -> dict[str, float | str]:
        """Read what shows scale and unit; RecognitionError if they are not the station file's."""

    @abstractmethod
    def _check_setpoints(self, shown: Mapping[str, float]) -> None:
        """Raise RecognitionError where set points that must agree do not."""

    def _check_words(self, limits: tuple[float, float] | None, shown: Mapping[str, float]) -> None:
        """Raise RecognitionError unless the floats make sense in one word order, the file's."""

    def _check_confirmed(self, scale: Evidence) -> None:
        """Raise RecognitionError where the station file must confirm what is not shown."""

    # ---- recognising

    def _recognise(self) -> None:
        """Let writes through if this is the controller of the station file, or the one known.

        One that was recognised before is compared with what it showed then; its temperature is
        not asked for, since the sensor may have broken meanwhile. Otherwise all that it shows must
        be what a chamber can show in °C.

        Raises
        ------
        RecognitionError
            If it is not; nothing is written from here on.
        InstrumentError
            If it does not answer.
        """
        try:
            scale = self._read_scale()
            shown: dict[str, float | str] = {"model": self._map.title} | scale
            limits = self._read_limits()
            if limits is not None:
                shown |= {"setpoint_low": limits[0], "setpoint_high": limits[1]}
            if self._known:
                self._check_known(shown)
            else:
                self._check_shown(limits)
                self._check_confirmed(scale)
            self._limits.narrow(*(limits or self._config.limits_c))
            self._limits.check_safe_temp()
        except RecognitionError:
            self._evidence = {}
            raise
        self._evidence = self._known = shown

    def _still_recognised(self) -> str:
        """Check, before a command, that scale and unit are what they were; say what they are.

        The set point limits need not be what they were, but must still be a chamber's: with the
        word order changed at the panel they are not.

        Raises
        ------
        RecognitionError
            If they are not, or the controller was never recognised.
        """
        self._require_recognition()
        try:
            scale = self._check_scale()
        except RecognitionError:
            self._evidence = {}
            raise
        return ", ".join(f"{name} {_text(value)}" for name, value in scale.items())

    def _check_scale(self) -> Evidence:
        """Read what shows scale, unit and word order; RecognitionError if it is not as it was."""
        scale = self._read_scale()
        self._check_known(scale)
        problem = find_problem(self._read_limits(), {})
        if problem:
            raise self._not_recognised(problem)
        return scale

    def _check_known(self, shown: Evidence) -> None:
        """Raise RecognitionError where something shown is not what is known."""
        for name, value in shown.items():
            known = self._known.get(name)
            if known != value:
                before = "nothing" if known is None else _text(known)
                label = name.replace("_", " ")
                raise self._not_recognised(
                    f"{label} is {_text(value)}, was {before} when it was recognised"
                )

    def _check_shown(self, limits: tuple[float, float] | None) -> None:
        """Raise RecognitionError where what is shown cannot be a chamber in °C."""
        shown = {"temperature": self._get("temperature"), "set point": self._get("setpoint")}
        if "working_setpoint" in self._map.registers:
            working = self._get_optional("working_setpoint")
            shown |= {} if working is None else {"working set point": working}
        self._check_words(limits, shown)
        problem = find_problem(limits or self._config.limits_c, shown)
        if problem:
            raise self._not_recognised(problem)
        self._check_setpoints(shown)

    def _read_limits(self) -> tuple[float, float] | None:
        """Read the controller's own set point limits, where the model has them."""
        if "setpoint_low" not in self._map.registers:
            return None
        return self._get_proof("setpoint_low"), self._get_proof("setpoint_high")

    def _get_proof(self, name: str) -> float:
        """Read a register without which the controller cannot be recognised."""
        try:
            return self._get(name)
        except RefusalError as refusal:
            if refusal.absent:
                raise self._not_recognised(str(refusal).removeprefix(f"{self._name}: ")) from None
            raise

    def _require_confirmation(self, wanted: str, missing: str) -> None:
        """Raise RecognitionError unless the station file confirms what no register shows."""
        given = self._config.confirmed
        if given == wanted:
            return
        temp_c, setpoint_c = self._get("temperature"), self._get("setpoint")
        now = f' (it has "{given}")' if given is not None else ""
        raise self._not_recognised(
            f"no register shows {missing}; it reads {temp_c:g} °C, set point {setpoint_c:g} °C: "
            f'if its display says so, put confirmed = "{wanted}" into [chamber] of the station '
            f"file{now}"
        )

    def _not_recognised(self, why: str) -> RecognitionError:
        return RecognitionError(f"{self._name}: not recognised: {why}; nothing was sent")

    def _plausible(self, what: str, value: float) -> float:
        if value not in CHAMBER_C:
            raise DeviceError(
                f"{self._name}: {what} {value:g} °C, expected {CHAMBER_C.lo:g} to "
                f"{CHAMBER_C.hi:g}: broken sensor or wrong register map"
            )
        return value


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
