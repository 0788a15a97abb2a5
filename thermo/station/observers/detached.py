"""Observers that never delay a test, because a separate thread calls them."""

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from thermo.station.outcome import Event, Observer, Progress
from thermo.store.records import ReadingRow

log = logging.getLogger(__name__)

Kind = Literal["progress", "reading", "line", "event", "result"]

# Largest number of waiting calls of a kind; beyond it the oldest is dropped. Of progress only the
# newest is kept; a result is never dropped.
MOST: Mapping[Kind, int | None] = {
    "progress": 1,
    "reading": 200,
    "line": 1000,
    "event": 1000,
    "result": None,
}
CLOSE_S = 10.0  # without any progress, after which the observer is abandoned


class ObserverWorker:
    """Executes calls in order in a daemon thread; submitting a call never waits.

    Parameters
    ----------
    name : str
        Of the thread.
    tell_dropped : callable
        Called in the thread with the number of dropped calls of each kind, except progress, of
        which only the newest is needed.
    """

    def __init__(self, name: str, tell_dropped: Callable[[Mapping[Kind, int]], None]) -> None:
        self._calls: deque[tuple[Kind, Callable[[], None]] | None] = deque()
        self._waiting: Counter[Kind] = Counter()
        self._dropped: Counter[Kind] = Counter()
        self._tell_dropped = tell_dropped
        # held only while the queue is changed, never while a call is carried out; its lock is
        # re-entrant, because a signal handler may also submit a call
        self._changed = threading.Condition()
        self._idle = True
        self._failed = False
        self._moved_s = time.monotonic()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def post(self, call: Callable[[], None], kind: Kind) -> None:
        """Hand a call over."""
        with self._changed:
            most = MOST[kind]
            if most is not None and self._waiting[kind] >= most:
                self._drop_oldest(kind)
            self._calls.append((kind, call))
            self._waiting[kind] += 1
            self._changed.notify_all()

    def moved(self) -> None:
        """Report, within a call, that it makes progress."""
        self._moved_s = time.monotonic()

    def drain(self, still_s: float = CLOSE_S) -> bool:
        """Wait until everything is carried out, and return whether it is.

        Parameters
        ----------
        still_s : float
            Abandoned after this many real seconds without progress.
        """
        self.moved()
        with self._changed:
            while self._calls or not self._idle:
                left_s = self._moved_s + still_s - time.monotonic()
                if left_s <= 0 or not self._thread.is_alive():
                    return False
                self._changed.wait(min(left_s, 0.2))
        return True

    def close(self, still_s: float = CLOSE_S) -> bool:
        """Drain, end the thread, and return whether everything was carried out."""
        done = self.drain(still_s)
        with self._changed:
            self._calls.append(None)
            self._changed.notify_all()
        if done:
            self._thread.join(still_s)
        return done

    def _drop_oldest(self, kind: Kind) -> None:
        for k, waiting in enumerate(self._calls):
            if waiting is not None and waiting[0] == kind:
                del self._calls[k]
                self._waiting[kind] -= 1
                self._dropped[kind] += 1
                return

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._calls:
                    self._idle = True
                    self._changed.notify_all()
                    self._changed.wait()
                self._idle = False
                taken = self._calls.popleft()
                if taken is None:
                    return
                self._waiting[taken[0]] -= 1
                dropped, self._dropped = self._dropped, Counter()
            del dropped["progress"]
            if dropped:
                self._carry_out(lambda told=dropped: self._tell_dropped(told))
            self._carry_out(taken[1])

    def _carry_out(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception:
            # once: the warning itself may be what cannot be shown
            if not self._failed:
                self._failed = True
                log.warning("%s: a call failed", self._thread.name, exc_info=True)
        self.moved()


class DetachedObserver:
    """Forwards a test to an observer (`thermo.station.outcome.Observer`) in another thread.

    The test never waits for it. If the observer takes too long, the oldest calls are dropped,
    progress first. When it continues, an event of the kind "display" gives the number of dropped
    calls.

    Parameters
    ----------
    observer : Observer
    worker : ObserverWorker, optional
        The thread that calls it; by default a new one.
    """

    def __init__(self, observer: Observer, worker: ObserverWorker | None = None) -> None:
        self._observer = observer
        self._failure = ""
        self.worker = worker or ObserverWorker("observer", self._tell_dropped)

    @property
    def lost(self) -> str:
        """Reason why nothing is shown any more; empty while the display works."""
        return self._failure or getattr(self._observer, "lost", "")

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Pass one scan on."""
        self._pass_on(lambda: self._observer.on_reading(run, rows), "reading")

    def on_progress(self, progress: Progress) -> None:
        """Pass the progress on."""
        self._pass_on(lambda: self._observer.on_progress(progress), "progress")

    def on_event(self, event: Event) -> None:
        """Pass an event on."""
        self._pass_on(lambda: self._observer.on_event(event), "event")

    def close(self, still_s: float = CLOSE_S) -> bool:
        """Wait for the observer as `ObserverWorker.close` does."""
        return self.worker.close(still_s)

    def _pass_on(self, call: Callable[[], None], kind: Kind) -> None:
        def carefully() -> None:
            if self._failure:
                return
            try:
                call()
            except Exception as err:
                self._failure = f"{type(err).__name__}: {err}"

        self.worker.post(carefully, kind)

    def _tell_dropped(self, dropped: Mapping[Kind, int]) -> None:
        text = "not shown, it took too long: " + counted(dropped)
        self._observer.on_event(Event(run=0, time_s=0.0, kind="display", text=text))


def counted(dropped: Mapping[Kind, int]) -> str:
    """Return the numbers of dropped calls of each kind as text."""
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in dropped.items())
