"""The port of one instrument: bytes out, lines in.

It knows nothing of questions and answers; `drivers.links.serial_link` does.
"""

import contextlib
import logging
import time

from drivers.errors import LinkError, ProtocolError
from drivers.links.serial_port import PORT_ERRORS, AnyPort, Flow, address, error_text, open_port

log = logging.getLogger(__name__)

LINE_LIMIT = 65536  # no instrument here sends a longer line
QUIET_S = 0.05  # a line on which nothing came for so long is taken to be quiet
STEP_S = 0.25  # longest single wait inside a read, so that a dead port is noticed


class SerialLine:
    """A serial port, or a serial server's TCP port, that is opened and closed as often as need be.

    Parameters
    ----------
    url : str
        ``serial:///dev/ttyUSB0`` or ``socket://host:port``.
    name : str
        The instrument's name, for messages.
    baud : int
        Bit rate, 1/s; without meaning on TCP.
    flow : {"none", "xon_xoff", "rts_cts"}
        Flow control, as the instrument does it.
    timeout_s : float
        How long the port may hold up a command or an opening, real seconds.

    Raises
    ------
    LinkError
        If the URL is of no known kind.
    """

    def __init__(self, url: str, *, name: str, baud: int, flow: Flow, timeout_s: float) -> None:
        self._where = f"{name} at {url}"
        self._name = name
        self._address = address(url, name)
        self._baud = baud
        self._flow: Flow = flow
        self._timeout_s = timeout_s
        self._port: AnyPort | None = None
        self._buffer = bytearray()
        self._opened_before = False

    @property
    def begun(self) -> bytes:
        """The first bytes of a line whose end has not come."""
        return bytes(self._buffer[:40])

    def open(self) -> None:
        """Open the port unless it is open; no byte is sent.

        Raises
        ------
        LinkError
            If it cannot be opened.
        """
        if self._port is None:
            self._port = self._opened()
            self._opened_before = True

    def reopen(self) -> bool:
        """Open the port unless it is open; True: it had been open before.

        An adapter that is being plugged in is given the time-out to come.

        Raises
        ------
        LinkError
            If it cannot be opened.
        """
        if self._port is not None:
            return False
        again = self._opened_before
        deadline_s = time.monotonic() + (self._timeout_s if again else 0.0)
        while True:
            try:
                self.open()
            except LinkError:
                if time.monotonic() >= deadline_s:
                    raise
                time.sleep(QUIET_S)
                continue
            return again

    def close(self) -> None:
        """Close the port and forget what has come; harmless when done twice."""
        self._buffer.clear()
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(*PORT_ERRORS):
                port.close()

    def take_waiting(self, before: str) -> bytes:
        """Take, without waiting, what has come since the last line was read.

        Parameters
        ----------
        before : str
            The command that is to be sent then, for messages.

        Raises
        ------
        LinkError
            If the port is gone.
        """
        port = self._live()
        try:
            if port.in_waiting:
                self._buffer += port.read(port.in_waiting)
        except PORT_ERRORS as err:
            raise LinkError(f"{self._where}: {before} not sent: {error_text(err)}") from err
        taken = bytes(self._buffer)
        self._buffer.clear()
        return taken

    def write(self, data: bytes, what: str) -> None:
        """Send bytes.

        Parameters
        ----------
        data : bytes
        what : str
            The command, for messages.

        Raises
        ------
        LinkError
            If the port takes no bytes.
        """
        port = self._live()
        try:
            port.write(data)
        except PORT_ERRORS as err:
            raise LinkError(f"{self._where}: {what} not sent: {error_text(err)}") from err

    def read_line(self, deadline_s: float) -> bytes | None:
        """Return bytes up to the next LF, which is dropped; None when the deadline passed.

        Parameters
        ----------
        deadline_s : float
            By `time.monotonic`.

        Raises
        ------
        LinkError
            If the port is gone.
        ProtocolError
            If the line never ends.
        """
        port = self._live()
        while b"\n" not in self._buffer:
            if len(self._buffer) > LINE_LIMIT:
                raise ProtocolError(f"{self._name}: {len(self._buffer)} bytes without a line end")
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return None
            self._buffer += self._read_some(port, min(left_s, STEP_S))
        line, _, rest = bytes(self._buffer).partition(b"\n")
        self._buffer[:] = rest
        return line

    def drain(self) -> None:
        """Throw away what comes until the line is quiet.

        Raises
        ------
        LinkError
            If the port is gone.
        """
        port = self._live()
        end_s = time.monotonic() + max(self._timeout_s, 2 * QUIET_S)
        dropped = len(self._buffer)
        self._buffer.clear()
        while time.monotonic() < end_s and (some := self._read_some(port, QUIET_S)):
            dropped += len(some)
        if dropped:
            log.info("%s: threw away %d stale bytes", self._name, dropped)

    def _read_some(self, port: AnyPort, wait_s: float) -> bytes:
        """Wait for a byte at most `wait_s` and return all that are there."""
        try:
            if port.timeout != wait_s:  # setting it sets up the whole port
                port.timeout = wait_s
            first = port.read(1)
            return first + (port.read(port.in_waiting) if first and port.in_waiting else b"")
        except PORT_ERRORS as err:
            raise LinkError(f"{self._where}: the port is gone: {error_text(err)}") from err

    def _live(self) -> AnyPort:
        if self._port is None:
            raise LinkError(f"{self._where}: the port is not open")
        return self._port

    def _opened(self) -> AnyPort:
        try:
            return open_port(self._address, self._baud, self._flow, max(self._timeout_s, 1.0))
        except PORT_ERRORS as err:
            raise LinkError(f"{self._where}: cannot be opened: {error_text(err)}") from err
