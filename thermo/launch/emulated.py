"""Tests on emulated instruments: over real sockets and terminals, on the physical twin."""

from collections.abc import Callable, Generator, Mapping
from collections.abc import Sequence as Many
from contextlib import contextmanager

import numpy as np

from drivers.clock import Clock, SteppedClock
from drivers.emulators.plant import Plant
from drivers.emulators.station import EmulatedStation
from drivers.station import StationConfig
from thermo.launch.real import run_on_station
from thermo.station.job import Job
from thermo.station.outcome import Event, Observer, Progress, RunControl, TestOutcome
from thermo.store.files import open_existing_store
from thermo.store.records import ReadingRow
from thermo.twin.plant import Twin, make_plant


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


def relive_stored(plant: Twin, store_url: str, test_id: str) -> None:
    """Give the accelerometers of a resumed test, made anew, the past that its store tells of."""
    with open_existing_store(store_url) as store:
        readings = store.readings(test_id).dropna(subset=["temp_c"])
    for serial, mine in readings.groupby("serial"):
        # one time after another whatever the runs' own times: the intervals within them count
        step_s = np.diff(mine["time_s"].to_numpy(dtype=float), prepend=0.0)
        time_s = np.cumsum(np.where(step_s > 0, step_s, 1.0))
        plant.relive(str(serial), time_s, mine["temp_c"].to_numpy(dtype=float))


def run_emulated(
    job: Job,
    *,
    plant: Plant | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    seed: int = 1,
    clock: Clock | None = None,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
    take_over: bool = False,
    on_begun: Callable[[str], None] | None = None,
    log_to_store: bool = False,
) -> TestOutcome:
    """Run a test on emulated instruments in this process, over real sockets and terminals.

    Parameters
    ----------
    job : Job
        As `thermo.station.job.make_job` or `make_resumed_job` makes it.
    plant : Plant, optional
        The physics; the physical twin of the job's station if not given.
    effects : mapping, optional
        Hidden effects of the twin's accelerometers by serial number. A sequence with a `run_in`
        finds them newly assembled, and a resumed one with the past that its store tells of.
    seed : int
        Of the twin.
    clock : Clock, optional
        A `SteppedClock` if not given: the night passes as fast as the machine can compute it.
    observers, control, take_over, on_begun, log_to_store
        As for `run_on_station`. There is no guardian: the chamber ends with the process.

    Returns
    -------
    TestOutcome
    """
    clock = clock or SteppedClock()
    plant = plant or _twin_of(job, effects, seed)
    with EmulatedStation(job.station, plant, clock) as station:
        return run_on_station(
            job.served_at(station.config),
            clock=clock,
            observers=(_PowerSwitch(plant, clock), *observers),
            control=control,
            guard=False,
            take_over=take_over,
            on_begun=on_begun or (lambda _: None),
            log_to_store=log_to_store,
        )


def _twin_of(job: Job, effects: Mapping[str, Mapping[str, float]] | None, seed: int) -> Twin:
    """Return the physical twin of a job's station, with its accelerometers' past."""
    accelerometers, run_in = job.sequence.accelerometers, job.sequence.run_in
    twin = make_plant(
        job.station,
        nominal_scales={a.serial: a.nominal_scale for a in accelerometers},
        effects=effects,
        new_from_assembly=run_in is not None,
        mount_deg={a.serial: a.mount_deg for a in accelerometers},
        seed=seed,
    )
    if job.resume is not None and run_in is not None:
        relive_stored(twin, job.store_url, job.resume)
    return twin
