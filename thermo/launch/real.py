"""The shell around a chamber test: station files, signals, the guardian."""

import contextlib
import logging
import os
import select
import signal
import sys
import threading
from collections.abc import Generator
from collections.abc import Sequence as Many
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

from drivers.clock import Clock, RealClock
from drivers.opening import open_station
from drivers.station import StationConfig
from errormodel.io.toml import read_toml
from thermo.planning.plan import make_plan
from thermo.planning.sequence import Sequence, load_sequence
from thermo.safety.guarded_sitting import Guard, take_lock
from thermo.safety.guardian_results import collect_result, result_file
from thermo.safety.heartbeat import notify_service
from thermo.station.outcome import Observer, RunControl, TestOutcome
from thermo.station.procedure import run_test, stored_sequence
from thermo.station.session import no_heartbeat
from thermo.store.spool.spooled_store import open_spooled_store, patience_s
from thermo.store.store import Store

__all__ = [
    "load_sequence",
    "load_station",
    "run_on_station",
]

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# a job in the background that writes to its terminal, or reads from it, is stopped by these
IGNORED = (signal.SIGTTOU, signal.SIGTTIN)
REFUSAL = (
    "accelbench: Ctrl-Z is refused: a stopped controller leaves the chamber alone; "
    "Ctrl-C ends the test safely"
)


def load_station(path: Path | str) -> StationConfig:
    """Read a station file.

    Raises
    ------
    InputError
        Naming the file and the key that is wrong.
    """
    return read_toml(path, StationConfig)


def run_on_station(
    sequence: Sequence | None,
    config: StationConfig | None,
    store_url: str | Path,
    *,
    clock: Clock | None = None,
    resume: str | None = None,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
    guard: bool = True,
    take_over: bool = False,
    silence_s: float | None = None,
) -> TestOutcome:
    """Run a test, or go on with one, on the instruments of a station file.

    SIGINT, SIGTERM and SIGHUP end the test safely; given again they change nothing, so that the
    clean-up is never cut short. SIGTSTP (Ctrl-Z) is refused with a line. A guardian makes the
    chamber safe should this process be killed, hang or be stopped, and goes on trying should the
    clean-up fail. A test that the guardian had to end has the status "failed".

    Parameters
    ----------
    sequence, config : Sequence, StationConfig
        With `resume` None is enough: the store has both.
    store_url : str or path
    clock : Clock, optional
        Real time if not given.
    resume : str, optional
        The test to go on with.
    observers, control
        As for `thermo.station.procedure.run_test`.
    guard : bool
        Whether the chamber's lock is taken and a guardian started.
    take_over : bool
        As for `thermo.station.procedure.run_test`.
    silence_s : float, optional
        How long this process may be silent before its guardian takes over, real s; by the station
        file if not given.

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
        if resume is None:
            if sequence is None or config is None:
                raise ValueError("a new test needs a sequence and a station")
            make_plan(sequence, config)  # before the store is made, so that nothing is written
        store = stack.enter_context(open_spooled_store(store_url))
        if resume is not None:
            config = config or _stored_station(store, resume)
            sequence = stored_sequence(store, resume, sequence)
            store.claim(resume)
        assert sequence is not None
        assert config is not None
        store.patience_s = patience_s(sequence.sampling.period_s, clock)
        sitting = None
        if guard:  # before anything is opened or written
            sitting = stack.enter_context(
                Guard(config, take_lock(config.chamber), limit_s=silence_s)
            )
        if resume is not None:
            collect_result(store, resume, result_file(store_url, resume))
        permit = None if sitting is None else sitting.permit
        with (
            signals_to(control),
            open_station(config, clock=clock, permit=permit) as station,
        ):

            def start_guardian(test_id: str) -> None:
                if sitting is not None:
                    path = result_file(store_url, test_id)
                    sitting.start(test_id, station.chamber.recognition, path)

            outcome = run_test(
                sequence,
                station,
                store,
                clock,
                resume=resume,
                observers=observers,
                control=control,
                before_command=start_guardian,
                take_over=take_over,
                heartbeat=no_heartbeat if sitting is None else sitting.beat,
            )
            outcome = outcome if sitting is None else _end_sitting(sitting, outcome)
        return replace(outcome, store_note=store.settle())


def _end_sitting(sitting: Guard, outcome: TestOutcome) -> TestOutcome:
    """Dismiss the guardian, or leave the chamber to it; a test it had to end is never finished."""
    safe = sitting.end(outcome.safe)
    notify_service("STATUS=the test is over")
    if not sitting.taken_over:
        return outcome
    return replace(outcome, status="failed", reason=sitting.taken_over, safe=safe)


def _stored_station(store: Store, test_id: str) -> StationConfig:
    return StationConfig.model_validate_json(store.test(test_id).station_json)


@contextmanager
def signals_to(control: RunControl) -> Generator[None]:
    """Turn signals into the operator's hand; in another thread than the main one do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        control.abort(f"stopped by {signal.Signals(number).name}")

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
