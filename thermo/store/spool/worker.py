"""A thread that does what may take for ever, so that nobody else has to wait for it that long."""

import logging
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

log = logging.getLogger(__name__)

TICK_S = 0.25  # real seconds without work after which the idle job is called

Value = TypeVar("Value")


class StoreWorker:
    """Does one job after another in a thread of its own; the process does not wait for it to end.

    Parameters
    ----------
    name : str
        Of the thread.
    """

    def __init__(self, name: str) -> None:
        self.idle: Callable[[], None] = lambda: None  # called whenever there is nothing to do
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    @property
    def is_current(self) -> bool:
        """True when the caller is the worker itself."""
        return threading.current_thread() is self._thread

    def submit(self, call: Callable[[], Value]) -> "Future[Value]":
        """Have something done; its future has the result, or what it raised."""
        future: Future[Value] = Future()

        def job() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(call())
            except BaseException as err:
                future.set_exception(err)

        self._jobs.put(job)
        return future

    def stop(self, patience_s: float = 0.0) -> None:
        """End it after the jobs that are waiting; wait for that at most so many seconds."""
        self._jobs.put(None)
        if not self.is_current:
            self._thread.join(patience_s)

    def _work(self) -> None:
        while True:
            try:
                job: Any = self._jobs.get(timeout=TICK_S)
            except queue.Empty:
                job = self._idle
            if job is None:
                return
            job()

    def _idle(self) -> None:
        try:
            self.idle()
        except Exception:
            log.exception("an idle job failed")
