"""The emulated bench of the demonstration: tests one after another on its own clock."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib import resources
from pathlib import Path

from drivers.clock import SteppedClock
from thermo.launch.emulated import run_emulated
from thermo.planning.default_station import default_station
from thermo.planning.sequence import Sequence as TestSequence
from thermo.planning.sequence import parse_sequence
from thermo.recording.files import write_runs
from thermo.station.job import make_job
from thermo.station.outcome import Observer, TestOutcome
from thermo.store.files import open_existing_store, recorded_runs
from thermo.twin.accelerometer import EmulatedAccelerometer
from thermo.twin.plant import Twin, TwinSettings

Watch = Callable[[TestSequence], AbstractContextManager[Sequence[Observer]]]
# The head is adjusted: its own errors are no accelerometer's, and all would show them.
SETTINGS = TwinSettings(head_offset_arcsec=0.0, head_harmonic_arcsec=0.0)
DAY_S = 86_400.0
MOST_TESTS = 100  # of one demonstration: the noise of each is drawn from its own seed
Units = Mapping[str, EmulatedAccelerometer]


def hidden_sequence() -> TestSequence:
    """Return the sequence that is run, as it is shipped."""
    file = resources.files("accelbench").joinpath("examples/sequences/demo-hidden.toml")
    return parse_sequence(file.read_text(encoding="utf-8"), "demo-hidden.toml")


class TestEndedError(Exception):
    """A test did not finish."""

    def __init__(self, outcome: TestOutcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


class Bench:
    """The emulated station: one test after another, days later, with noise of its own."""

    def __init__(self, folder: Path, watch: Watch, seed: int) -> None:
        self.folder, self.watch, self.seed = folder, watch, seed
        self.began = datetime.now(UTC)
        self.tests = 0

    def measure(self, name: str, sequence: TestSequence, units: Units) -> Path:
        """Run a sequence and return the recorded file."""
        self.tests += 1
        config = default_station(sequence)
        mounts = {a.serial: a.mount_deg for a in sequence.accelerometers}
        plant = Twin(
            config.inputs,
            units,
            SETTINGS,
            MOST_TESTS * self.seed + self.tests,
            mounts,
            config.signal_channels,
        )
        store_path = str(self.folder / "store.sqlite")
        with self.watch(sequence) as observers:
            outcome = run_emulated(
                make_job(sequence, store_path),
                plant=plant,
                clock=SteppedClock((self.tests - 1) * 3 * DAY_S),
                observers=observers,
            )
        if outcome.status != "finished":
            raise TestEndedError(outcome)
        with open_existing_store(store_path) as store:
            (record,) = recorded_runs(store, outcome.test_id)
            begun = store.test(outcome.test_id).runs
        # by the station's clock, whose days pass in seconds: the wall would lay tests over another
        starts = {
            run_id: self.began + timedelta(seconds=run.start_clock_s or 0.0)
            for run_id, run in zip(record.run_ids, begun, strict=True)
        }
        path = self.folder / f"{name}.csv"
        write_runs(replace(record, run_start_utc=starts), path)
        return path
