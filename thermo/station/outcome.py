"""Events, operator commands and outcome of a chamber test.

::

    EndedError            the procedure ends now; caught by `run_test`, never seen above it
    ├── LimitTrippedError     a reading or an alarm outside what the sequence allows
    │   ├── TooHotError           the chamber or an accelerometer is hotter than its limit
    │   ├── ChamberAlarmError     the chamber shows an alarm
    │   └── ForeignChangeError    somebody else changed the chamber
    ├── InstrumentLostError   an instrument failed for longer than the sequence allows
    │   └── ThermistorLostError   an accelerometer's temperature is not known any more
    └── TestInterruptedError  the operator, a signal
    InterferedError       the wait for the operator, after a foreign change, is over
    ChamberOccupiedError  the test cannot begin: somebody else uses the chamber
"""

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from drivers.devices import SafeResult
from errormodel.errors import WorkbenchError
from thermo.store.operation.alarm_kinds import Kind
from thermo.store.records import ReadingRow

log = logging.getLogger(__name__)

Phase = Literal["approach", "soak", "run", "pause", "resoak", "rest", "clean-up"]
Status = Literal["finished", "interrupted", "failed"]


class EndedError(Exception):
    """The procedure ends here; the message is the one-line reason."""

    status: Status = "failed"
    kind: Kind = "program error"  # of the alarm that tells of it


class LimitTrippedError(EndedError):
    """A reading or an alarm is outside what the sequence allows."""

    kind: Kind = "limits"


class TooHotError(LimitTrippedError):
    """The chamber or an accelerometer is hotter than its limit."""

    kind: Kind = "over-temperature"


class ChamberAlarmError(LimitTrippedError):
    """The chamber shows an alarm."""

    kind: Kind = "chamber alarm"


class ForeignChangeError(LimitTrippedError):
    """Somebody else changed the chamber, and the rule is to end."""

    kind: Kind = "foreign change"


class InstrumentLostError(EndedError):
    """An instrument failed for longer than the sequence allows."""

    kind: Kind = "link lost"


class ThermistorLostError(InstrumentLostError):
    """The temperature of an accelerometer is not known any more, so its limit does not protect."""

    kind: Kind = "sensor"


class TestInterruptedError(EndedError):
    """The operator or a signal ended the test; it can be resumed."""

    __test__ = False
    status: Status = "interrupted"

    def __init__(self, reason: str, kind: Kind = "aborted") -> None:
        self.kind = kind
        super().__init__(reason)


class InterferedError(Exception):
    """Somebody changed the chamber, the test paused, and must now bring it back.

    Parameters
    ----------
    began_s : float
        Start of the pause, s on its clock.
    """

    def __init__(self, began_s: float) -> None:
        self.began_s = began_s
        super().__init__("somebody else changed the chamber")


