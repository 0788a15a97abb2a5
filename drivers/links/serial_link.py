"""One instrument on a serial line that answers questions with lines of text.

A reply on a serial line carries no number that says which question it answers. So the link is
always in one of two states. *In step*: nothing is waiting, the next line answers the next
question. *Out of step*, from the first silence or unreadable line on: the port is closed, opened
again, emptied, and the instrument is asked something whose answer nothing else resembles (the
fence), and every line before that answer is thrown away; only then is the next question asked.
A late reply survives closing and opening a port, the fence is what stops it.
"""

import contextlib
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers.devices import LinkCounters
from drivers.errors import DeviceError, InstrumentError, LinkError, ProtocolError
from drivers.links.serial_port import PORT_ERRORS, AnyPort, Flow, address, open_port, why

log = logging.getLogger(__name__)

T = TypeVar("T")

LINE_LIMIT = 65536  # no instrument here sends a longer line
QUIET_S = 0.05  # a line on which nothing came for so long is taken to be quiet
STEP_S = 0.25  # longest single wait inside a read, so that a dead port is noticed


class SerialLink:
    """A serial port, or a serial server's TCP port, with one instrument behind it.

    Parameters
    ----------
    url : str
        ``serial:///dev/ttyUSB0`` or ``socket://host:port``.
    name : str
        The instrument's name, for messages.
    baud : int
        Bit rate, 1/s; without meaning on TCP.
    timeout_s : float
        How long an answer may take unless the question says otherwise, real seconds.
    retries : int
        How often a question is asked again.
    fences : sequence of (str, compiled pattern)
        A question and what its answer looks like, for getting into step; the next one is tried
        when one is not answered.
    end : bytes
        What ends a command. A reply ends with LF, CR before it or not.
    flow : {"none", "xon_xoff", "rts_cts"}
        Flow control, as the instrument does it.
    clear : bytes
        What makes the instrument drop everything it is doing; sent when a fence was not answered.
    resynced : callable, optional
        Called each time the link got into step, with the link free to be asked.

    Raises
    ------
    LinkError
        If the URL is of no known kind.
    """

    def __init__(
        self,
        url: str,
        *,
        name: str,
        baud: int,
        timeout_s: float,
        retries: int,
        fences: Sequence[tuple[str, re.Pattern[str]]],
        end: bytes = b"\n",
        flow: Flow = "none",
        clear: bytes = b"",
        resynced: Callable[[], None] | None = None,
    ) -> None:
        self.url = url
        self.name = name
        self.timeout_s = timeout_s
        self.retries = retries
        self.counters = LinkCounters()
        self._address = address(url, name)
        self._baud = baud
        self._fences = tuple(fences)
        self._fence = 0
        self._failed_fences = 0
        self._end = end
        self._flow: Flow = flow
        self._clear = clear
        self._resynced = resynced
        self._port: AnyPort | None = None
        self._buffer = bytearray()
        self._in_step = False
        self._closed = False
        self._opened_before = False
        self._lock = threading.RLock()

    def open(self) -> None:
        """Open the port; no byte is sent.

        Raises
        ------
        LinkError
            If it cannot be opened.
        """
        with self._lock:
            self._closed = False
            if self._port is None:
                self._port = self._opened()
                self._opened_before = True

    def close(self) -> None:
        """Close the port; harmless when done twice."""
        with self._lock:
            self._closed = True
            self._shut()

    def transact(
        self,
        what: str,
        exchange: Callable[[], T],
        *,
        retries: int | None = None,
        retry_refusal: bool = False,
    ) -> T:
        """Do an exchange on a link that is in step, and again when the link fails it.

        Parameters
        ----------
        what : str
            The command, for messages and counters.
        exchange : callable
            Sends and receives; it is run again from its beginning, so it must be harmless twice.
        retries : int or None
            How often it may be run again; None: as the link was told. 0 for what must not be.
        retry_refusal : bool
            Also run it again when the instrument refuses.

        Returns
        -------
        object
            What `exchange` returned.

        Raises
        ------
        LinkError, ProtocolError
            The last failure, when the retries are used up. The link is out of step then.
        DeviceError
            As `exchange` raised it.
        """
        allowed = self.retries if retries is None else retries
        with self._lock:
            attempt = 0
            while True:
                try:
                    self._get_in_step()
                    self.counters.exchanges += 1
                    self.counters.by_command[what] = self.counters.by_command.get(what, 0) + 1
                    return exchange()
                except InstrumentError as err:
                    self._note(what, err)
                    again = retry_refusal or not isinstance(err, DeviceError)
                    if self._closed or not again or attempt >= allowed:
                        raise
                    attempt += 1
                    self.counters.retries += 1
                    log.warning("%s; asking again (%d of %d)", err, attempt, allowed)
                except BaseException:  # interrupted, perhaps between question and answer
                    self._shut()
                    raise

    def send(self, command: str) -> None:
        """Send one command; only inside an exchange.

        Raises
        ------
        ProtocolError
            If something unasked for has come since the last answer.
        LinkError
            If the port takes no bytes.
        """
        port = self._live()
        try:
            if port.in_waiting:
                self._buffer += port.read(port.in_waiting)
            if self._in_step and self._buffer.strip(b"\r\n"):
                raise ProtocolError(f"{self.name}: a line nobody asked for came before {command!r}")
            self._buffer.clear()  # the rest of a line's end, where it is LF and CR
            port.write(command.encode("ascii") + self._end)
        except PORT_ERRORS as err:
            raise LinkError(f"{self.name} at {self.url}: {command!r} not sent: {why(err)}") from err

    def receive(self, timeout_s: float | None = None) -> str:
        """Receive one line; only inside an exchange. Empty lines are passed over.

        Parameters
        ----------
        timeout_s : float or None
            How long it may take, real seconds; None: the link's own.

        Returns
        -------
        str
            The line without its end.

        Raises
        ------
        LinkError
            If no whole line came in time or the port is gone.
        ProtocolError
            If the line is not printable ASCII or never ends.
        """
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        deadline_s = time.monotonic() + limit_s
        while True:
            raw = self._read_line(deadline_s)
            if raw is None:
                raise self._silence("", limit_s)
            line = raw.rstrip(b"\r").lstrip(b"\r")
            if not line:
                continue
            if any(byte < 0x20 or byte > 0x7E for byte in line):
                raise ProtocolError(f"{self.name}: garbled line {line[:60]!r}, expected ASCII")
            return line.decode("ascii")

    # ---- getting into step

    def _get_in_step(self) -> None:
        """Open the port when it is closed, and find the answer to the fence."""
        if self._closed:
            raise LinkError(f"{self.name} at {self.url}: the link was closed")
        if self._port is None:
            self._port = self._reopened()
        if self._in_step:
            return
        self._drain()
        command, pattern = self._fences[self._fence]
        if self._failed_fences and self._clear:
            self._write_raw(self._clear + self._end)  # one that does not know it reads a line of it
        self.send(command)
        try:
            deadline_s = time.monotonic() + self.timeout_s
            while not pattern.fullmatch(line := self._receive_any(deadline_s, command)):
                log.info("%s: threw away a stale line %.60r", self.name, line)
        except LinkError:
            self._failed_fences += 1
            self._fence = (self._fence + 1) % len(self._fences)
            raise
        self._drain()  # an older answer to the fence may have been the first
        self._failed_fences = 0
        self._in_step = True
        if self._resynced is not None:
            self._resynced()

    def _receive_any(self, deadline_s: float, command: str) -> str:
        """Receive a line of whatever bytes."""
        raw = self._read_line(deadline_s)
        if raw is None:
            raise self._silence(f" to {command!r}", self.timeout_s)
        return raw.strip(b"\r").decode("ascii", "replace")

    def _silence(self, question: str, limit_s: float) -> LinkError:
        """Count a time-out and return what to say of it."""
        self.counters.timeouts += 1
        got = f", only {bytes(self._buffer[:40])!r} without a line feed" if self._buffer else ""
        return LinkError(
            f"{self.name} at {self.url}: no answer{question} within {limit_s:g} s{got}"
        )

    def _read_line(self, deadline_s: float) -> bytes | None:
        """Return bytes up to the next LF, which is dropped; None when the deadline passed."""
        port = self._live()
        while b"\n" not in self._buffer:
            if len(self._buffer) > LINE_LIMIT:
                raise ProtocolError(f"{self.name}: {len(self._buffer)} bytes without a line end")
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return None
            self._buffer += self._read_some(port, min(left_s, STEP_S))
        line, _, rest = bytes(self._buffer).partition(b"\n")
        self._buffer[:] = rest
        return line

    def _read_some(self, port: AnyPort, wait_s: float) -> bytes:
        """Wait for a byte at most `wait_s` and return all that are there."""
        try:
            if port.timeout != wait_s:  # setting it sets up the whole port
                port.timeout = wait_s
            first = port.read(1)
            return first + (port.read(port.in_waiting) if first and port.in_waiting else b"")
        except PORT_ERRORS as err:
            raise LinkError(f"{self.name} at {self.url}: the port is gone: {why(err)}") from err

    def _drain(self) -> None:
        """Throw away what comes until the line is quiet."""
        port = self._live()
        end_s = time.monotonic() + max(self.timeout_s, 2 * QUIET_S)
        dropped = len(self._buffer)
        self._buffer.clear()
        while time.monotonic() < end_s and (some := self._read_some(port, QUIET_S)):
            dropped += len(some)
        if dropped:
            log.info("%s: threw away %d stale bytes", self.name, dropped)

    def _write_raw(self, data: bytes) -> None:
        try:
            self._live().write(data)
        except PORT_ERRORS as err:
            raise LinkError(f"{self.name} at {self.url}: nothing sent: {why(err)}") from err

    # ---- the port

    def _live(self) -> AnyPort:
        if self._port is None:
            raise LinkError(f"{self.name} at {self.url}: the port is not open")
        return self._port

    def _opened(self) -> AnyPort:
        """Open the port."""
        try:
            return open_port(self._address, self._baud, self._flow, max(self.timeout_s, 1.0))
        except PORT_ERRORS as err:
            raise LinkError(f"{self.name} at {self.url}: cannot be opened: {why(err)}") from err

    def _reopened(self) -> AnyPort:
        """Open the port again, giving an adapter that is being plugged in the time-out to come."""
        deadline_s = time.monotonic() + (self.timeout_s if self._opened_before else 0.0)
        while True:
            try:
                port = self._opened()
            except LinkError:
                if time.monotonic() >= deadline_s:
                    raise
                time.sleep(QUIET_S)
                continue
            if self._opened_before:
                self.counters.reconnects += 1
            self._opened_before = True
            return port

    def _note(self, what: str, err: InstrumentError) -> None:
        """Count a failure, and drop the link unless it was the instrument that refused."""
        self.counters.last_fault = f"{what}: {err}"
        if isinstance(err, ProtocolError):
            self.counters.bad_replies += 1
        if not isinstance(err, DeviceError):
            self._shut()

    def _shut(self) -> None:
        """Close the port; the link is out of step from now on."""
        self._in_step = False
        self._buffer.clear()
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(*PORT_ERRORS):
                port.close()
