"""The shell around a chamber test: station files, signals, the guardian."""

import logging
import signal
import threading
from collections.abc import Generator
from collections.abc import Sequence as Many
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType

from drivers.clock import Clock, RealClock
from drivers.opening import open_station
from drivers.station import ChamberConfig, StationConfig
from errormodel.files import read_toml
from thermo.guardian import RETRY_S
from thermo.guarding import Guardian, collect_result, result_file, wait_for_guardian
from thermo.plan import make_plan
from thermo.sequence import Sequence, load_sequence
from thermo.station import run_test, stored_sequence
from thermo.station_types import Observer, RunControl, TestOutcome
from thermo.store import Store
from thermo.store_spool import open_spooled_store, patience_s

__all__ = [
    "load_sequence",
    "load_station",
    "run_on_station",
]

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


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
    guard_retry_s: float = RETRY_S,
) -> TestOutcome:
    """Run a test, or go on with one, on the instruments of a station file.

    SIGINT, SIGTERM and SIGHUP end the test safely; given again they change nothing, so that the
    clean-up is never cut short. A guardian makes the chamber safe should this process be killed,
    and goes on trying should the clean-up fail.

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
        As for `thermo.station.run_test`.
    guard : bool
        Whether a guardian is started.
    guard_retry_s : float
        Real seconds for which the guardian tries a chamber that does not answer.

    Returns
    -------
    TestOutcome

    Raises
    ------
    InputError, StoreError, InstrumentError
        When it cannot be begun; nothing was commanded.
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
        if guard:
            wait_for_guardian(config.chamber)
        if resume is not None:
            collect_result(store, resume, result_file(store_url, resume))
        guardians: list[Guardian] = []

        def start_guardian(chamber: ChamberConfig, test_id: str) -> None:
            path = result_file(store_url, test_id)
            guardians.append(Guardian(chamber, path, retry_s=guard_retry_s))

        stack.callback(_hand_over, guardians)
        with _signals_to(control), open_station(config, clock=clock) as station:
            outcome = run_test(
                sequence,
                station,
                store,
                clock,
                resume=resume,
                observers=observers,
                control=control,
                before_command=partial(start_guardian, config.chamber) if guard else None,
            )
            if outcome.safe.verified:
                while guardians:
                    guardians.pop().dismiss()
        return replace(outcome, store_note=store.settle())


def _hand_over(guardians: list[Guardian]) -> None:
    for guardian in guardians:
        log.error("the chamber is left to the guardian, process %d", guardian.pid)
        guardian.leave_to_it()


def _stored_station(store: Store, test_id: str) -> StationConfig:
    return StationConfig.model_validate_json(store.test(test_id).station_json)


@contextmanager
def _signals_to(control: RunControl) -> Generator[None]:
    """Turn signals into the operator's hand; in another thread than the main one do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        control.abort(f"stopped by {signal.Signals(number).name}")

    # what was ignored before (nohup, a job in the background) is meant to stay so
    heard = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
