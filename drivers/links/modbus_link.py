"""Link to a Modbus controller that recovers from silence and wrong bytes.

After anything but a clean answer the port is closed and opened anew before the next question, so
that a late reply is never taken for the next answer. An RTU reply does not say what it answers;
there a new port is first brought into step: the line must fall quiet, and then answer a question of
unusual length, which a slave that answers in order does only when it has done with the old ones.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

from drivers.devices import LinkCounters
from drivers.errors import (
    DeviceError,
    FencedError,
    InstrumentError,
    LinkError,
    ProtocolError,
    RecognitionError,
)
from drivers.links.barrier import Barrier
from drivers.links.modbus import (
    BadReplyError,
    Port,
    PortError,
    Question,
    SilenceError,
    parse_modbus_url,
)
from drivers.station import LinkConfig

log = logging.getLogger(__name__)

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
_NO_SUCH_FUNCTION, _STILL_WORKING, _BUSY = 1, 5, 6
_ABSENT = (1, 2)
_READING = (3, 4)


class RefusalError(DeviceError):
    """The controller answered with a Modbus exception."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code

    @property
    def absent(self) -> bool:
        """True when the controller says that it has no such register."""
        return self.code in _ABSENT


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
    before_write : callable
        Called right before every question that writes, repetitions included; what it raises
        (`RecognitionError`, `FencedError`) keeps it from being sent. There is no other way out.

    Raises
    ------
    ValueError
        If the URL cannot be understood.
    """

    def __init__(
        self,
        config: LinkConfig,
        *,
        name: str,
        barrier: Barrier,
        before_write: Callable[[], None],
    ) -> None:
        self.name = name
        self.url = config.url
        self.counters = LinkCounters()
        self.writes = 0  # questions that write and were let through
        self._config = config
        self._barrier = barrier
        self._before_write = before_write
        self._endpoint = parse_modbus_url(config.url)
        self._lock = threading.RLock()
        self._port: Port | None = None
        self._closed = False
        self._was_open = False
        self._reply_pending = False  # a reply may still come to a question given up
        self._transaction = 0  # goes on over new ports, so that an old reply is known by its number
        self._barriers = 0
        self._sent = False
        self._single_write = 6

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
        question = Question(function, address, count, (), f"read {what}")
        return self._ask(question, repeatable=True)

    def write(
        self,
        address: int,
        words: Sequence[int],
        *,
        what: str = "registers",
        repeatable: bool = True,
    ) -> None:
        """Write registers: one with function 6, several with function 16.

        A controller that does not know function 6 is written to with 16 from then on.

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
        InstrumentError
            From `before_write`; nothing was sent.
        """
        function = self._single_write if len(words) == 1 else 16
        question = Question(function, address, len(words), tuple(words), f"write {what}")
        try:
            self._ask(question, repeatable=repeatable)
        except RefusalError as refusal:
            if refusal.code != _NO_SUCH_FUNCTION or function == 16:
                raise
            log.warning("%s; using function 16 from now on", refusal)
            self._single_write = 16
            self._ask(replace(question, function=16), repeatable=repeatable)

    def close(self) -> None:
        """Release the port for good; harmless when done twice."""
        with self._lock:
            self._closed = True
            self._drop()

    # ---- one question and what may become of it

    def _ask(self, question: Question, *, repeatable: bool) -> tuple[int, ...]:
        with self._lock:
            attempt = 0
            while True:
                self._sent = False
                try:
                    return self._converse(self._ready_port(), question)
                except InstrumentError as failure:
                    attempt += 1
                    self.counters.last_fault = str(failure)
                    again = self._may_repeat(failure, repeatable=repeatable)
                    if not again or attempt > self._config.retries:
                        raise
                    self.counters.retries += 1
                    log.warning("%s; asking again (%d/%d)", failure, attempt, self._config.retries)

    def _may_repeat(self, failure: InstrumentError, *, repeatable: bool) -> bool:
        if self._closed or isinstance(failure, (FencedError, RecognitionError)):
            return False
        if isinstance(failure, RefusalError):
            # busy: not done, so it may be asked again whatever it was
            return failure.code == _BUSY or (repeatable and failure.code == _STILL_WORKING)
        return repeatable or not self._sent

    def _converse(self, port: Port, question: Question) -> tuple[int, ...]:
        """Ask on a port that is in step, and turn what can go wrong into the drivers' errors."""
        if question.function not in _READING:
            self._before_write()
            self.writes += 1
        where = f"{self.name}: {question.what} at {question.address}"
        self.counters.exchanges += 1
        by_command = self.counters.by_command
        by_command[question.what] = by_command.get(question.what, 0) + 1
        clean = False
        try:
            answer = port.ask(question)
            clean = True
        except SilenceError as error:
            self.counters.timeouts += 1
            raise LinkError(f"{where}: {error}, link dropped, {self.url}") from None
        except BadReplyError as error:
            self.counters.bad_replies += 1
            raise ProtocolError(f"{where}: {error}, link dropped, {self.url}") from None
        except PortError as error:
            raise LinkError(f"{where}: {error}, {self.url}") from None
        finally:
            self._transaction = port.transaction
            self._sent = port.sent
            if not clean:  # also when interrupted: a reply may still be on its way
                self._drop()
        if answer.exception is not None:
            words = EXCEPTIONS.get(answer.exception, "unknown exception")
            raise RefusalError(
                f"{where}: refused with exception {answer.exception}, {words}", answer.exception
            )
        return answer.words

    # ---- the port itself

    def _ready_port(self) -> Port:
        """Return an open port that is in step with the controller."""
        if self._closed:
            raise LinkError(f"{self.name}: the link to {self.url} was closed")
        if self._port is not None and self._port.is_stale():
            log.warning(
                "%s: idle link closed, or holding bytes, made anew, %s", self.name, self.url
            )
            self._drop()
        if self._port is not None:
            return self._port
        port = self._open()
        if self._endpoint.transport != "tcp":
            try:
                port = self._bring_into_step(port)
            finally:
                self._sent = False  # what went out so far was not the question itself
        self._reply_pending = False
        return port

    def _open(self) -> Port:
        try:
            self._port = Port(self._endpoint, self._config, self._transaction)
        except PortError as error:
            raise LinkError(f"{self.name}: cannot open {self.url}: {error}") from None
        self.counters.reconnects += self._was_open
        self._was_open = True
        return self._port

    def _bring_into_step(self, port: Port) -> Port:
        """Let an RTU line fall quiet and have the barrier answered; return the port that did."""
        if self._reply_pending:
            self._drain(port)
        for _ in range(BARRIER_TRIES):
            # the two lengths take turns, so that a late answer to one barrier is not the next's
            count = self._barrier.counts[self._barriers % 2]
            self._barriers += 1
            barrier = Question(3, self._barrier.address, count, (), "read barrier")
            try:
                self._converse(port, barrier)
            except RefusalError:  # an answer too
                return port
            except ProtocolError as failure:
                self.counters.last_fault = str(failure)
                self.counters.retries += 1
                log.warning("%s; waiting for the line to fall quiet", failure)
                port = self._open()
                self._drain(port)
            else:
                return port
        self._drop()
        raise ProtocolError(f"{self.name}: replies do not fit the questions asked, {self.url}")

    def _drain(self, port: Port) -> None:
        """Wait until nothing has come for one time limit."""
        drained = False
        try:
            port.drain(self._config.timeout_s)
            drained = True
        except BadReplyError as error:
            self.counters.bad_replies += 1
            raise ProtocolError(f"{self.name}: {error}, {self.url}") from None
        except PortError as error:
            raise LinkError(f"{self.name}: {error}, {self.url}") from None
        finally:
            if not drained:
                self._drop()

    def _drop(self) -> None:
        """Close the port; whatever is still on its way will not be listened to."""
        port, self._port = self._port, None
        self._reply_pending = self._was_open
        if port is not None:
            port.close()
