"""Modbus as the chamber drivers use it: the one module that knows pymodbus.

pymodbus frames the questions and decodes the answers; opening the port, checking that an answer
belongs to its question, and what to do when it does not, stand here. After anything but a clean
answer the link is dropped and made anew before the next question, so that a late reply is never
taken for the next answer. On RTU, where a reply does not say what it answers, a new link is first
brought into step: the line must fall quiet and then answer a question of unusual length.
"""

import logging
import select
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.framer import FramerRTU, FramerType
from pymodbus.pdu import ModbusPDU

from drivers.devices import LinkCounters
from drivers.errors import DeviceError, InstrumentError, LinkError, ProtocolError
from drivers.registers import Barrier
from drivers.station import LinkConfig

log = logging.getLogger(__name__)

# what pymodbus has to say is said by this module once, in a line; without this it lands on stderr
_library_log = logging.getLogger("pymodbus")
_library_log.addHandler(logging.NullHandler())
_library_log.propagate = False

Transport = Literal["tcp", "rtu+tcp", "rtu"]
BARRIER_TRIES = 3
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, still working on it",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}
_TRY_AGAIN = frozenset((5, 6))
_ABSENT = frozenset((1, 2))


class RefusalError(DeviceError):
    """The controller answered with a Modbus exception."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code

    @property
    def absent(self) -> bool:
        """Whether the controller says that it has no such register."""
        return self.code in _ABSENT


class BadReplyError(Exception):
    """The bytes so far cannot become the answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """Where a controller is: a transport and an address on it."""

    transport: Transport
    host: str  # or the path of the serial port
    port: int


def parse_url(url: str) -> Endpoint:
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
        If it is none of them.
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


@dataclass(frozen=True, slots=True)
class _Question:
    """A request in the terms of the protocol."""

    function: int
    address: int
    count: int
    words: tuple[int, ...]
    what: str


