"""The shell around a chamber test: station files, signals, the guardian, emulated instruments."""

import logging
import signal
import threading
from collections.abc import Generator, Mapping
from collections.abc import Sequence as Many
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import FrameType

from drivers.clock import Clock, RealClock, SteppedClock
from drivers.emulators.plant import Plant
from drivers.emulators.station import EmulatedStation
from drivers.opening import open_station
from drivers.station import ChamberConfig, DigitiserConfig, HeadConfig, InputConfig, StationConfig
from errormodel.errors import InputError
from errormodel.files import read_toml
from thermo.guardian import RETRY_S
from thermo.guarding import Guardian, collect_result, result_file, wait_for_guardian
from thermo.plan import make_plan
from thermo.sequence import Sequence, load_sequence
from thermo.station import run_test, stored_sequence
from thermo.station_types import Event, Observer, Progress, RunControl, TestOutcome
from thermo.store import ReadingRow, Store, open_store
from thermo.twin import make_plant

__all__ = [
    "default_station",
    "emulated",
    "load_sequence",
    "load_station",
    "run_emulated",
    "run_on_station",
]

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
MAX_EMULATED = 99  # two channels of the emulated multimeter each


def load_station(path: Path | str) -> StationConfig:
    """Read a station file.

    Raises
    ------
    InputError
        Naming the file and the key that is wrong.
    """
    return read_toml(path, StationConfig)


def default_station(sequence: Sequence) -> StationConfig:
    """Return the emulated station a sequence runs on when none is given.

    A Watlow F4T over TCP on a free port, multimeter and head on pseudo-terminals, and the
    accelerometers wired in the sequence's order: outputs in mA over 1 kΩ on channels 101 and up,
    thermistors on 201 and up.

    Raises
    ------
    InputError
        If there are more accelerometers than the emulated multimeter has channels for.
    """
    if len(sequence.accelerometers) > MAX_EMULATED:
        problem = f"{len(sequence.accelerometers)} are too many to emulate, at most {MAX_EMULATED}"
        raise InputError(sequence.name, "accelerometers", problem)
    inputs = tuple(
        InputConfig(serial=a.serial, output_channel=101 + k, thermistor_channel=201 + k)
        for k, a in enumerate(sequence.accelerometers)
    )
    return StationConfig(
        name="emulated",
        chamber=ChamberConfig(model="watlow_f4t", url="modbus+tcp://127.0.0.1:0"),
        digitiser=DigitiserConfig(url="serial://auto"),
        head=HeadConfig(url="serial://auto", speed_deg_per_s=40.0),
        inputs=inputs,
    )


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
        store = stack.enter_context(open_store(store_url))
        if resume is not None:
            config = config or _stored_station(store, resume)
            sequence = stored_sequence(store, resume, sequence)
            store.claim(resume)
            wait_for_guardian(result_file(store_url, resume))
            collect_result(store, resume, result_file(store_url, resume))
        assert config is not None
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
        return outcome


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

    before = {number: signal.signal(number, handle) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _PowerSwitch:
    """Tells the plant of an emulated station when its accelerometers are switched on again."""

    def __init__(self, plant: Plant, clock: Clock) -> None:
        self._plant = plant
        self._clock = clock

    def on_reading(self, run: int, rows: Many[ReadingRow]) -> None:
        """See nothing in it."""

    def on_progress(self, progress: Progress) -> None:
        """See nothing in it."""

    def on_event(self, event: Event) -> None:
        """Switch."""
        switch = getattr(self._plant, "power_cycle", None)
        if event.kind == "power on" and switch is not None:
            switch(self._clock.now_s())


@contextmanager
def emulated(
    config: StationConfig, clock: Clock, plant: Plant | None = None, seed: int = 1
) -> Generator[EmulatedStation]:
    """Serve a station file's instruments on a plant, by default the physical twin."""
    with EmulatedStation(config, plant or make_plant(config, seed=seed), clock) as station:
        yield station


def run_emulated(
    sequence: Sequence,
    store_url: str | Path,
    *,
    config: StationConfig | None = None,
    plant: Plant | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    seed: int = 1,
    clock: Clock | None = None,
    resume: str | None = None,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
) -> TestOutcome:
    """Run a test on emulated instruments in this process, over real sockets and terminals.

    Parameters
    ----------
    sequence : Sequence
    store_url : str or path
    config : StationConfig, optional
        `default_station` if not given.
    plant : Plant, optional
        The physics; the physical twin of `config` if not given.
    effects : mapping, optional
        Hidden effects of the twin's accelerometers by serial number.
    seed : int
        Of the twin.
    clock : Clock, optional
        A `SteppedClock` if not given: the night passes as fast as the machine can compute it.
    resume, observers, control
        As for `run_on_station`. There is no guardian: the chamber ends with the process.

    Returns
    -------
    TestOutcome
    """
    clock = clock or SteppedClock()
    config = config or default_station(sequence)
    make_plan(sequence, config)
    if plant is None:
        scales = {a.serial: a.nominal_scale for a in sequence.accelerometers}
        plant = make_plant(config, nominal_scales=scales, effects=effects, seed=seed)
    with EmulatedStation(config, plant, clock) as station:
        return run_on_station(
            sequence,
            station.config,
            store_url,
            clock=clock,
            resume=resume,
            observers=(_PowerSwitch(plant, clock), *observers),
            control=control,
            guard=False,
        )
