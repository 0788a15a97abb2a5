"""One instrument on a serial line that answers questions with lines of text.

A reply on a serial line carries no number that says which question it answers. So the link is
always in one of two states. *In step*: nothing is waiting, the next line answers the next
question. *Out of step*, from the first silence or unreadable line on: the port is closed, opened
again, emptied, and the instrument is asked something whose answer nothing else resembles (the
fence), and every line before that answer is thrown away; only then is the next question asked.
A late reply survives closing and opening a port, the fence is what stops it.
"""

import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers.devices import LinkCounters
from drivers.errors import DeviceError, InstrumentError, LinkError, ProtocolError
from drivers.links.serial_line import SerialLine
from drivers.links.serial_port import Flow

log = logging.getLogger(__name__)

T = TypeVar("T")


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
        self._line = SerialLine(url, name=name, baud=baud, flow=flow, timeout_s=timeout_s)
        self._fences = tuple(fences)
        self._fence = 0
        self._failed_fences = 0
        self._end = end
        self._clear = clear
        self._resynced = resynced
        self._in_step = False
        self._closed = False
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
            self._line.open()

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
        unasked = self._line.take_waiting(repr(command))  # a line end: of the last answer
        if self._in_step and unasked.strip(b"\r\n"):
            raise ProtocolError(f"{self.name}: a line nobody asked for came before {command!r}")
        self._line.write(command.encode("ascii") + self._end, repr(command))

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
            raw = self._line.read_line(deadline_s)
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
        if self._line.reopen():
            self.counters.reconnects += 1
        if self._in_step:
            return
        self._line.drain()
        command, pattern = self._fences[self._fence]
        if self._failed_fences and self._clear:
            # one that does not know it reads a line of it
            self._line.write(self._clear + self._end, repr(self._clear))
        self.send(command)
        try:
            deadline_s = time.monotonic() + self.timeout_s
            while not pattern.fullmatch(line := self._receive_any(deadline_s, command)):
                log.info("%s: threw away a stale line %.60r", self.name, line)
        except LinkError:
            self._failed_fences += 1
            self._fence = (self._fence + 1) % len(self._fences)
            raise
        self._line.drain()  # an older answer to the fence may have been the first
        self._failed_fences = 0
        self._in_step = True
        if self._resynced is not None:
            self._resynced()

    def _receive_any(self, deadline_s: float, command: str) -> str:
        """Receive a line of whatever bytes."""
        raw = self._line.read_line(deadline_s)
        if raw is None:
            raise self._silence(f" to {command!r}", self.timeout_s)
        return raw.strip(b"\r").decode("ascii", "replace")

    def _silence(self, question: str, limit_s: float) -> LinkError:
        """Count a time-out and return what to say of it."""
        self.counters.timeouts += 1
        begun = self._line.begun
        got = f", only {begun!r} without a line feed" if begun else ""
        return LinkError(
            f"{self.name} at {self.url}: no answer{question} within {limit_s:g} s{got}"
        )

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
        self._line.close()
