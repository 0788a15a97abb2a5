"""The shell around a chamber test: station files, signals, the guardian."""

import contextlib
import logging
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Generator
from collections.abc import Sequence as Many
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

from drivers.clock import Clock, RealClock
from drivers.opening import Station, open_station
from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.safety.guarded_sitting import Guard, take_lock
from thermo.safety.guardian_results import collect_result, result_file
from thermo.safety.heartbeat import notify_service
from thermo.safety.processes import process_start
from thermo.station.job import Job
from thermo.station.link.controller import ControllerLink, Health
from thermo.station.outcome import Observer, RunControl, TestOutcome
from thermo.station.procedure import run_test
from thermo.station.session import no_heartbeat
from thermo.store.operation.alarm_kinds import Kind
from thermo.store.spool.spooled_store import SpooledStore, open_spooled_store, write_patience_s

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# a job in the background that writes to its terminal, or reads from it, is stopped by these
IGNORED = (signal.SIGTTOU, signal.SIGTTIN)
REFUSAL = (
    "accelbench: Ctrl-Z is refused: a stopped controller cannot watch the chamber; Ctrl-C ends "
    "the test safely"
)


def load_station(path: Path | str) -> StationConfig:
    """Read a station file.

    Raises
    ------
    InputError
        Naming the file and the key that is wrong.
    """
    return read_toml(path, StationConfig)


def _nobody(test_id: str) -> None:
    """Tell nobody that a test has begun."""


def run_on_station(
    job: Job,
    *,
    clock: Clock | None = None,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
    guard: bool = True,
    take_over: bool = False,
    silence_s: float | None = None,
    on_begun: Callable[[str], None] = _nobody,
    log_to_store: bool = False,
) -> TestOutcome:
    """Run a test, or go on with one, on the instruments of a station file.

    SIGINT, SIGTERM and SIGHUP end the test safely; given again they change nothing, so that the
    clean-up is never cut short. SIGTSTP (Ctrl-Z) is refused with a line. A guardian makes the
    chamber safe should this process be killed, hang or be stopped, and keeps trying should the
    clean-up fail. A test that the guardian had to end has the status "failed".

    Parameters
    ----------
    job : Job
        As `thermo.station.job.make_job` or `make_resumed_job` makes it.
    clock : Clock, optional
        Real time if not given.
    observers, control
        As for `thermo.station.procedure.run_test`.
    guard : bool
        Whether the chamber's lock is taken and a guardian started.
    take_over : bool
        As for `thermo.station.procedure.run_test`.
    silence_s : float, optional
        How long this process may be silent before its guardian takes over, real s; by the station
        file if not given.
    on_begun : callable
        Called with the test's id when the store has it and before anything is commanded; what it
        raises ends the test.
    log_to_store : bool
        Whether the program's warnings become events of the test, of the kind "log": where nobody
        sees a terminal.

    Returns
    -------
    TestOutcome

    Raises
    ------
    InputError, StoreError, InstrumentError, ChamberOccupiedError
        When it cannot be begun, another process that holds the chamber among the reasons; nothing
        was commanded.
    """
    clock, control = clock or RealClock(), control or RunControl()
    with ExitStack() as stack:
        store = stack.enter_context(open_spooled_store(job.store_url))
        if job.resume is not None:
            store.claim(job.resume)
        store.patience_s = write_patience_s(job.sequence.sampling.period_s, clock)
        sitting = None
        if guard:  # before anything is opened or written
            lock = take_lock(job.station.chamber)
            sitting = stack.enter_context(Guard(job.station, lock, limit_s=silence_s))
        if job.resume is not None:
            collect_result(store, job.resume, result_file(job.store_url, job.resume))
        permit = None if sitting is None else sitting.permit
        # until the end is stored and told: a second Ctrl-C is not to cut that short
        stack.enter_context(signals_to(control))
        with open_station(job.station, clock=clock, permit=permit) as station:

            def health() -> Health:
                return _health(station, sitting, store)

            def before_command(test_id: str) -> None:
                if sitting is not None:
                    path = result_file(job.store_url, test_id)
                    sitting.start(test_id, station.chamber.recognition, path)
                link.begin(test_id)
                on_begun(test_id)

            period_s = job.sequence.sampling.period_s
            link = stack.enter_context(
                ControllerLink(
                    job.store_url,
                    control,
                    clock,
                    period_s,
                    health=health,
                    pid_start=process_start(os.getpid()),
                    log_to_store=log_to_store,
                )
            )
            outcome = run_test(
                job,
                station,
                store,
                clock,
                observers=(link.notes, *observers),
                control=control,
                before_command=before_command,
                take_over=take_over,
                heartbeat=no_heartbeat if sitting is None else sitting.beat,
            )
            outcome = outcome if sitting is None else _end_sitting(sitting, outcome)
        outcome = replace(outcome, store_note=store.settle())
        link.end(outcome)
        return outcome


def _health(station: Station, sitting: Guard | None, store: SpooledStore) -> Health:
    """Return how instruments, guardian and store are; nobody is asked anything."""
    parts: list[str] = []
    for name, device in station.devices.items():
        counters = device.counters
        fault = f", last fault: {counters.last_fault}" if counters.last_fault else ""
        parts.append(f"{name}: {counters.exchanges} exchanges, {counters.retries} retries{fault}")
    guardian = "emulated: none" if sitting is None else sitting.health
    return Health(link="; ".join(parts), guardian=guardian, store=store.trouble)


def _end_sitting(sitting: Guard, outcome: TestOutcome) -> TestOutcome:
    """Dismiss the guardian, or leave the chamber to it; a test it had to end is never finished."""
    safe = sitting.end(outcome.safe)
    notify_service("STATUS=the test is over")
    if not sitting.taken_over:
        return outcome
    taken = sitting.taken_over
    return replace(outcome, status="failed", reason=taken, safe=safe, kind="guardian")


@contextmanager
def signals_to(control: RunControl) -> Generator[None]:
    """Turn signals into the operator's hand; in another thread than the main one do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        kind: Kind = "aborted" if number == signal.SIGINT else "interrupted"
        control.abort(f"stopped by {signal.Signals(number).name}", kind)

    def refuse(number: int, frame: FrameType | None) -> None:
        say_at_once(REFUSAL)

    handlers = dict.fromkeys(SIGNALS, handle) | {signal.SIGTSTP: refuse}
    # what was ignored before (nohup, a job in the background) is meant to stay so
    heard = [number for number in handlers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handlers[number]) for number in heard}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in IGNORED}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def say_at_once(line: str) -> None:
    """Write a line to standard error unless that would wait for whoever reads it."""
    with contextlib.suppress(OSError, ValueError):
        fd = sys.stderr.fileno()
        if select.select([], [fd], [], 0)[1]:
            os.write(fd, f"{line}\n".encode())