class ChamberOccupiedError(WorkbenchError):
    """The chamber is not free to be taken over; nothing was commanded or stored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """An event that is stored with the run; `run` is 0 outside of any run."""

    run: int
    time_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Progress of the test; `left_s` is the expected rest of the whole test."""

    test_id: str
    run: int
    runs: int
    phase: Phase
    slot: int
    slots: int
    segment: int
    time_s: float
    left_s: float
    commanded_c: float
    chamber_c: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Decision on a test after a run; `lines` are stored as events of the kind `kind`.

    `reason` is the reason of the end of the test, if it ends here.
    """

    stop: bool = False
    reason: str = "all runs done"
    kind: str = "run-in"
    lines: tuple[str, ...] = ()


GO_ON = Decision()


class Observer(Protocol):
    """Observer of a test; its errors never stop the test.

    It is called in the thread of the test and must return at once. Wrap an observer that may be
    slow or wait in a `thermo.station.observers.detached.DetachedObserver`.
    """

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """See one scan, after it has been stored."""
        ...

    def on_progress(self, progress: Progress) -> None:
        """Receive the progress of the test."""
        ...

    def on_event(self, event: Event) -> None:
        """See an event, after it has been stored."""
        ...


@runtime_checkable
class CanBeLost(Protocol):
    """An observer that displays a test and reports if it no longer can."""

    @property
    def lost(self) -> str:
        """Reason why nothing is shown any more; empty as long as something is."""
        ...


class Observers:
    """Calls every observer; one that fails is logged and not called again."""

    def __init__(self, observers: Sequence[Observer]) -> None:
        self._observers = tuple(observers)
        self._failed: set[int] = set()
        self._displays = [o for o in self._observers if isinstance(o, CanBeLost)]

    def newly_lost(self) -> list[str]:
        """Return the reasons of displays lost since the last call."""
        lost = [display for display in self._displays if display.lost]
        self._displays = [display for display in self._displays if display not in lost]
        return [display.lost for display in lost]

    def tell(self, call: Callable[[Observer], None]) -> None:
        """Make one call on each observer."""
        for observer in self._observers:
            try:
                call(observer)
            except Exception:
                if id(observer) not in self._failed:
                    self._failed.add(id(observer))
                    log.warning("an observer failed; the test continues", exc_info=True)


class RunControl:
    """The operator's control of a running test; every method may be called from any thread.

    `abort` may be called from a signal handler: it only sets a flag that the procedure checks
    between two steps, so no operation is interrupted.
    """

    def __init__(self) -> None:
        self._reason: str | None = None
        self._kind: Kind = "aborted"
        self._paused = threading.Event()
        self._why = ""

    def pause(self, why: str = "") -> None:
        """Hold the schedule and the temperature until `resume`; `why` is told in the event."""
        self._why = why
        self._paused.set()

    def resume(self) -> None:
        """Resume after a pause, by the sequence's rule for gaps."""
        self._paused.clear()

    def abort(self, reason: str = "aborted by the operator", kind: Kind = "aborted") -> None:
        """End the test safely; the first reason given is the one that is kept.

        Parameters
        ----------
        reason : str
        kind : Kind
            Of the alarm that tells of it: "aborted" by a person, "interrupted" by the system.
        """
        if self._reason is None:
            self._kind = kind
            self._reason = reason

    @property
    def paused(self) -> bool:
        """True while the test must pause."""
        return self._paused.is_set()

    @property
    def why_paused(self) -> str:
        """Person who asked for the pause, and the reason; empty if none was given."""
        return self._why

    def check(self) -> None:
        """Raise `TestInterruptedError` when the test is to end."""
        if self._reason is not None:
            raise TestInterruptedError(self._reason, self._kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class TestOutcome:
    """Outcome of a test.

    Attributes
    ----------
    test_id : str
        Empty when it ended before it could be stored.
    status : str
        "finished", "interrupted" or "failed"; the latter two can be resumed.
    reason : str
        One line.
    safe : SafeResult
        Commands to the chamber at the end and the values read back; none if this session never
        commanded it (`safe.commanded` is False).
    head_stopped : bool
        True if the head does not move; it was commanded to stop only if this session had moved it.
    readings, skipped, flagged : int
        Stored readings of this session, slots without any, and readings stored with a flag.
    complaints : tuple of str
        Why a test that ran to its end is not to be trusted as it is.
    kind : Kind
        Of the alarm that tells of the end.
    store_note : str
        One line on the place of readings that are not yet in the store; empty if all are stored.
    """

    __test__ = False  # not a test case, whatever pytest thinks of the name

    test_id: str
    status: Status
    reason: str
    safe: SafeResult
    head_stopped: bool
    readings: int = 0
    skipped: int = 0
    flagged: int = 0
    complaints: tuple[str, ...] = ()
    kind: Kind = "program error"
    store_note: str = ""

    @property
    def clean(self) -> bool:
        """True when the test ran to its end without complaint and all was verified to be safe."""
        done = self.status == "finished" and not self.complaints
        return done and self.safe.verified and self.head_stopped
