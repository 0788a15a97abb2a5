"""An emulated 34970A: the instrument's command set as far as scanning goes, on a plant.

It keeps the instrument's habits: CONFigure and *RST switch the reading fields off, commands with
a scan list redefine the scan list, channels are scanned in ascending order, an overload reads
9.9E+37 and is no error, a query that fails answers nothing.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.clock import Clock
from drivers.emulators import scpi
from drivers.emulators.faults import FaultPlan
from drivers.emulators.plant import Plant
from drivers.emulators.scpi import ScpiError
from drivers.emulators.serial_server import SerialServer
from drivers.emulators.served import Served

IDENTITY = "HEWLETT-PACKARD,34970A,0,13-2-2"
LINE_PERIOD_S = 0.020
QUEUE_DEPTH = 20
OVERRANGE = 1.2
OVERLOAD = "9.90000000E+37"
NPLC = (0.02, 0.2, 1.0, 2.0, 10.0, 20.0, 100.0, 200.0)
RANGES = {
    "VOLT": (0.1, 1.0, 10.0, 100.0, 300.0),
    "RES": (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8),
}
UNITS = {"VOLT": "VDC", "RES": "OHM"}
FIELDS = {"CHANnel": "chan", "TIME": "time", "UNIT": "unit", "ALARm": "alar"}


@dataclass(slots=True)
class _Channel:
    """Measurement that one channel is set to."""

    function: str = "VOLT"
    full_scale: float | None = None  # None: autorange
    nplc: float = 1.0


@dataclass(slots=True)
class _Settings:
    """Settings that *RST resets."""

    channels: dict[int, _Channel] = field(default_factory=dict[int, _Channel])
    scan_list: tuple[int, ...] = ()
    fields: dict[str, bool] = field(default_factory=lambda: dict.fromkeys(FIELDS.values(), False))
    absolute_time: bool = False
    trigger: str = "IMM"
    sweeps: int = 1
    stored: str | None = None


class MultimeterEmulator(Served):
    """A 34970A with three 20-channel multiplexers, on a port.

    Parameters
    ----------
    plant : Plant
        What the channels are wired to.
    clock : Clock
        The emulation's clock; it is read, never moved.
    faults : FaultPlan
        How it misbehaves. While "sensor_break" is on, resistances read an overload.
    url : str
        Where: ``serial:///path``, ``serial://auto`` or ``socket://host:port``.
    identity : str
        The answer to ``*IDN?``.
    """

    def __init__(
        self,
        plant: Plant,
        clock: Clock,
        faults: FaultPlan,
        *,
        url: str = "serial://auto",
        identity: str = IDENTITY,
    ) -> None:
        self.faults = faults
        self._plant = plant
        self._clock = clock
        self._identity = identity
        self._set = _Settings()
        self._errors: list[tuple[int, str]] = []
        self._lock = threading.Lock()
        self._server = SerialServer(url, self, faults)
        self._table = [
            (scpi.header_pattern(header), action) for header, action in self._commands().items()
        ]

    def refuse(self) -> None:
        """Put an error into the queue."""
        with self._lock:
            self._push(-310, "System error")

    def respond(self, line: str) -> str | None:
        """Do what a line says.

        Returns
        -------
        str or None
            The replies of its queries joined by semicolons; None when there are none.
        """
        replies: list[str] = []
        with self._lock:
            for header, rest in scpi.split_commands(line):
                try:
                    reply = self._run(header, scpi.split_parameters(rest))
                except ScpiError as err:
                    self._push(err.code, err.text)
                    break  # the instrument throws away the rest of the line
                if reply is not None:
                    replies.append(reply)
        return ";".join(replies) if replies else None

    # ---- commands

    def _commands(self) -> dict[str, Callable[[list[str]], str | None]]:
        """Return what each header does."""
        table: dict[str, Callable[[list[str]], str | None]] = {
            "*IDN?": lambda _: self._identity,
            "*RST": lambda _: self._reset(),
            "*CLS": lambda _: self._errors.clear(),
            "*OPC?": lambda _: "1",
            "*TST?": lambda _: "+0",
            "*WAI": lambda _: None,
            "*OPC": lambda _: None,
            "SYSTem:ERRor[:NEXT]?": lambda _: self._pop(),
            "SYSTem:VERSion?": lambda _: "1994.0",
            "SYSTem:REMote": lambda _: None,
            "SYSTem:RWLock": lambda _: None,
            "SYSTem:LOCal": lambda _: None,
            "SYSTem:PRESet": lambda _: self._reset(),
            "CONFigure:VOLTage[:DC]": lambda p: self._configure("VOLT", p),
            "CONFigure:RESistance": lambda p: self._configure("RES", p),
            "CONFigure?": self._tell_configuration,
            "ROUTe:SCAN": lambda p: self._set_scan_list(p),
            "ROUTe:SCAN?": lambda _: scpi.block(_list(self._set.scan_list)),
            "ROUTe:SCAN:SIZE?": lambda _: f"+{len(self._set.scan_list)}",
            "FORMat:READing:TIME:TYPE": self._set_time_type,
            "FORMat:READing:TIME:TYPE?": lambda _: "ABS" if self._set.absolute_time else "REL",
            "TRIGger:SOURce": self._set_trigger,
            "TRIGger:SOURce?": lambda _: self._set.trigger,
            "TRIGger:COUNt": self._set_sweeps,
            "TRIGger:COUNt?": lambda _: f"{self._set.sweeps:+.8E}",
            "ABORt": lambda _: None,
            "READ?": lambda _: self._scan(),
            "INITiate[:IMMediate]": lambda _: self._store(),
            "FETCh?": lambda _: self._fetch(),
        }
        for function, name in (("VOLT", "[SENSe:]VOLTage[:DC]"), ("RES", "[SENSe:]RESistance")):
            table[f"{name}:NPLC"] = lambda p, f=function: self._set_nplc(f, p)
            table[f"{name}:NPLC?"] = lambda p, f=function: self._tell_nplc(f, p)
        for name, key in FIELDS.items():
            table[f"FORMat:READing:{name}"] = lambda p, k=key: self._set_field(k, p)
            table[f"FORMat:READing:{name}?"] = lambda _, k=key: str(int(self._set.fields[k]))
        return table

    def _run(self, header: str, parameters: list[str]) -> str | None:
        for pattern, action in self._table:
            if pattern.fullmatch(header):
                return action(parameters)
        raise ScpiError(*scpi.UNDEFINED_HEADER)

    def _push(self, code: int, text: str) -> None:
        if len(self._errors) == QUEUE_DEPTH:
            self._errors[-1] = (-350, "Error queue overflow")
        else:
            self._errors.append((code, text))

    def _pop(self) -> str:
        code, text = self._errors.pop(0) if self._errors else (0, "No error")
        return f'{code:+d},"{text}"'

    def _reset(self) -> None:
        self._set = _Settings()

    def _configure(self, function: str, parameters: list[str]) -> None:
        if not parameters or len(parameters) > 3:
            missing = not parameters
            raise ScpiError(*(scpi.MISSING_PARAMETER if missing else scpi.PARAMETER_NOT_ALLOWED))
        channels = scpi.channel_list(parameters[-1], _exists)
        full_scale = _range(function, parameters[0] if len(parameters) > 1 else "DEF")
        for number in channels:
            self._set.channels[number] = _Channel(function=function, full_scale=full_scale)
        self._set.scan_list = channels
        self._set.fields = dict.fromkeys(FIELDS.values(), False)

    def _tell_configuration(self, parameters: list[str]) -> str:
        told: list[str] = []
        for number in self._listed(parameters):
            channel = self._channel(number)
            full_scale = channel.full_scale or RANGES[channel.function][2]
            told.append(f'"{channel.function} {full_scale:+.6E},{full_scale * 1e-6:+.6E}"')
        return ",".join(told)

    def _set_scan_list(self, parameters: list[str]) -> None:
        if len(parameters) != 1:
            raise ScpiError(*scpi.MISSING_PARAMETER)
        self._set.scan_list = scpi.channel_list(parameters[0], _exists)

    def _set_nplc(self, function: str, parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(*scpi.MISSING_PARAMETER)
        wanted = _number(parameters[0], {"MIN": NPLC[0], "MAX": NPLC[-1], "DEF": 1.0})
        if not NPLC[0] <= wanted <= NPLC[-1]:
            raise ScpiError(*scpi.OUT_OF_RANGE)
        nplc = next(n for n in NPLC if n >= wanted)
        channels = [self._channel(n) for n in self._listed(parameters[1:])]
        if any(c.function != function for c in channels):
            raise ScpiError(*scpi.SETTINGS_CONFLICT)
        for channel in channels:
            channel.nplc = nplc

    def _tell_nplc(self, function: str, parameters: list[str]) -> str:
        channels = [self._channel(n) for n in self._listed(parameters)]
        if any(c.function != function for c in channels):
            raise ScpiError(*scpi.SETTINGS_CONFLICT)
        return ",".join(f"{c.nplc:+.8E}" for c in channels)

    def _set_field(self, key: str, parameters: list[str]) -> None:
        self._set.fields[key] = _switch(parameters)

    def _set_time_type(self, parameters: list[str]) -> None:
        choice = scpi.one_of("".join(parameters), ("ABSolute", "RELative"))
        self._set.absolute_time = choice == "ABS"

    def _set_trigger(self, parameters: list[str]) -> None:
        self._set.trigger = scpi.one_of("".join(parameters), ("IMMediate", "BUS", "TIMer"))

    def _set_sweeps(self, parameters: list[str]) -> None:
        sweeps = _number("".join(parameters), {"MIN": 1.0, "MAX": 50000.0, "DEF": 1.0})
        if not 1 <= sweeps <= 50000:
            raise ScpiError(*scpi.OUT_OF_RANGE)
        self._set.sweeps = int(sweeps)

    def _listed(self, parameters: list[str]) -> tuple[int, ...]:
        """Return the channels named, or the scan list."""
        if not parameters:
            return self._set.scan_list
        return scpi.channel_list(parameters[0], _exists)

    def _channel(self, number: int) -> _Channel:
        return self._set.channels.setdefault(number, _Channel())

    # ---- measuring

    def _store(self) -> None:
        self._set.stored = self._scan()

    def _fetch(self) -> str:
        if self._set.stored is None:
            raise ScpiError(*scpi.DATA_STALE)
        return self._set.stored

    def _scan(self) -> str:
        """Measure the scan list once for each sweep."""
        if not self._set.scan_list:
            raise ScpiError(*scpi.SETTINGS_CONFLICT)
        began_s = self._clock.now_s()
        offset_s = 0.0
        readings: list[str] = []
        for _ in range(self._set.sweeps):
            for number in self._set.scan_list:
                channel = self._channel(number)
                offset_s += channel.nplc * LINE_PERIOD_S
                readings.append(self._reading(number, channel, began_s, offset_s))
        return ",".join(readings)

    def _reading(self, number: int, channel: _Channel, began_s: float, offset_s: float) -> str:
        """Measure one channel and write it in the present format."""
        value = self._plant.channel_value(began_s + offset_s, number)
        fields = self._set.fields
        parts = [self._written(value, channel)]
        if fields["unit"]:
            parts[0] += f" {UNITS[channel.function]}"
        if fields["time"]:
            parts.append(self._stamp(began_s, offset_s))
        if fields["chan"]:
            parts.append(f"{number:d}")
        if fields["alar"]:
            parts.append("0")
        return ",".join(parts)

    def _written(self, value: float, channel: _Channel) -> str:
        limit = OVERRANGE * (channel.full_scale or RANGES[channel.function][-1])
        broken = channel.function == "RES" and self.faults.active("sensor_break")
        if broken or not abs(value) <= limit:
            return ("-" if value < 0 and not broken else "+") + OVERLOAD
        return f"{value:+.8E}"

    def _stamp(self, began_s: float, offset_s: float) -> str:
        if not self._set.absolute_time:
            return f"{offset_s:013.3f}"
        minutes, seconds = divmod(began_s + offset_s, 60.0)
        hours, minutes = divmod(int(minutes), 60)
        return f"2026,01,01,{hours % 24:02d},{minutes:02d},{math.floor(seconds * 1e3) / 1e3:06.3f}"


def _exists(number: int) -> bool:
    """Tell whether a channel is on one of three 20-channel multiplexers."""
    return number // 100 in (1, 2, 3) and 1 <= number % 100 <= 20


def _list(numbers: tuple[int, ...]) -> str:
    return "(@" + ",".join(str(n) for n in numbers) + ")"


def _number(text: str, words: dict[str, float]) -> float:
    """Read a number or one of the words MIN, MAX, DEF."""
    short = text.strip().upper()[:3]
    if short in words:
        return words[short]
    try:
        value = float(text)
    except ValueError:
        raise ScpiError(*scpi.SUFFIX_OR_DATA) from None
    if not math.isfinite(value):
        raise ScpiError(*scpi.OUT_OF_RANGE)
    return value


def _range(function: str, text: str) -> float | None:
    """Return the range that holds what was asked for; None for autorange."""
    ranges = RANGES[function]
    if text.strip().upper() in ("AUTO", "DEF", "DEFAULT"):
        return None
    wanted = abs(_number(text, {"MIN": ranges[0], "MAX": ranges[-1]}))
    for candidate in ranges:
        if wanted <= candidate:
            return candidate
    raise ScpiError(*scpi.OUT_OF_RANGE)


def _switch(parameters: list[str]) -> bool:
    """Read ON, OFF, 1 or 0."""
    if len(parameters) != 1:
        raise ScpiError(*scpi.MISSING_PARAMETER)
    if parameters[0].upper() not in ("ON", "OFF", "1", "0"):
        raise ScpiError(*scpi.ILLEGAL_PARAMETER)
    return parameters[0].upper() in ("ON", "1")
