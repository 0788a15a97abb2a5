"""Notes that a running test leaves for its link: kept in memory, taken by another thread."""

import logging
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta

from thermo.station.outcome import Event, Progress
from thermo.store.database import utc_now
from thermo.store.operation.alarm_kinds import Kind
from thermo.store.operation.controllers import ControllerBeat
from thermo.store.records import ReadingRow

LATE_SHARE = 0.1  # of the sampling period: a scan that begins later is late
KEPT_EVENTS = 200  # a command's effect is among the newest

# events that are alarms, too; the end of a test has its own
ALARMS_OF_EVENTS: Mapping[str, Kind] = {
    "alarm": "sensor",
    "foreign change": "foreign change",
    "take-over": "foreign change",
    "missed": "late",
    "skipped": "late",
    "guardian": "guardian",
    "resumed": "resumed",
    "position": "sensor",
}
Alarms = dict[Kind, tuple[str, int]]  # the first text of a kind, and how often


class TestNotes:
    """Notes of a test for its observers, kept in memory; the test never waits for a reader.

    Parameters
    ----------
    period_s : float
        Between two scans, s on the clock.
    """

    __test__ = False

    def __init__(self, period_s: float) -> None:
        self._late_s = LATE_SHARE * period_s
        self._lock = threading.Lock()  # held for a moment only
        self._alarms: Alarms = {}
        self._events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self._event_count = 0
        self._progress: Progress | None = None
        self._position_deg: float | None = None
        self._lateness_s: float | None = None
        self._max_lateness_s: float | None = None
        self._last_fault = ""
        self._warnings: deque[tuple[str, str]] = deque(maxlen=KEPT_EVENTS)

    # ---- in the test's thread

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Note position and lateness."""
        late = [row.lateness_s for row in rows if row.lateness_s is not None]
        with self._lock:
            self._position_deg = rows[0].position_deg if rows else self._position_deg
            if not late:
                return
            self._lateness_s = max(late)
            self._max_lateness_s = max(self._lateness_s, self._max_lateness_s or 0.0)
            if self._lateness_s > self._late_s:
                text = f"the scan began {self._lateness_s:.2f} s late"
                self._add("late", f"run {run} slot {rows[0].slot}: {text}")

    def on_progress(self, progress: Progress) -> None:
        """Note how far the test is."""
        with self._lock:
            self._progress = progress

    def on_event(self, event: Event) -> None:
        """Note what happened."""
        with self._lock:
            self._events.append(event)
            self._event_count += 1
            if event.kind == "fault":
                self._last_fault = event.text
            if (kind := ALARMS_OF_EVENTS.get(event.kind)) is not None:
                self._add(kind, event.text)

    # ---- in any thread

    @property
    def event_count(self) -> int:
        """Number of events so far."""
        with self._lock:
            return self._event_count

    @property
    def phase(self) -> str:
        """The phase shown last; empty before the first."""
        with self._lock:
            return self._progress.phase if self._progress else ""

    def events_since(self, count: int) -> list[Event]:
        """Return the events after the first `count`, as far as they are kept."""
        with self._lock:
            new = self._event_count - count
            return list(self._events)[-new:] if new else []

    def add_alarm(self, kind: Kind, text: str, times: int = 1) -> None:
        """Add an alarm, or count one that is there."""
        with self._lock:
            self._add(kind, text, times)

    def take_alarms(self) -> Alarms:
        """Take the alarms there are; what cannot be told is given back by `add_alarm`."""
        with self._lock:
            found, self._alarms = self._alarms, {}
        return found

    def add_warning(self, text: str) -> None:
        """Add a warning of the program; never waits for the lock, for it may come from within."""
        self._warnings.append((utc_now(), text))

    def take_warnings(self) -> list[tuple[str, str]]:
        """Take the warnings there are, each with its moment."""
        return [self._warnings.popleft() for _ in range(len(self._warnings))]

    def fill(self, beat: ControllerBeat, *, ending: bool) -> ControllerBeat:
        """Return a heartbeat with what is known of the test now."""
        with self._lock:
            beat = replace(
                beat,
                state="ended" if ending else "running",
                position_deg=self._position_deg,
                lateness_s=self._lateness_s,
                max_lateness_s=self._max_lateness_s,
                last_fault=self._last_fault,
            )
            shown = self._progress
        if shown is None:
            return beat
        return replace(
            beat,
            phase="clean-up" if ending else shown.phase,
            run=shown.run,
            runs=shown.runs,
            slot=shown.slot,
            slots=shown.slots,
            segment=shown.segment,
            time_s=shown.time_s,
            left_s=0.0 if ending else shown.left_s,
            end_utc=None if ending else _end_utc(shown.left_s, beat.speed),
            commanded_c=shown.commanded_c,
            chamber_c=shown.chamber_c,
        )

    def _add(self, kind: Kind, text: str, times: int = 1) -> None:
        first, before = self._alarms.get(kind, (text, 0))
        self._alarms[kind] = (first, before + times)


class NotedWarnings(logging.Handler):
    """Keeps the program's warnings among a test's notes.

    Parameters
    ----------
    notes : TestNotes
    """

    def __init__(self, notes: TestNotes) -> None:
        super().__init__(logging.WARNING)
        self._notes = notes

    def emit(self, record: logging.LogRecord) -> None:
        """Take one record; of an exception its last line."""
        text = " ".join(record.getMessage().split())
        if record.exc_info and record.exc_info[1] is not None:
            err = record.exc_info[1]
            text += f": {type(err).__name__}: {err}"
        self._notes.add_warning(f"{record.name}: {text}")


def _end_utc(left_s: float, speed: float | None) -> str | None:
    if speed is None:
        return None
    return (datetime.now(UTC) + timedelta(seconds=left_s / speed)).isoformat(timespec="seconds")