class ModbusLink:
    """One controller at the end of a wire. Thread-safe: one question at a time.

    The port is opened with the first question.

    Parameters
    ----------
    config : LinkConfig
        URL, unit, time limit and retries.
    name : str
        The instrument's name, for messages.
    barrier : Barrier
        Registers to bring an RTU line into step with.

    Raises
    ------
    ValueError
        If the URL cannot be understood.
    """

    def __init__(self, config: LinkConfig, *, name: str, barrier: Barrier) -> None:
        self.name = name
        self.url = config.url
        self.counters = LinkCounters()
        self._config = config
        self._barrier = barrier
        self._endpoint = parse_url(config.url)
        self._lock = threading.RLock()
        self._client: ModbusTcpClient | ModbusSerialClient | None = None
        self._closed = False
        self._was_open = False
        self._must_settle = False  # the last link was dropped with a reply perhaps still to come
        self._transaction = 0  # goes on over new links, so that an old reply is known by its number
        self._barriers = 0
        self._request = b""
        self._heard = False
        self._sent = False
        self._deadline_s = 0.0

    def read(
        self, address: int, count: int, *, what: str = "registers", function: Literal[3, 4] = 3
    ) -> tuple[int, ...]:
        """Read registers.

        Parameters
        ----------
        address : int
            Of the first register, 0-based.
        count : int
            How many.
        what : str
            What is read, for messages and counters.
        function : int
            3 for holding, 4 for input registers.

        Returns
        -------
        tuple of int, length `count`

        Raises
        ------
        LinkError
            No answer, or no connection.
        ProtocolError
            An answer, but not to this question.
        RefusalError
            The controller refused.
        """
        return self._ask(_Question(function, address, count, (), f"read {what}"), repeatable=True)

    def write(
        self,
        address: int,
        words: Sequence[int],
        *,
        what: str = "registers",
        repeatable: bool = True,
    ) -> None:
        """Write registers: one with function 6, several with function 16.

        Parameters
        ----------
        address : int
            Of the first register, 0-based.
        words : sequence of int
            16-bit values.
        what : str
            What is written, for messages and counters.
        repeatable : bool
            False for a command that must not be given twice: once sent it is not sent again, and
            the error leaves open whether the controller took it.

        Raises
        ------
        LinkError, ProtocolError, RefusalError
            As for `read`.
        """
        function = 6 if len(words) == 1 else 16
        question = _Question(function, address, len(words), tuple(words), f"write {what}")
        self._ask(question, repeatable=repeatable)

    def close(self) -> None:
        """Release the port for good; harmless when done twice."""
        with self._lock:
            self._closed = True
            self._drop()

    # ---- one question and what may become of it

    def _ask(self, question: _Question, *, repeatable: bool) -> tuple[int, ...]:
        with self._lock:
            attempt = 0
            while True:
                self._sent = False
                try:
                    return self._exchange(question)
                except InstrumentError as failure:
                    attempt += 1
                    self._note(failure)
                    again = self._may_repeat(failure, repeatable=repeatable)
                    if not again or attempt > self._config.retries:
                        raise
                    self.counters.retries += 1
                    log.warning("%s; asking again (%d/%d)", failure, attempt, self._config.retries)

    def _may_repeat(self, failure: InstrumentError, *, repeatable: bool) -> bool:
        if self._closed:
            return False
        if isinstance(failure, RefusalError):  # refused, so not done: safe to repeat
            return failure.code == 6 or (repeatable and failure.code in _TRY_AGAIN)
        return repeatable or not self._sent

    def _note(self, failure: InstrumentError) -> None:
        """Count a failure; whatever was not a clean answer costs the link."""
        self.counters.last_fault = str(failure)
        if not isinstance(failure, RefusalError):
            self._drop()

    def _exchange(self, question: _Question) -> tuple[int, ...]:
        try:
            client = self._ready_client()
        finally:
            self._sent = False  # what went over the wire so far was not this question
        return self._converse(client, question)

    def _converse(
        self, client: ModbusTcpClient | ModbusSerialClient, question: _Question
    ) -> tuple[int, ...]:
        """Send a question on an open link and return the words of its answer."""
        where = f"{self.name}: {question.what} at {question.address}"
        self.counters.exchanges += 1
        by_command = self.counters.by_command
        by_command[question.what] = by_command.get(question.what, 0) + 1
        self._heard = False
        self._deadline_s = time.monotonic() + 2 * self._config.timeout_s
        client.transaction.next_tid = self._transaction
        clean = False
        try:
            reply = self._call(client, question)
            clean = True
        except BadReplyError as error:
            self.counters.bad_replies += 1
            raise ProtocolError(f"{where}: {error}, link dropped, {self.url}") from None
        except Exception as error:  # the library lets out many kinds; none may go further
            raise self._failure(where, error) from None
        finally:
            self._transaction = client.transaction.next_tid
            if not clean:  # also when interrupted: a reply may still be on its way
                self._drop()
        if reply.isError():
            code = int(getattr(reply, "exception_code", 0))
            words = EXCEPTIONS.get(code, "unknown exception")
            raise RefusalError(f"{where}: refused with exception {code}, {words}", code)
        return tuple(int(r) & 0xFFFF for r in reply.registers) if question.function < 6 else ()

    def _failure(self, where: str, error: Exception) -> InstrumentError:
        """Say what the library's exception means."""
        if isinstance(error, OSError) or "Connection" in type(error).__name__:
            return LinkError(f"{where}: connection lost, {self.url}")
        if self._heard:
            self.counters.bad_replies += 1
            return ProtocolError(f"{where}: reply not complete, link dropped, {self.url}")
        self.counters.timeouts += 1
        timeout_s = self._config.timeout_s
        return LinkError(f"{where}: no reply in {timeout_s:g} s, link dropped, {self.url}")

    def _call(self, client: ModbusTcpClient | ModbusSerialClient, question: _Question) -> ModbusPDU:
        unit = self._config.unit_id
        if question.function == 3:
            return client.read_holding_registers(
                question.address, count=question.count, device_id=unit
            )
        if question.function == 4:
            return client.read_input_registers(
                question.address, count=question.count, device_id=unit
            )
        if question.function == 6:
            return client.write_register(question.address, question.words[0], device_id=unit)
        return client.write_registers(question.address, list(question.words), device_id=unit)

    def _on_bytes(self, sending: bool, data: bytes) -> bytes:
        """See each frame as it passes; stop the exchange at the first wrong byte of a reply."""
        if sending:
            self._request = bytes(data)
            self._sent = True
            return data
        self._heard = True
        check_reply(self._request, bytes(data), rtu=self._endpoint.transport != "tcp")
        if time.monotonic() > self._deadline_s:
            raise BadReplyError("the reply trickles in too slowly")
        return data

    # ---- the link itself

    def _ready_client(self) -> ModbusTcpClient | ModbusSerialClient:
        """Return an open client that is in step with the controller."""
        if self._closed:
            raise LinkError(f"{self.name}: the link to {self.url} was closed")
        if self._client is not None and self._is_stale(self._client):
            log.warning(
                "%s: idle link closed, or holding bytes, made anew, %s", self.name, self.url
            )
            self._drop()
        if self._client is not None:
            return self._client
        client = self._open()
        if self._endpoint.transport != "tcp":
            client = self._settle(client)
        self._must_settle = False
        return client

    def _is_stale(self, client: ModbusTcpClient | ModbusSerialClient) -> bool:
        """Tell whether an idle link holds bytes, or was closed from the other side."""
        port = client.socket
        try:
            if port is None:
                return True
            if isinstance(port, socket.socket):
                return bool(select.select([port], [], [], 0)[0])
            return port.in_waiting > 0
        except (OSError, ValueError):
            return True

    def _open(self) -> ModbusTcpClient | ModbusSerialClient:
        """Open the port, and count it when it is not for the first time."""
        self._client = self._new_client()
        self.counters.reconnects += self._was_open
        self._was_open = True
        return self._client

    def _new_client(self) -> ModbusTcpClient | ModbusSerialClient:
        """Open the port here rather than in pymodbus, which keeps the reason to itself."""
        timeout_s, end = self._config.timeout_s, self._endpoint
        try:
            if end.transport == "rtu":
                client = ModbusSerialClient(
                    end.host,
                    baudrate=self._config.baud,
                    timeout=timeout_s,
                    retries=0,
                    trace_packet=self._on_bytes,
                )
                client.socket = serial.Serial(
                    end.host,
                    baudrate=self._config.baud,
                    timeout=timeout_s,
                    write_timeout=timeout_s,
                    exclusive=True,  # two masters on one line would take each other's replies
                )
                return client
            tcp = ModbusTcpClient(
                end.host,
                port=end.port,
                framer=FramerType.SOCKET if end.transport == "tcp" else FramerType.RTU,
                timeout=timeout_s,
                retries=0,
                trace_packet=self._on_bytes,
            )
            tcp.socket = socket.create_connection((end.host, end.port), timeout=timeout_s)
            tcp.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return tcp
        except Exception as error:  # OSError, termios.error, OverflowError, UnicodeError…
            reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
            raise LinkError(f"{self.name}: cannot open {self.url}: {reason}") from None

    def _settle(
        self, client: ModbusTcpClient | ModbusSerialClient
    ) -> ModbusTcpClient | ModbusSerialClient:
        """Bring an RTU line into step: let it fall quiet, then have the barrier answered.

        Returns the client that is in step; the one given may have been replaced.
        """
        if self._must_settle:
            self._drain(client, self._config.timeout_s)
        for _ in range(BARRIER_TRIES):
            # the two lengths take turns, so that a late answer to one barrier is not the next's
            count = self._barrier.counts[self._barriers % 2]
            self._barriers += 1
            barrier = _Question(3, self._barrier.address, count, (), "read barrier")
            try:
                self._converse(client, barrier)
            except RefusalError:  # an answer too
                return client
            except ProtocolError as failure:
                log.warning("%s; waiting for the line to fall quiet", failure)
                client = self._open()
                self._drain(client, self._config.timeout_s)
            else:
                return client
        raise ProtocolError(f"{self.name}: replies do not fit the questions asked, {self.url}")

    def _drain(self, client: ModbusTcpClient | ModbusSerialClient, quiet_s: float) -> None:
        """Throw away what comes until nothing comes for `quiet_s`."""
        port = client.socket
        give_up_s = time.monotonic() + 10 * quiet_s
        try:
            while time.monotonic() < give_up_s:
                if isinstance(port, socket.socket):
                    if not select.select([port], [], [], quiet_s)[0]:
                        return
                    if not port.recv(4096):
                        raise LinkError(f"{self.name}: connection lost, {self.url}")
                elif port is not None:
                    port.timeout = quiet_s
                    if not port.read(1):
                        port.timeout = self._config.timeout_s
                        return
                    port.reset_input_buffer()
        except (OSError, ValueError):
            raise LinkError(f"{self.name}: connection lost, {self.url}") from None
        raise ProtocolError(f"{self.name}: the line never falls quiet, {self.url}")

    def _drop(self) -> None:
        """Close the port; whatever is still on its way will not be listened to."""
        client, self._client = self._client, None
        self._must_settle = True
        if client is not None:
            with suppress(Exception):  # a port that is gone may fail to close
                client.close()


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
    raise BadReplyError(f"{reply[:16].hex(' ')} is no answer to {request[:16].hex(' ')}")
