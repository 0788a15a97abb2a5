"""A running test's link to the people who ask and watch: commands in, heartbeats and alarms out.

It has a thread and a database connection of its own. The test's thread only leaves notes here and
never waits for either: with a store that is slow, locked or away, commands and heartbeats wait, the
test does not. What is taken from the queue acts on the test by its `RunControl` alone.
"""

import logging
import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, Self

from drivers.clock import Clock
from errormodel.errors import StoreError
from thermo.station.link.notes import NotedWarnings, TestNotes
from thermo.station.outcome import RunControl, TestOutcome
from thermo.store.database import utc_now
from thermo.store.operation.alarms import raise_alarm
from thermo.store.operation.commands import (
    OF_CONTROLLERS,
    Command,
    answer,
    refuse_left,
    take_next,
)
from thermo.store.operation.controllers import ControllerBeat, write_beat
from thermo.store.store import Store, open_store

log = logging.getLogger(__name__)

# real seconds
POLL_S = 0.25  # between two looks into the queue
BEAT_S = 1.0  # between two heartbeats
AGAIN_S = 2.0  # after the store refused
END_S = 5.0  # for the last word, when the test is over


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """State of instruments, guardian and store in words; `store` is empty if it answers."""

    link: str = ""
    guardian: str = ""
    store: str = ""


Answer = tuple[Literal["done", "refused"], str]


@dataclass(slots=True)
class _Pending:
    """A command that was taken and is not answered yet."""

    command: Command
    events_before: int


def this_process() -> str:
    """Return who takes a command: this process on this machine."""
    return f"process {os.getpid()} on {socket.gethostname()}"


