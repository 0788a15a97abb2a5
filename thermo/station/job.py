"""A test resolved before anything is opened: sequence, station and store."""

from dataclasses import dataclass, replace
from pathlib import Path

from drivers.station import StationConfig
from errormodel.errors import StoreError
from thermo.planning.default_station import default_station
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import Sequence, parse_sequence
from thermo.store.files import open_existing_store
from thermo.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A test to run or to resume, made by `make_job` or `make_resumed_job`.

    Attributes
    ----------
    plan : Plan
        The sequence on the station, checked.
    store_url : str
        A file name or the URL of a database.
    resume : str or None
        The test to resume; the resume point is found once its claim is held.
    emulated : bool
        True if the station is the emulated one of the sequence.
    """

    plan: Plan
    store_url: str
    resume: str | None = None
    emulated: bool = False

    @property
    def sequence(self) -> Sequence:
        """The sequence to be run."""
        return self.plan.sequence

    @property
    def station(self) -> StationConfig:
        """The station file."""
        return self.plan.station

    def served_at(self, station: StationConfig) -> "Job":
        """Return the job with other URLs for the instruments of its station."""
        return replace(self, plan=replace(self.plan, station=station))


def make_job(
    sequence: Sequence,
    store_url: str | Path,
    station: StationConfig | None = None,
    *,
    source: str = "sequence",
) -> Job:
    """Plan a new test; nothing is opened or written.

    Parameters
    ----------
    sequence : Sequence
    store_url : str or path
    station : StationConfig, optional
        By default the emulated station of the sequence.
    source : str
        The sequence's file, for messages.

    Returns
    -------
    Job

    Raises
    ------
    InputError
        If the station cannot run the sequence; the message gives the numbers.
    """
    plan = make_plan(sequence, station or default_station(sequence), source)
    return Job(plan=plan, store_url=str(store_url), emulated=station is None)


def make_resumed_job(
    test_id: str,
    store_url: str | Path,
    station: StationConfig | None = None,
    *,
    sequence: Sequence | None = None,
    source: str = "the sequence given",
) -> Job:
    """Plan the remainder of a test from its store.

    Parameters
    ----------
    test_id : str
    store_url : str or path
    station : StationConfig, optional
        By default the station of the test. Emulated instruments ended with their process, so the
        emulated station of the sequence is created again.
    sequence : Sequence, optional
        For a check: must equal the sequence of the test.
    source : str
        Its file, for messages.

    Returns
    -------
    Job

    Raises
    ------
    InputError
        If there is no such store, or the station cannot run the sequence.
    StoreError
        If the store cannot be read, does not know the test, or the test has another sequence.
    """
    with open_existing_store(store_url) as store:
        return resumed_job_in(
            store, test_id, str(store_url), station, sequence=sequence, source=source
        )


def resumed_job_in(
    store: Store,
    test_id: str,
    store_url: str,
    station: StationConfig | None = None,
    *,
    sequence: Sequence | None = None,
    source: str = "the sequence given",
) -> Job:
    """Plan the remainder of a test from an open store."""
    test = store.test(test_id)
    stored = parse_sequence(test.sequence_toml, f"test {test_id}")
    if sequence is not None and sequence != stored:
        raise StoreError(f"{source}: is a different sequence from that of test {test_id}")
    emulated = False
    if station is None:
        made = default_station(stored)
        station = StationConfig.model_validate_json(test.station_json)
        emulated = station.name == made.name
        station = made if emulated else station
    plan = make_plan(stored, station, f"test {test_id}")
    return Job(plan=plan, store_url=store_url, resume=test_id, emulated=emulated)
