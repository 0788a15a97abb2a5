"""Journal of a test: each entry goes first into the store, then to the observers."""

import logging
import os
from collections.abc import Sequence
from pathlib import Path

from drivers.clock import Clock
from thermo.station.outcome import Event, Observers, Progress
from thermo.store.records import ReadingRow, ScheduleMark
from thermo.store.store import Store

log = logging.getLogger(__name__)


def clock_identity(clock: Clock) -> str:
    """Return the name of a clock's time base: clocks with one name agree in all processes."""
    speed = getattr(clock, "speed", None)
    if speed is None:  # it lives in this object and nowhere else
        return f"{type(clock).__name__} {os.getpid()}.{id(clock)}"
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        boot = f"process {os.getpid()}"
    return f"monotonic × {speed:g} since {boot}"


class Journal:
    """Writes one test's readings and events."""

    def __init__(self, store: Store, test_id: str, observers: Observers, clock: Clock) -> None:
        self.store = store
        self.test_id = test_id
        self.run = 0
        self.start_s = clock.now_s()
        self.readings = self.flagged = self.skipped = 0
        self.complaints: list[str] = []  # reasons not to trust the test
        self._observers = observers
        self._clock = clock

    def rows(self, rows: Sequence[ReadingRow]) -> None:
        """Store one scan durably, then show it."""
        self.store.append(self.test_id, self.run, rows)
        self.readings += len(rows)
        self.flagged += sum(1 for row in rows if row.flag)
        self._observers.tell(lambda observer: observer.on_reading(self.run, rows))

    def event(self, kind: str, text: str) -> None:
        """Store an event, then show it."""
        time_s = self._clock.now_s() - self.start_s
        log.info("%s: %s", kind, text)
        self.store.log_event(self.test_id, self.run or None, time_s, kind, text)
        event = Event(run=self.run, time_s=time_s, kind=kind, text=text)
        self._observers.tell(lambda observer: observer.on_event(event))

    def complain(self, text: str) -> None:
        """Record a complaint: a reason not to trust a test that runs to its end."""
        if text not in self.complaints:
            self.complaints.append(text)

    def progress(self, progress: Progress) -> None:
        """Show the progress; only the loss of a display is stored."""
        self._observers.tell(lambda observer: observer.on_progress(progress))
        for reason in self._observers.newly_lost():
            self.event("display lost", f"{reason}; the test continues without it")

    def schedule(self, *, shift_s: float, segment: int, attempt: int) -> None:
        """Store the state of the schedule for a resumption."""
        mark = ScheduleMark(
            start_clock_s=self.start_s,
            shift_s=shift_s,
            segment=segment,
            attempt=attempt,
            clock=clock_identity(self._clock),
        )
        log.info("schedule: %s", mark)
        self.store.mark_schedule(self.test_id, self.run, mark)