class ControllerLink:
    """Lets commands act on a test, and tells how it is; its `notes` are among the observers.

    Parameters
    ----------
    store_url : str
    control : RunControl
        The operator's hand on the test.
    clock : Clock
        The test's.
    period_s : float
        Between two scans, s on the clock.
    health : callable
        Asked in the link's thread; it must not wait.
    pid_start : int, optional
        When this process began, in clock ticks since boot.
    log_to_store : bool
        Whether the program's warnings become events of the test.
    """

    def __init__(
        self,
        store_url: str,
        control: RunControl,
        clock: Clock,
        period_s: float,
        *,
        health: Callable[[], Health] = Health,
        pid_start: int | None = None,
        log_to_store: bool = False,
    ) -> None:
        self._url = store_url
        self._control = control
        self.notes = TestNotes(period_s)
        self._health = health
        self._speed: float | None = getattr(clock, "speed", None)
        self._pid_start = pid_start
        self._log_handler = NotedWarnings(self.notes) if log_to_store else None
        self._pending: list[_Pending] = []
        self._beat: ControllerBeat | None = None
        self._beat_due_s = 0.0
        self._ending = threading.Event()
        self._outcome: TestOutcome | None = None
        self._store_was_away = False
        self._thread: threading.Thread | None = None

    # ---- the test's thread

    def begin(self, test_id: str) -> None:
        """Start: the test is in the store and nothing has been commanded yet."""
        now = utc_now()
        self._beat = ControllerBeat(
            test_id=test_id,
            host=socket.gethostname(),
            pid=os.getpid(),
            pid_start=self._pid_start,
            began_utc=now,
            beat_utc=now,
            speed=self._speed,
        )
        if self._log_handler is not None:
            logging.getLogger().addHandler(self._log_handler)
        self._thread = threading.Thread(target=self._work, name="controller link", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end(None)

    def end(self, outcome: TestOutcome | None) -> None:
        """Tell how the test ended, and wait a moment at most until that is in the store.

        Parameters
        ----------
        outcome : TestOutcome or None
            None: it ended by an exception that nobody expected.
        """
        if self._thread is None or self._ending.is_set():
            return
        self._outcome = outcome
        self._ending.set()
        self._thread.join(END_S)
        if self._log_handler is not None:
            logging.getLogger().removeHandler(self._log_handler)
        if self._thread.is_alive():
            log.warning("the store does not answer: the end is not among its heartbeats and alarms")

    # ---- the link's own thread

    def _work(self) -> None:
        assert self._beat is not None
        store: Store | None = None
        refused_old = False
        give_up_s: float | None = None
        while True:
            ending = self._ending.is_set()
            if ending and give_up_s is None:
                give_up_s = time.monotonic() + END_S
            try:
                store = store or open_store(self._url, existing=True)
                if not refused_old:
                    said = "asked before the test was begun or resumed; ask again"
                    test_id, began = self._beat.test_id, self._beat.began_utc
                    refuse_left(store, test_id, said, before_utc=began)
                    refused_old = True
                self._turn(store, ending=ending)
                if ending:
                    break
                wait_s = POLL_S
            except StoreError as err:
                log.info("controller link: %s", err)
                if store is not None:
                    store.close()
                store = None
                wait_s = AGAIN_S
            except Exception:
                log.exception("controller link: an error of the program")
                wait_s = AGAIN_S
            if give_up_s is not None and time.monotonic() >= give_up_s:
                break
            if ending:
                time.sleep(min(wait_s, POLL_S))
            else:
                self._ending.wait(wait_s)
        if store is not None:
            store.close()

    def _turn(self, store: Store, *, ending: bool) -> None:
        """Take commands, answer those that have taken effect, tell alarms, beat."""
        assert self._beat is not None
        test_id, by = self._beat.test_id, this_process()
        while not ending and (
            command := take_next(store, by=by, actions=OF_CONTROLLERS, test_id=test_id)
        ):
            self._carry_out(store, command)
        for pending in tuple(self._pending):
            if (told := self._effect(pending)) is not None:
                answer(store, pending.command.number, *told)
                self._pending.remove(pending)
        health = self._health()
        if bool(health.store) != self._store_was_away:
            self._store_was_away = bool(health.store)
            if health.store:
                self.notes.add_alarm("store", health.store)
        self._tell_alarms(store)
        for stamp, text in self.notes.take_warnings():
            store.log_event(test_id, None, None, "log", text, stamp)
        if ending:
            self._tell_end(store)
        if ending or time.monotonic() >= self._beat_due_s:
            self._beat_due_s = time.monotonic() + BEAT_S
            beat = replace(
                self._beat,
                beat_utc=utc_now(),
                link=health.link,
                guardian=health.guardian,
                store=health.store or "answers",
            )
            write_beat(store, self.notes.fill(beat, ending=ending))

    def _carry_out(self, store: Store, command: Command) -> None:
        reason = str(command.arguments.get("reason", "")).strip()
        by = f"by {command.who}" + (f": {reason}" if reason else "")
        before = self.notes.event_count
        if command.action == "pause":
            if self._control.paused:
                answer(store, command.number, "refused", "the test is paused already")
                return
            self._control.pause(f"paused {by}")
        elif command.action == "resume":
            if not self._control.paused:
                answer(store, command.number, "refused", "the test is not paused")
                return
            self._control.resume()
        else:
            self._control.abort(f"aborted {by}")
        self._pending.append(_Pending(command, before))

    def _effect(self, pending: _Pending) -> Answer | None:
        """Return what a command has come to; None: not yet."""
        action, outcome = pending.command.action, self._outcome
        events = self.notes.events_since(pending.events_before)
        if action == "pause":
            begun = [e for e in events if e.kind == "pause"]
            if begun:
                return "done", f"paused: {begun[0].text}"
            if not self._control.paused:
                return "refused", "resumed before the pause had begun"
        if action == "resume":
            over = [e for e in events if e.kind in ("pause over", "gap", "resoak")]
            if over and self.notes.phase != "pause":
                return "done", f"goes on: {over[-1].text}"
        if not self._ending.is_set():
            return None
        if outcome is None:
            return "refused", "the test ended by an error of the program"
        if action != "abort":
            return "refused", f"the test ended before: {outcome.reason}"
        return "done", f"{outcome.status}: {outcome.reason}; {safe_sentence(outcome)}"

    def _tell_alarms(self, store: Store) -> None:
        assert self._beat is not None
        found = self.notes.take_alarms()
        while found:
            kind, (text, times) = next(iter(found.items()))
            try:
                raise_alarm(store, kind, text, test_id=self._beat.test_id, times=times)
            except StoreError:
                for left, told in found.items():
                    self.notes.add_alarm(left, *told)
                raise
            del found[kind]

    def _tell_end(self, store: Store) -> None:
        assert self._beat is not None
        outcome, test_id = self._outcome, self._beat.test_id
        if outcome is None:
            said = "the test ended by an error of the program"
            raise_alarm(store, "program error", said, test_id=test_id)
            return
        refuse_left(store, test_id, f"the test has ended: {outcome.reason}")
        raise_alarm(store, outcome.kind, outcome.reason, test_id=test_id)
        if outcome.safe.commanded and not outcome.safe.verified:
            raise_alarm(store, "not safe", "; ".join(outcome.safe.steps), test_id=test_id)
        if outcome.store_note:
            raise_alarm(store, "store", outcome.store_note, test_id=test_id)


def safe_sentence(outcome: TestOutcome) -> str:
    """Return what became of the chamber, for people."""
    if not outcome.safe.commanded:
        return "the chamber was not commanded"
    if outcome.safe.verified:
        return "the chamber's safe condition is verified"
    return "the chamber's safe condition is NOT VERIFIED: see to the chamber"
