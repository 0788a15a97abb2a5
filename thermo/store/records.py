"""What goes into the store and comes out of it: plain, frozen records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias

QUANTITIES = ("time_s", "temp_c", "position_deg", "output", "chamber_c", "lateness_s")
TestStatus: TypeAlias = Literal["running", "interrupted", "finished", "failed"]


def _empty() -> Mapping[str, Any]:
    return {}


@dataclass(frozen=True, slots=True)
class NewTest:
    """A test about to begin: everything needed to repeat or to resume it."""

    name: str
    sequence_toml: str
    station_json: str
    versions: Mapping[str, str] = field(default_factory=_empty)
    settings: Mapping[str, Any] = field(default_factory=_empty)  # what the instruments were set to


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingRow:
    """One reading of one accelerometer.

    `slot` is the index in the run's schedule, `attempt` counts the repetitions of a segment from
    1. A quantity that could not be measured is None (or NaN), and then the reading has a flag.
    """

    serial: str
    slot: int
    attempt: int = 1
    segment: int = 0
    time_s: float
    temp_c: float | None
    position_deg: float | None
    output: float | None
    chamber_c: float | None = None
    lateness_s: float | None = None
    flag: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """One run of a test; `start_clock_s` is the station clock's reading at its start."""

    number: int
    start_utc: str
    start_clock_s: float | None
    status: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    """Something that happened; `run` is None when it belongs to the test as a whole."""

    run: int | None
    time_s: float | None
    kind: str
    text: str
    logged_utc: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TestRecord:
    """A test as stored, without its readings."""

    __test__: ClassVar[bool] = False  # it is no test of pytest's

    id: str
    created_utc: str
    name: str
    sequence_toml: str
    station_json: str
    versions: Mapping[str, str]
    settings: Mapping[str, Any]
    status: TestStatus
    outcome: str
    safe_result_json: str
    runs: tuple[RunRecord, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TestSummary:
    """One line of the list of tests."""

    __test__: ClassVar[bool] = False

    id: str
    created_utc: str
    name: str
    status: TestStatus
    outcome: str
    runs: int
    readings: int
