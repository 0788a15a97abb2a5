"""Protocols of a chamber, a digitiser and an indexing head, for everybody above them.

Real instruments and emulated ones are reached through the same drivers; every driver satisfies
one of these protocols and passes the conformance suite in `tests/drivers`. Units: °C, °, s.
All calls raise `drivers.errors.InstrumentError` and nothing else of their own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """A closed interval; set points outside it are refused, never clipped."""

    lo: float
    hi: float

    def __contains__(self, value: float) -> bool:
        return self.lo <= value <= self.hi


# Nothing cooled by liquid nitrogen gets below −196 °C, and what goes beyond 400 °C is a furnace: a
# number outside is no temperature, set point or limit of a chamber, whatever register it came from.
CHAMBER_C = Range(lo=-200.0, hi=400.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SafeResult:
    """Steps of `make_safe` and what reading back showed; `verified` only if every check held.

    `commanded` is False when nothing was written, because the controller was not recognised or
    never commanded; then nothing is verified either.
    """

    verified: bool
    steps: tuple[str, ...]  # one line each, in order: what was written, what was read back
    commanded: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanChannel:
    """One channel of a scan: what to measure there."""

    number: int
    quantity: str  # "voltage" (V) or "resistance" (ohm)
    full_scale: float  # V or ohm: the range to measure in; inf: the instrument's choice each time


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReading:
    """One channel of one scan."""

    channel: int
    value: float  # V or ohm; nan when the instrument reported an overload or an open input
    # since `scan` was called: the instrument's own time stamp, and before it what it took to ask
    # again when the first question went unanswered
    offset_s: float
    ok: bool = True


@dataclass(slots=True)
class LinkCounters:
    """Counters of a link, stored with a test. Nothing is retried without being counted."""

    exchanges: int = 0
    retries: int = 0
    timeouts: int = 0
    reconnects: int = 0
    bad_replies: int = 0
    last_fault: str = ""
    by_command: dict[str, int] = field(default_factory=dict[str, int])


class Device(Protocol):
    """Base of every instrument."""

    @property
    def name(self) -> str:
        """The instrument's name in the station file, for messages."""
        ...

    @property
    def counters(self) -> LinkCounters:
        """Exchanges, retries and faults so far."""
        ...

    def identify(self) -> str:
        """Ask the instrument who it is and check that it is what the station file says."""
        ...

    def read_settings(self) -> Mapping[str, str | float]:
        """Read the settings worth keeping with a run."""
        ...

    def close(self) -> None:
        """Release the port; harmless when done twice. Changes nothing in the instrument."""
        ...


class Chamber(Device, Protocol):
    """A thermal chamber with one temperature loop.

    Nothing is written to it before `identify` has recognised the controller: its unit, its
    scaling and its word order. Until then every command raises `RecognitionError`.
    """

    @property
    def recognition(self) -> Mapping[str, float | str]:
        """Values by which `identify` recognised the controller; empty before.

        Given to `drivers.chambers.open.open_chamber`, it lets another process recognise the same
        controller again, also when its sensor has failed since.
        """
        ...

    def read_occupation(self) -> tuple[str, ...]:
        """Read why the chamber is not free to be taken over; empty when it is.

        Somebody's profile or program runs, the loop is off or in manual, the set point is remote.
        """
        ...

    def read_foreign_changes(self) -> tuple[str, ...]:
        """Read what the controller holds otherwise than this driver last commanded, in words.

        Set point, mode, ramp, profile; empty when all is as commanded, or nothing was commanded.
        """
        ...

    @property
    def limits_c(self) -> Range:
        """Set points outside are refused."""
        ...

    @property
    def rate_limits_c_per_min(self) -> Range:
        """Ramp rates the instrument can express and the station allows."""
        ...

    def read_temp_c(self) -> float:
        """Read the chamber's own temperature; `DeviceError` on a broken sensor."""
        ...

    def read_setpoint_c(self) -> float:
        """Read the set point the loop follows now (during a ramp it moves)."""
        ...

    def hold_temp_c(self, temp_c: float) -> None:
        """Go to `temp_c` as fast as the chamber does, and hold."""
        ...

    def ramp_to_c(self, temp_c: float, rate_c_per_min: float) -> None:
        """Move the set point from where the chamber is to `temp_c` uniformly, and hold there."""
        ...

    def read_alarms(self) -> tuple[str, ...]:
        """Read the faults the chamber reports of itself, in words; empty when there are none."""
        ...

    def make_safe(self, temp_c: float) -> SafeResult:
        """End any ramp or profile, hold `temp_c`, and verify both by reading back.

        Idempotent; tries every step even when one fails. A loop that was found off is left off.
        It never raises an InstrumentError: the failure is in the result. A controller that is
        not recognised gets nothing written, and the result says so.
        """
        ...


class Digitiser(Device, Protocol):
    """A scanning multimeter."""

    def configure(self, channels: Sequence[ScanChannel], *, nplc: float = 1.0) -> None:
        """Set what each channel measures and the scan list."""
        ...

    def scan(self) -> tuple[ChannelReading, ...]:
        """Take one scan of all channels, in the order configured; blocks until done."""
        ...


class IndexingHead(Device, Protocol):
    """One rotary axis."""

    @property
    def limits_deg(self) -> Range:
        """Angles outside are refused."""
        ...

    @property
    def speed_deg_per_s(self) -> float:
        """The speed the axis turns at."""
        ...

    def move_to_deg(self, angle_deg: float) -> None:
        """Start a move; returns while the axis turns."""
        ...

    def is_moving(self) -> bool:
        """Tell whether the axis still turns."""
        ...

    def read_position_deg(self) -> float:
        """Read where the axis is, by its encoder."""
        ...

    def stop(self) -> None:
        """Stop the axis where it is."""
        ...
