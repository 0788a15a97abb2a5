"""The one module that knows pymodbus: a port on which one question is asked at a time.

pymodbus frames the questions and decodes the answers. Opening the port, so that the reason of a
failure is not lost, and checking every byte of an answer against its question stand here. What to
do about a failure is decided in `drivers.links.modbus_link`.
"""

import logging
import select
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.framer import FramerRTU, FramerType
from pymodbus.pdu import ModbusPDU

from drivers.station import LinkConfig

# what pymodbus has to say the link says once, in a line; without this it lands on stderr
_library_log = logging.getLogger("pymodbus")
_library_log.addHandler(logging.NullHandler())
_library_log.propagate = False

Transport = Literal["tcp", "rtu+tcp", "rtu"]


class PortError(Exception):
    """The port cannot be opened, or is gone; the message says why."""


class SilenceError(Exception):
    """Not a byte came back in time."""


class BadReplyError(Exception):
    """The bytes that came back are not the answer, or not all of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """Place of a controller: a transport and an address on it."""

    transport: Transport
    host: str  # or the path of the serial port
    port: int


@dataclass(frozen=True, slots=True)
class Question:
    """A request in the terms of the protocol; functions 3, 4, 6 and 16."""

    function: int
    address: int
    count: int
    words: tuple[int, ...]  # to be written
    what: str  # for messages and counters


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of a controller: the words read, or the code of its exception."""

    words: tuple[int, ...]
    exception: int | None = None


def parse_modbus_url(url: str) -> Endpoint:
    """Read the URL of a Modbus controller.

    Parameters
    ----------
    url : str
        ``modbus+tcp://host:port``, ``modbus+rtu+tcp://host:port`` (port 502 when left out) or
        ``modbus+rtu:///dev/ttyUSB0``.

    Returns
    -------
    Endpoint

    Raises
    ------
    ValueError
        If it is not one of them.
    """
    expected = "expected modbus+tcp://host:port, modbus+rtu+tcp://host:port or modbus+rtu:///dev/…"
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise ValueError(f"url {url!r}: {expected}") from None
    if parts.scheme == "modbus+rtu" and parts.path.strip("/") and not parts.netloc:
        return Endpoint(transport="rtu", host=parts.path, port=0)
    if parts.scheme in ("modbus+tcp", "modbus+rtu+tcp") and host and parts.path in ("", "/"):
        transport: Transport = "tcp" if parts.scheme == "modbus+tcp" else "rtu+tcp"
        return Endpoint(transport=transport, host=host, port=502 if port is None else port)
    raise ValueError(f"url {url!r}: {expected}")


