"""The controller's side of the guardian: lock, heartbeat, fence, replacement."""

import contextlib
import logging
import os
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from drivers.devices import SafeResult
from drivers.errors import FencedError, LinkError
from drivers.station import ChamberConfig, StationConfig
from thermo.planning.silence import silence_limit_s
from thermo.safety.chamber_lock import PATIENCE_S, ChamberHeldError, ChamberLock
from thermo.safety.commanded_note import Commanded, forget_commanded, note_commanded, read_commanded
from thermo.safety.guardian import Charge
from thermo.safety.guardian_process import Guardian
from thermo.safety.guardian_record import read_record
from thermo.safety.heartbeat import notify_service, watchdog_s
from thermo.safety.processes import is_alive, process_start, process_state

log = logging.getLogger(__name__)

BEAT_S = 0.5  # between two beats, at most so often
MAX_REPLACED = 5  # in one sitting; more are no accident
RELIEF_S = 30.0  # a fenced controller waits so long for the guardian's result, to tell it


class Guard:
    """A sitting's hold on its chamber: the lock, the guardian, and whether it may still command.

    A context manager: left without `end`, a chamber that a guardian was started for is handed
    over to it.

    Parameters
    ----------
    config : StationConfig
    lock : ChamberLock
        Released at the end.
    limit_s : float, optional
        How long the controller may be silent, real s; by the station file if not given.
    """

    def __init__(
        self, config: StationConfig, lock: ChamberLock, *, limit_s: float | None = None
    ) -> None:
        self.commanded = False  # whether a write was ever allowed
        self.taken_over = ""  # by the guardian, and why
        self._config = config
        self._lock = lock
        self._limit_s = silence_limit_s(config) if limit_s is None else limit_s
        self._charge: Charge | None = None
        self._guardian: Guardian | None = None
        self._left_before = False  # an earlier test had left the chamber behind
        self._replaced = 0
        self._lost = False  # unguarded: the last one could not be replaced
        self._beaten_s = -BEAT_S
        self._thread = threading.get_ident()

    def start(
        self, test_id: str, recognition: Mapping[str, float | str], result_path: Path
    ) -> None:
        """Start the guardian and note that the chamber will be commanded.

        Parameters
        ----------
        test_id : str
        recognition : mapping
            `Chamber.recognition`.
        result_path : Path
            As `thermo.safety.guardian_results.result_file` gives it.

        Raises
        ------
        LinkError
            If it does not get ready, or its files cannot be written; nothing was commanded.
        """
        self._charge = Charge(
            chamber=self._config.chamber,
            result_path=result_path,
            limit_s=self._limit_s,
            test_id=test_id,
            recognition=recognition,
        )
        self._left_before = read_commanded(self._config.chamber) is not None
        first = Guardian(self._charge, self._lock)
        first.wait_until_ready()
        try:
            self._note(first)
        except OSError as err:
            first.dismiss()
            raise LinkError(
                f"guardian: {err.filename or 'its note'}: {err.strerror}; not commanded"
            ) from None
        self._guardian = first
        patience_s = watchdog_s()
        if patience_s is not None and patience_s < self._limit_s:
            log.warning(
                "WatchdogSec is %g s, shorter than the silence limit of %g s; expected a longer "
                "one",
                patience_s,
                self._limit_s,
            )
        notify_service("READY=1", f"STATUS=test {test_id}")

    def permit(self) -> None:
        """Allow one write to the chamber; called by its driver right before.

        Raises
        ------
        FencedError
            If the guardian has taken over, or none was started.
        """
        if self._guardian is None:
            raise FencedError("there is no guardian; the chamber is not commanded")
        self._look_at_fence(self._guardian)
        self._beat(self._guardian)
        self.commanded = True

    def beat(self) -> tuple[str, ...]:
        """Show that the control thread lives, and look whether the guardian does.

        Never waits. From another thread than the one that made this, it does nothing: that
        another thread lives says nothing about the control.

        Returns
        -------
        tuple of str
            What is worth an event.

        Raises
        ------
        FencedError
            If the guardian has taken over; nothing may be commanded any more.
        LinkError
            Once, if a dead guardian cannot be replaced; the test is to end.
        """
        if threading.get_ident() != self._thread or self._guardian is None:
            return ()
        self._look_at_fence(self._guardian)
        self._beat(self._guardian)
        trouble = "" if self._lost else self._guardian.trouble
        return (self._replace(trouble),) if trouble else ()

    @property
    def health(self) -> str:
        """The guardian in words; may be asked from any thread."""
        current = self._guardian
        if self.taken_over:
            return self.taken_over
        if current is None:
            return "no guardian"
        return current.trouble or f"process {current.pid} watches"

    def end(self, safe: SafeResult) -> SafeResult:
        """End the sitting: dismiss the guardian, or leave the chamber to it.

        Parameters
        ----------
        safe : SafeResult
            Of the controller's own clean-up.

        Returns
        -------
        SafeResult
            That one; or what the guardian did, when it had taken over (`taken_over` says why).
        """
        current, self._guardian = self._guardian, None
        if current is not None:
            with contextlib.suppress(FencedError):
                self._look_at_fence(current)
            if not self.taken_over and (safe.verified or not (safe.commanded or self.commanded)):
                current.dismiss()
                with contextlib.suppress(FencedError):
                    self._look_at_fence(current)
                if not self.taken_over:
                    current.result_path.unlink(missing_ok=True)
                    if safe.verified or not self._left_before:
                        forget_commanded(self._config.chamber)
            elif not self.taken_over:
                self._hand_over(current)
            if self.taken_over:
                safe = self._relieved(current)
        self._lock.release()
        return safe

    def __enter__(self) -> "Guard":
        return self

    def __exit__(self, *_: object) -> None:
        if self._guardian is not None:
            self._hand_over(self._guardian)
            self._guardian = None
        self._lock.release()

    # ---- parts of the above

    def _look_at_fence(self, current: Guardian) -> None:
        if not self.taken_over:
            current.hear()
            if not current.fence:
                return
            self.taken_over = f"the guardian took over: {current.fence}"
            log.error("%s", self.taken_over)
            current.see_fence()
        raise FencedError(self.taken_over)

    def _beat(self, current: Guardian) -> None:
        now_s = time.monotonic()
        if now_s - self._beaten_s >= BEAT_S and threading.get_ident() == self._thread:
            self._beaten_s = now_s
            current.beat()
            notify_service("WATCHDOG=1")

    def _replace(self, trouble: str) -> str:
        """Put a new guardian in the place of one that is dead or mute; return the event."""
        assert self._charge is not None
        assert self._guardian is not None
        old = self._guardian
        old.kill()
        self._replaced += 1
        try:
            if self._replaced > MAX_REPLACED:
                raise LinkError(f"guardian: {self._replaced} were lost")
            self._guardian = Guardian(self._charge, self._lock)
        except LinkError as err:
            self._lost = True
            raise LinkError(f"{trouble} and cannot be replaced: {err}") from None
        try:
            self._note(self._guardian)
        except OSError as err:  # the first one's still stands, and says by what to recognise
            log.warning("%s: %s", err.filename, err.strerror)
        if old.fence:  # it took over just before it was ended: its successor finishes that
            self.taken_over = f"the guardian took over: {old.fence}"
            self._hand_over(self._guardian)
            raise FencedError(self.taken_over)
        log.warning("%s; process %d takes its place", trouble, self._guardian.pid)
        return f"{trouble}; process {self._guardian.pid} takes its place"

    def _note(self, current: Guardian) -> None:
        assert self._charge is not None
        note_commanded(
            self._config.chamber,
            Commanded(
                chamber_url=self._charge.chamber.url,
                test_id=self._charge.test_id,
                recognition=self._charge.recognition,
                guardian_pid=current.pid,
                guardian_start=process_start(current.pid),
                result_path=current.result_path,
            ),
        )

    def _hand_over(self, current: Guardian) -> None:
        """Leave the chamber to the guardian, or to a new one if that is gone."""
        current.hear()
        stopped = process_state(current.pid)[0] == "stopped"
        if (stopped or current.trouble) and self._charge is not None:
            current.kill()
            try:
                current = Guardian(self._charge, self._lock)
            except LinkError as err:
                log.error("the chamber is not changed: %s", err)
                return
        log.error("the chamber is left to the guardian, process %d", current.pid)
        current.leave_to_it()

    def _relieved(self, current: Guardian) -> SafeResult:
        """Wait a little for the guardian that took over, and tell what it did."""
        if current.has_died(RELIEF_S):
            self._hand_over(current)
        else:
            current.leave_to_it()
        record = read_record(current.result_path)
        told = record.text if record is not None else "it has written no result"
        verified = record is not None and record.verified
        return SafeResult(verified=verified, steps=(self.taken_over, told), commanded=False)


def take_lock(chamber: ChamberConfig, *, patience_s: float = PATIENCE_S) -> ChamberLock:
    """Take a chamber's lock, waiting for a guardian that makes it safe.

    A guardian that was stopped while its controller died is let run on, so that it does.

    Raises
    ------
    ChamberHeldError, LinkError
        As `ChamberLock.take`.
    """
    try:
        return ChamberLock.take(chamber, patience_s=0.0)
    except ChamberHeldError as err:
        note = read_commanded(chamber) if err.holder.is_guardian else None
    if (
        note is not None
        and is_alive(note.guardian_pid, note.guardian_start)
        and process_state(note.guardian_pid)[0] == "stopped"
    ):
        log.warning("the guardian, process %d, was stopped; it continues now", note.guardian_pid)
        with contextlib.suppress(OSError):
            os.kill(note.guardian_pid, signal.SIGCONT)
    return ChamberLock.take(chamber, patience_s=patience_s)
