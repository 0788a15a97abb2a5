"""Making a chamber safe from outside of any test: by hand, or by a service manager."""

import contextlib
import logging
import os
import signal
import time
from dataclasses import dataclass

from drivers.chambers.open import open_chamber
from drivers.clock import RealClock
from drivers.devices import SafeResult
from drivers.errors import LinkError
from drivers.station import ChamberConfig, StationConfig
from thermo.safety.chamber_lock import PATIENCE_S, ChamberHeldError, ChamberLock, Holder
from thermo.safety.commanded_note import Commanded, forget_commanded, read_commanded
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian_record import RecordFile
from thermo.safety.processes import is_alive
from thermo.station.safe_end import make_chamber_safe

log = logging.getLogger(__name__)

RETRY_S = 30.0  # for a chamber that does not answer; whoever waits for it can start it again
ABORT_S = 30.0  # for a test that was asked to end
PAUSE_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeSafe:
    """Result of making a station safe.

    Attributes
    ----------
    safe : SafeResult
    held_by : str
        Who holds the chamber and may command it again, in words; empty when nobody does.
    interrupted_test : str
        The test that had left the chamber behind; empty when there was none.
    needed : bool
        False when only an interrupted test's chamber was to be made safe and there was none.
    """

    safe: SafeResult
    held_by: str = ""
    interrupted_test: str = ""
    needed: bool = True

    @property
    def done(self) -> bool:
        """True when the chamber is safe and nobody else has it, or there was nothing to do."""
        return not self.needed or (self.safe.verified and not self.held_by)


def make_station_safe(
    config: StationConfig,
    *,
    force: bool = False,
    interrupted_only: bool = False,
    patience_s: float = PATIENCE_S,
    retry_s: float = RETRY_S,
    abort_s: float = ABORT_S,
) -> MadeSafe:
    """Take a station's chamber, put it into its safe condition and verify that.

    Parameters
    ----------
    config : StationConfig
        Only its chamber is opened.
    force : bool
        Ask a test that runs on the chamber to end, by SIGTERM; if it still holds the chamber
        after `abort_s`, make it safe all the same.
    interrupted_only : bool
        Do nothing unless a test of this user was interrupted and has left the chamber behind.
    patience_s : float
        For a guardian that is making it safe, real s.
    retry_s : float
        How long a chamber that does not answer is tried, real s.
    abort_s : float
        How long a test that was asked to end may take, real s.

    Returns
    -------
    MadeSafe

    Raises
    ------
    LinkError
        If the chamber's URL leads to no controller.
    """
    if interrupted_only and read_commanded(config.chamber) is None:
        return _nothing_to_do()
    lock, held_by = None, ""
    try:
        lock = take_lock(config.chamber, patience_s=patience_s)
    except ChamberHeldError as err:
        if not force:
            return MadeSafe(
                safe=SafeResult(verified=False, steps=(str(err),), commanded=False),
                held_by=err.holder.sentence,
            )
        lock, held_by = _ask_to_end(config.chamber, err.holder, abort_s)
    try:
        note = read_commanded(config.chamber)  # a guardian or a test may have ended it meanwhile
        if interrupted_only and note is None:
            return _nothing_to_do()
        safe = _make_safe(config.chamber, note, retry_s)
        if safe.verified and not held_by:
            _tell_record(config.chamber, note, safe)
            forget_commanded(config.chamber)
    finally:
        if lock is not None:
            lock.release()
    return MadeSafe(safe=safe, held_by=held_by, interrupted_test=note.test_id if note else "")


def _nothing_to_do() -> MadeSafe:
    line = "no test of this user was interrupted on this chamber; nothing was commanded"
    return MadeSafe(safe=SafeResult(verified=False, steps=(line,), commanded=False), needed=False)


def _ask_to_end(
    chamber: ChamberConfig, holder: Holder, abort_s: float
) -> tuple[ChamberLock | None, str]:
    """Ask a holder to end and wait for it; return the lock, or who holds it still."""
    if holder.pid is not None and holder.state in ("runs", "stopped"):
        log.warning("asking %s to end", holder.sentence)
        for number in (signal.SIGTERM, signal.SIGCONT):  # one that is stopped hears it on waking
            try:
                os.kill(holder.pid, number)
            except OSError as err:
                log.warning("process %d cannot be asked: %s", holder.pid, err.strerror)
    give_up_s = time.monotonic() + abort_s
    while True:
        try:
            return ChamberLock.take(chamber, patience_s=0.0), ""
        except ChamberHeldError as err:
            if time.monotonic() >= give_up_s:
                return None, err.holder.sentence
        time.sleep(PAUSE_S)


def _make_safe(config: ChamberConfig, note: Commanded | None, retry_s: float) -> SafeResult:
    recognition = note.recognition if note is not None and note.recognition else None
    try:
        chamber = open_chamber(config, recognition=recognition)
    except ValueError as err:
        raise LinkError(f"chamber: {err}") from None
    with contextlib.closing(chamber):
        return make_chamber_safe(
            chamber, config.safe_temp_c, RealClock(), retry_s=retry_s, min_attempts=1
        )


def _tell_record(config: ChamberConfig, note: Commanded | None, safe: SafeResult) -> None:
    """Complete what a dead guardian left, so that the test's store learns of it."""
    if note is None or note.result_path is None or not note.result_path.exists():
        return
    if is_alive(note.guardian_pid, note.guardian_start):
        return
    try:
        record = RecordFile(
            note.result_path,
            {
                "chamber": config.url,
                "safe_temp_c": config.safe_temp_c,
                "test_id": note.test_id,
            },
        )
        why = "controller and guardian were dead; made safe by accelbench make-safe"
        record.write("safe", why=why, verified=True, steps=safe.steps)
    except OSError as err:
        log.warning("%s: %s", note.result_path, err.strerror)
