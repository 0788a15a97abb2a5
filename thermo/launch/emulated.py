"""Tests on emulated instruments: over real sockets and terminals, on the physical twin."""

from collections.abc import Generator, Mapping
from collections.abc import Sequence as Many
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drivers.clock import Clock, SteppedClock
from drivers.emulators.plant import Plant
from drivers.emulators.station import EmulatedStation
from drivers.station import StationConfig
from thermo.launch.real import run_on_station
from thermo.planning.default_station import default_station
from thermo.planning.plan import make_plan
from thermo.planning.sequence import Sequence
from thermo.station.outcome import Event, Observer, Progress, RunControl, TestOutcome
from thermo.store.files import open_existing_store
from thermo.store.store import ReadingRow
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


def relive_stored(plant: Twin, store_url: str | Path, test_id: str) -> None:
    """Give the accelerometers of a resumed test, made anew, the past that its store tells of.

    Parameters
    ----------
    plant : Twin
    store_url : str or path
    test_id : str
    """
    with open_existing_store(store_url) as store:
        readings = store.readings(test_id).dropna(subset=["temp_c"])
    for serial, mine in readings.groupby("serial"):
        # one time after another whatever the runs' own times: the intervals within them count
        step_s = np.diff(mine["time_s"].to_numpy(dtype=float), prepend=0.0)
        time_s = np.cumsum(np.where(step_s > 0, step_s, 1.0))
        plant.relive(str(serial), time_s, mine["temp_c"].to_numpy(dtype=float))


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
    take_over: bool = False,
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
        Hidden effects of the twin's accelerometers by serial number. A sequence with a `run_in`
        finds them newly assembled, and a resumed one with the past that its store tells of.
    seed : int
        Of the twin.
    clock : Clock, optional
        A `SteppedClock` if not given: the night passes as fast as the machine can compute it.
    resume, observers, control, take_over
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
        plant = make_plant(
            config,
            nominal_scales=scales,
            effects=effects,
            new_from_assembly=sequence.run_in is not None,
            mount_deg={a.serial: a.mount_deg for a in sequence.accelerometers},
            seed=seed,
        )
        if resume is not None and sequence.run_in is not None:
            relive_stored(plant, store_url, resume)
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
            take_over=take_over,
        )