class Port:
    """An open connection to a controller; one that failed is closed and not used again.

    Parameters
    ----------
    endpoint : Endpoint
    config : LinkConfig
        Unit, baud rate and time limit.
    transaction : int
        Number of the last transaction on the port before this one.

    Raises
    ------
    PortError
        If it cannot be opened.
    """

    def __init__(self, endpoint: Endpoint, config: LinkConfig, transaction: int) -> None:
        self.sent = False  # whether the last question went out
        self._rtu = endpoint.transport != "tcp"
        self._config = config
        self._request = b""
        self._heard = False
        self._deadline_s = 0.0
        try:
            self._client = self._open(endpoint)
        except Exception as error:  # OSError, termios.error, OverflowError, UnicodeError…
            raise PortError(_reason(error)) from None
        self._client.transaction.next_tid = transaction

    @property
    def transaction(self) -> int:
        """Number of the last transaction."""
        return self._client.transaction.next_tid

    def ask(self, question: Question) -> Answer:
        """Send a question and wait for its answer.

        Raises
        ------
        SilenceError
            Nothing came back in time.
        BadReplyError
            What came back does not answer the question, or is not all of an answer.
        PortError
            The connection is gone.
        """
        self._heard = self.sent = False
        self._deadline_s = time.monotonic() + 2 * self._config.timeout_s
        if self._client.socket is None:  # pymodbus would connect again by itself
            raise PortError("connection lost")
        try:
            reply = self._call(question)
        except BadReplyError:
            raise
        except Exception as error:  # the library lets out many kinds; none may go further
            if isinstance(error, OSError) or "Connection" in type(error).__name__:
                raise PortError("connection lost") from None
            if self._heard:
                raise BadReplyError("reply not complete") from None
            raise SilenceError(f"no reply in {self._config.timeout_s:g} s") from None
        if reply.isError():
            return Answer((), int(getattr(reply, "exception_code", 0)))
        reads = question.function in (3, 4)
        return Answer(tuple(int(r) & 0xFFFF for r in reply.registers) if reads else ())

    def is_stale(self) -> bool:
        """Tell whether the idle port holds bytes, or was closed from the other side."""
        port = self._client.socket
        try:
            if port is None:
                return True
            if isinstance(port, socket.socket):
                return bool(select.select([port], [], [], 0)[0])
            return port.in_waiting > 0
        except (OSError, ValueError):
            return True

    def drain(self, quiet_s: float) -> None:
        """Throw away what comes until nothing comes for `quiet_s`.

        Raises
        ------
        BadReplyError
            If the line does not fall quiet within ten times as long.
        PortError
            If the connection is gone.
        """
        give_up_s = time.monotonic() + 10 * quiet_s
        try:
            while time.monotonic() < give_up_s:
                if not self._heard_within(quiet_s):
                    return
        except (OSError, ValueError):
            raise PortError("connection lost") from None
        raise BadReplyError("the line never falls quiet")

    def close(self) -> None:
        """Close it; a port that is gone may fail to, which is as good."""
        with suppress(Exception):
            self._client.close()

    def _heard_within(self, wait_s: float) -> bool:
        port = self._client.socket
        if isinstance(port, socket.socket):
            if not select.select([port], [], [], wait_s)[0]:
                return False
            if not port.recv(4096):
                raise OSError("closed from the other side")
            return True
        if port is None:
            raise OSError("closed")
        port.timeout = wait_s
        heard = bool(port.read(1))
        port.reset_input_buffer()
        port.timeout = self._config.timeout_s
        return heard

    def _open(self, end: Endpoint) -> ModbusTcpClient | ModbusSerialClient:
        timeout_s, baud = self._config.timeout_s, self._config.baud
        if end.transport == "rtu":
            line = ModbusSerialClient(
                end.host, baudrate=baud, timeout=timeout_s, retries=0, trace_packet=self._on_bytes
            )
            line.socket = serial.Serial(
                end.host,
                baudrate=baud,
                timeout=timeout_s,
                write_timeout=timeout_s,
                exclusive=True,  # two masters on one line would take each other's replies
            )
            return line
        framer = FramerType.SOCKET if end.transport == "tcp" else FramerType.RTU
        client = ModbusTcpClient(
            end.host,
            port=end.port,
            framer=framer,
            timeout=timeout_s,
            retries=0,
            trace_packet=self._on_bytes,
        )
        client.socket = socket.create_connection((end.host, end.port), timeout=timeout_s)
        client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client

    def _call(self, question: Question) -> ModbusPDU:
        client, unit, at = self._client, self._config.unit_id, question.address
        if question.function == 3:
            return client.read_holding_registers(at, count=question.count, device_id=unit)
        if question.function == 4:
            return client.read_input_registers(at, count=question.count, device_id=unit)
        if question.function == 6:
            return client.write_register(at, question.words[0], device_id=unit)
        return client.write_registers(at, list(question.words), device_id=unit)

    def _on_bytes(self, sending: bool, data: bytes) -> bytes:
        """See each frame as it passes; stop the exchange at the first wrong byte of a reply."""
        if sending:
            self._request = bytes(data)
            self.sent = True
            return data
        self._heard = True
        check_reply(self._request, bytes(data), rtu=self._rtu)
        if time.monotonic() > self._deadline_s:
            raise BadReplyError("the reply trickles in too slowly")
        return data


def _reason(error: Exception) -> str:
    """Say in a few words why a port does not open."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return text.partition("\n")[0]


def check_reply(request: bytes, reply: bytes, *, rtu: bool) -> None:
    """Check that bytes are the beginning, or the whole, of an answer to a request.

    Parameters
    ----------
    request : bytes
        The frame sent: function 3, 4, 6 or 16.
    reply : bytes
        What has come back so far.
    rtu : bool
        RTU framing (address, PDU, CRC) instead of TCP's (transaction, length, unit, PDU).

    Raises
    ------
    BadReplyError
        At the first byte that cannot belong to the answer, at bytes too many, and on a wrong CRC.
    """
    head = 1 if rtu else 7
    unit, pdu = request[head - 1 : head], request[head:]
    function = pdu[0]
    if function in (3, 4):
        size = 2 + 2 * int.from_bytes(pdu[3:5], "big")
        normal = bytes((function, (size - 2) & 0xFF))
    else:
        size, normal = 5, pdu[:5]
    for start, length in ((normal, size), (bytes((function | 0x80,)), 2)):
        prefix = unit + start
        if not rtu:
            prefix = request[:2] + b"\0\0" + (length + 1).to_bytes(2, "big") + prefix
        if not reply.startswith(prefix[: len(reply)]):
            continue
        whole = head + length + (2 if rtu else 0)
        if len(reply) > whole:
            raise BadReplyError(f"{len(reply)} bytes came back, expected {whole}")
        if rtu and len(reply) == whole:
            crc = FramerRTU.compute_CRC(reply[:-2]).to_bytes(2, "big")
            if reply[-2:] != crc:
                raise BadReplyError(f"CRC {reply[-2:].hex()} is wrong, expected {crc.hex()}")
        return
    said = reply[head - 1 : head]
    if said not in (b"", unit):
        raise BadReplyError(f"unit {said[0]} answered, expected {unit[0]}")
    raise BadReplyError(f"{reply[:16].hex(' ')} is no answer to {request[:16].hex(' ')}")
