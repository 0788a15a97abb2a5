"""Keysight (Agilent, HP) 34970A scanning multimeter over its serial port, in SCPI."""

import logging
import math
from collections.abc import Callable, Sequence

from drivers.clock import Clock, RealClock
from drivers.devices import ChannelReading, ScanChannel
from drivers.digitisers.keysight_34970a_scpi import (
    FUNCTIONS,
    HIGHEST,
    IDENTITY,
    MODEL,
    OPTIONAL,
    OVERLOAD,
    OVERRANGE,
    ScanItem,
    configuration,
    parse_identity,
    parse_scan,
    parse_scpi_error,
    range_for,
)
from drivers.errors import DeviceError, LinkError, ProtocolError
from drivers.links.serial_instrument import SerialInstrument
from drivers.links.serial_link import SerialLink
from drivers.station import DigitiserConfig

log = logging.getLogger(__name__)

LINE_PERIOD_S = 0.020  # of 50 Hz mains
AUTOZERO = 2.0  # each reading is followed by one of the shorted input
SETTLE_S = 0.06  # relay and settling per channel; high resistance ranges settle longest
REPLY_BYTES = 40  # of one reading with time and channel
ERROR_QUEUE = 20


class ScanningMultimeter(SerialInstrument):
    """A 34970A; satisfies `drivers.devices.Digitiser`.

    Parameters
    ----------
    config : DigitiserConfig
        Where it is and how long to wait.
    name : str
        For messages.
    clock : Clock, optional
        The clock the caller stamps readings with. When a scan had to be asked for again, what
        that took on this clock is in each `offset_s`. Real time if not given.

    Raises
    ------
    LinkError
        If the port cannot be opened.
    """

    def __init__(
        self, config: DigitiserConfig, *, name: str = "digitiser", clock: Clock | None = None
    ) -> None:
        self._config = config
        self._clock: Clock = RealClock() if clock is None else clock
        self._channels: tuple[ScanChannel, ...] = ()
        self._nplc = config.nplc
        self._as_maker = False  # becomes True with the first reading so written, and stays
        self._refusals: list[str] = []
        link = SerialLink(
            config.url,
            name=name,
            baud=config.baud,
            timeout_s=config.timeout_s,
            retries=config.retries,
            fences=[("*IDN?", IDENTITY)],
            flow="xon_xoff",
            clear=b"\x03",
            resynced=self._empty_error_queue,
        )
        super().__init__(link)

    def identify(self) -> str:
        """Ask for the identity and check the model.

        Returns
        -------
        str
            Maker, model, serial number and firmware as the instrument writes them.

        Raises
        ------
        DeviceError
            If it is another model.
        """
        identity = self._ask("*IDN?", parse_identity)
        model = identity.split(",")[1].strip()
        if model.upper() != MODEL:
            raise DeviceError(f"{self._name}: is a {model}, expected a {MODEL}")
        return identity

    def read_settings(self) -> dict[str, str | float]:
        """Read identity, scan list and integration times.

        Returns
        -------
        dict
            What the instrument answered; "no answer" where it refused a question.
        """
        settings: dict[str, str | float] = {"identity": self._ask("*IDN?", parse_identity)}
        settings["nplc"] = self._nplc
        questions = {"scan_list": "ROUT:SCAN?"}
        for quantity, number in sorted({c.quantity: c.number for c in self._channels}.items()):
            questions[f"{quantity}_nplc"] = f"SENS:{FUNCTIONS[quantity]}:NPLC? (@{number})"
        for key, question in questions.items():
            try:
                settings[key] = self._ask(question, str.strip, retries=0)
            except (DeviceError, LinkError) as err:
                log.warning("%s: %s", self._name, err)
                settings[key] = "no answer"
        return settings

    def configure(self, channels: Sequence[ScanChannel], *, nplc: float = 1.0) -> None:
        """Set what each channel measures and the scan list, checking after every command.

        Parameters
        ----------
        channels : sequence of ScanChannel
            At least one, each number once.
        nplc : float
            Integration time in mains periods: 0.02, 0.2, 1, 2, 10, 20, 100 or 200.

        Raises
        ------
        LimitError
            If the instrument cannot measure that; nothing was sent.
        DeviceError
            If the instrument refuses.
        """
        commands = configuration(channels, nplc)
        self._channels = ()
        for command in commands:
            self._command(command, optional=command in OPTIONAL)
        self._channels = tuple(channels)
        self._nplc = nplc

    def scan(self) -> tuple[ChannelReading, ...]:
        """Take one scan.

        Returns
        -------
        tuple of ChannelReading
            In the order configured. `offset_s` counts from this call: the instrument's own time
            since the scan began, and what it took until the scan that was answered began.

        Raises
        ------
        DeviceError
            If the instrument refuses, or was not configured.
        LinkError, ProtocolError
            If there is no usable answer.
        """
        if not self._channels:
            raise DeviceError(f"{self._name}: no scan list, configure it first")
        called_s = self._clock.now_s()
        self._refusals.clear()

        def exchange() -> tuple[float, tuple[ScanItem, ...]]:
            began_s = self._clock.now_s()
            self._link.send("READ?")
            items = self._checked(self._link.receive(self._scan_timeout_s()))
            self._check_errors("READ?")
            return began_s - called_s, items

        try:
            delay_s, items = self._link.transact("READ?", exchange, retry_refusal=True)
        except LinkError as err:
            if self._refusals:
                raise DeviceError(
                    f"{self._name}: READ? refused: {'; '.join(self._refusals)}"
                ) from err
            raise
        by_channel = {item.channel: item for item in items}
        return tuple(self._reading(c, by_channel[c.number], delay_s) for c in self._channels)

    # ---- parts of a scan

    def _scan_timeout_s(self) -> float:
        """Return how long a scan may take, real seconds."""
        each_s = AUTOZERO * self._nplc * LINE_PERIOD_S + SETTLE_S
        each_s += 10.0 * REPLY_BYTES / self._config.baud
        return self._config.timeout_s + len(self._channels) * each_s

    def _checked(self, reply: str) -> tuple[ScanItem, ...]:
        """Parse a scan and check that it is one of these channels."""
        items = self._parsed(reply, parse_scan)
        got = sorted(item.channel for item in items)
        want = sorted(c.number for c in self._channels)
        if got != want:
            raise ProtocolError(f"{self._name}: a scan of channels {got}, expected {want}")
        # an overload is no number, and some write it shorter
        as_maker = [item.as_maker for item in items if abs(item.value) < OVERLOAD]
        if not all(as_maker) and (self._as_maker or any(as_maker)):
            raise ProtocolError(f"{self._name}: readings of unequal length: {reply[:120]!r}")
        self._as_maker = self._as_maker or any(as_maker)
        return items

    def _reading(self, channel: ScanChannel, item: ScanItem, delay_s: float) -> ChannelReading:
        """Judge one reading."""
        ok = abs(item.value) <= min(OVERRANGE * range_for(channel), HIGHEST[channel.quantity])
        if not ok and abs(item.value) < OVERLOAD:
            log.warning(
                "%s: channel %d reads %g, outside its range, taken for an overload",
                self._name,
                channel.number,
                item.value,
            )
        return ChannelReading(
            channel=channel.number,
            value=item.value if ok else math.nan,
            offset_s=delay_s + item.offset_s,
            ok=ok,
        )

    # ---- exchanges

    def _ask(
        self, question: str, parse: Callable[[str], str], *, retries: int | None = None
    ) -> str:
        """Ask, parse, and look into the error queue."""
        self._refusals.clear()

        def exchange() -> str:
            self._link.send(question)
            answer = self._parsed(self._link.receive(), parse)
            self._check_errors(question)
            return answer

        return self._link.transact(question, exchange, retries=retries, retry_refusal=True)

    def _command(self, command: str, *, optional: bool = False) -> None:
        """Send a command and see that the error queue stays empty.

        All commands sent through here set something to a value: sending one twice is harmless.
        """

        def exchange() -> None:
            self._link.send(command)
            self._check_errors(command)

        try:
            self._link.transact(command, exchange)
        except DeviceError as err:
            if not optional:
                raise
            log.info("%s", err)

    def _check_errors(self, what: str) -> None:
        """Read the error queue; the question also shows that the link is still in step."""
        errors = self._read_error_queue()
        if errors:
            raise DeviceError(f"{self._name}: {what!r} refused: {'; '.join(errors)}")

    def _read_error_queue(self) -> list[str]:
        errors = self._read_errors("SYST:ERR?", parse_scpi_error, ERROR_QUEUE)
        return [f"{code:+d} {text}" for code, text in errors]

    def _empty_error_queue(self) -> None:
        """After getting into step: what is in the queue belongs to the past."""
        errors = self._read_error_queue()
        if errors:
            log.warning("%s: in the error queue: %s", self._name, "; ".join(errors))
            self._refusals.extend(errors)
