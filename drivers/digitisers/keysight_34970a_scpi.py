"""SCPI of a 34970A: commands that set it up, and parsing of its replies.

Facts relied on, from the maker's user's guide: CONFigure and *RST switch the extra fields of a
reading off, so the FORMat commands come after; every command with a scan list redefines the scan
list, so ROUTe:SCAN comes last; channels are scanned in ascending order whatever the order of the
list; an overload reads ±9.9E+37 and puts nothing into the error queue; a reading with time and
channel is ``value,seconds since the scan began,channel``; Ctrl-C is the serial device clear; XON/
XOFF is the factory flow control.
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.devices import ScanChannel
from drivers.errors import LimitError, ProtocolError

MODEL = "34970A"
NPLC_CHOICES = (0.02, 0.2, 1.0, 2.0, 10.0, 20.0, 100.0, 200.0)
RANGES: Mapping[str, tuple[float, ...]] = {
    "voltage": (0.1, 1.0, 10.0, 100.0, 300.0),
    "resistance": (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8),
}
FUNCTIONS: Mapping[str, str] = {"voltage": "VOLT:DC", "resistance": "RES"}
OVERRANGE = 1.2  # the instrument measures up to 120 % of a range
HIGHEST = {quantity: OVERRANGE * ranges[-1] for quantity, ranges in RANGES.items()}
OVERLOAD = 9.9e37
# these only make sure of what *RST leaves anyway, or of a state that other ports do not have; an
# instrument of the family that refuses them can still be used
OPTIONAL = frozenset(("SYST:REM", "TRIG:SOUR IMM", "TRIG:COUN 1"))

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([Ee][+-]?\d+)?")
_AS_THE_MAKER_WRITES = re.compile(r"[+-]\d\.\d{8}E[+-]\d{2}")
_SIGN_LOST = re.compile(r"\s+\d\.\d{8}E[+-]\d{2}\s*")  # a blank where the maker has a sign
_DIGIT_LOST = re.compile(r"\s*[+-]\d\.\d{8}E[+-]\d\s+")  # or its last digit
_TIME = re.compile(r"\+?\d+(\.\d*)?([Ee][+-]?\d+)?")
_CHANNEL = re.compile(r"\d{3,4}")
_ERROR = re.compile(r'\s*([+-]?\d+)\s*,\s*"([^"]*)"?.*')
IDENTITY = re.compile(r"[^,]+,[^,]+,[^,]*,[^,]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanItem:
    """One reading as the instrument sent it."""

    value: float
    offset_s: float
    channel: int
    as_maker: bool  # written with the maker's fixed number of digits


def parse_scan(reply: str) -> tuple[ScanItem, ...]:
    """Parse the reply to READ? with time and channel switched on.

    Parameters
    ----------
    reply : str
        ``value,time,channel`` once for each channel, all joined by commas.

    Returns
    -------
    tuple of ScanItem
        In the order sent.

    Raises
    ------
    ProtocolError
        If the reply is not made of such triples, a channel stands twice, or time runs backwards.
    """
    if any(_SIGN_LOST.fullmatch(field) for field in reply.split(",")):
        raise ProtocolError(f"a reading without its sign in {reply[:60]!r}")
    if any(_DIGIT_LOST.fullmatch(field) for field in reply.split(",")):
        raise ProtocolError(f"a reading without its last digit in {reply[:60]!r}")
    fields = [field.strip() for field in reply.split(",")]
    if len(fields) % 3:
        raise ProtocolError(f"scan of {len(fields)} fields, expected value,time,channel triples")
    items: list[ScanItem] = []
    for value, offset, channel in zip(fields[::3], fields[1::3], fields[2::3], strict=True):
        good = _NUMBER.fullmatch(value) and _TIME.fullmatch(offset) and _CHANNEL.fullmatch(channel)
        if not good:
            raise ProtocolError(
                f"reading {f'{value},{offset},{channel}'[:60]!r}, expected value,time,channel"
            )
        items.append(
            ScanItem(
                value=float(value),
                offset_s=float(offset),
                channel=int(channel),
                as_maker=_AS_THE_MAKER_WRITES.fullmatch(value) is not None,
            )
        )
    if len({item.channel for item in items}) != len(items):
        raise ProtocolError("a channel is listed twice in a scan")
    if any(b.offset_s < a.offset_s for a, b in itertools.pairwise(items)):
        raise ProtocolError("time runs backwards within a scan")
    return tuple(items)


def parse_scpi_error(reply: str) -> tuple[int, str]:
    """Parse the reply to SYSTem:ERRor?.

    Returns
    -------
    tuple of int and str
        Code and text; code 0 when the queue was empty.

    Raises
    ------
    ProtocolError
        If it is not ``code,"text"``.
    """
    match = _ERROR.fullmatch(reply)
    if match is None:
        raise ProtocolError(f'reply {reply[:60]!r} to SYST:ERR?, expected code,"text"')
    return int(match[1]), match[2]


def range_for(channel: ScanChannel) -> float:
    """Return the smallest range of the instrument that holds a channel's full scale, V or ohm.

    An infinite full scale asks for autorange, and is returned.

    Raises
    ------
    LimitError
        If there is none or the quantity is not measured.
    """
    ranges = RANGES.get(channel.quantity)
    if ranges is None:
        raise LimitError(
            f"channel {channel.number}: quantity {channel.quantity!r}, "
            f"expected {' or '.join(RANGES)}"
        )
    if channel.full_scale == math.inf:
        return math.inf
    if channel.full_scale > 0:
        for candidate in ranges:
            if channel.full_scale <= candidate:
                return candidate
    raise LimitError(
        f"channel {channel.number}: full scale {channel.full_scale:g} is outside "
        f"0 to {ranges[-1]:g}"
    )


def configuration(channels: Sequence[ScanChannel], nplc: float) -> tuple[str, ...]:
    """Return the commands that set the instrument up for a scan, in the order they must have.

    Parameters
    ----------
    channels : sequence of ScanChannel
        At least one, each number once.
    nplc : float
        Integration time, mains periods.

    Returns
    -------
    tuple of str

    Raises
    ------
    LimitError
        If the instrument cannot measure that.
    """
    if nplc not in NPLC_CHOICES:
        raise LimitError(
            f"nplc {nplc:g}, expected one of {', '.join(f'{n:g}' for n in NPLC_CHOICES)}"
        )
    numbers = [c.number for c in channels]
    if not numbers or len(set(numbers)) != len(numbers):
        raise LimitError(f"scan list {numbers}, expected each channel once and at least one")
    groups: dict[tuple[str, float], list[int]] = {}
    for channel in channels:
        groups.setdefault((channel.quantity, range_for(channel)), []).append(channel.number)
    commands = ["SYST:REM", "*RST", "*CLS"]
    for (quantity, full_scale), members in groups.items():
        function, where = FUNCTIONS[quantity], _list(members)
        wanted = "AUTO" if math.isinf(full_scale) else f"{full_scale:g}"
        commands.append(f"CONF:{function} {wanted},{where}")
        commands.append(f"SENS:{function}:NPLC {nplc:g},{where}")
    return (
        *commands,
        "FORM:READ:CHAN ON",
        "FORM:READ:TIME ON",
        "FORM:READ:TIME:TYPE REL",
        "FORM:READ:UNIT OFF",
        "TRIG:SOUR IMM",
        "TRIG:COUN 1",
        f"ROUT:SCAN {_list(numbers)}",
    )


def _list(numbers: Sequence[int]) -> str:
    return "(@" + ",".join(str(n) for n in sorted(numbers)) + ")"


def parse_identity(reply: str) -> str:
    """Check the reply to ``*IDN?`` and return it.

    Raises
    ------
    ProtocolError
        If it is not maker, model, serial number and firmware.
    """
    if IDENTITY.fullmatch(reply) is None:
        raise ProtocolError(f"reply {reply[:60]!r} to *IDN?, expected maker,model,serial,firmware")
    return reply
