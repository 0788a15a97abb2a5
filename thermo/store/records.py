"""Records that go into the store and come out of it, plain and frozen."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias, cast

from errormodel.errors import StoreError

STATUSES = ("running", "interrupted", "finished", "failed")


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
    signals: Mapping[str, float | None] = field(default_factory=_empty)  # recorded besides


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
class ScheduleMark:
    """State of a run's schedule on its clock, for a resumption; stored whenever it changes.

    A plan's time p is due at ``start_clock_s + shift_s + p`` on the clock `clock`; `segment` and
    `attempt` are what is to be read next.
    """

    start_clock_s: float
    shift_s: float
    segment: int
    attempt: int
    clock: str


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


def reading_values(test_id: str, run: int, row: ReadingRow) -> dict[str, Any]:
    """Return a reading as the database takes it; `StoreError` for what it must not hold."""
    values: dict[str, Any] = {"test_id": test_id, "run": int(run), "serial": row.serial}
    values |= {"slot": int(row.slot), "attempt": int(row.attempt), "segment": int(row.segment)}
    for name in QUANTITIES:
        values[name] = number_or_null(cast(float | None, getattr(row, name)))
    values["flag"] = plain_text(row.flag)
    infinite = [name for name in QUANTITIES if math.isinf(values[name] or 0.0)]
    if row.signals:
        signals = {plain_text(n): number_or_null(v) for n, v in row.signals.items()}
        infinite += [name for name, value in signals.items() if math.isinf(value or 0.0)]
        values["signals"] = signals
    if infinite or values["time_s"] is None:
        problem = f"{infinite[0]} is infinite" if infinite else "no time_s"
        raise StoreError(
            f"test {test_id} run {run}: {row.serial} slot {row.slot}: {problem}, "
            "expected a number; nothing was changed"
        )
    return values


def signal_values(reading: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the recorded signals of a reading, as `reading_values` has it, a row each."""
    key = {name: reading[name] for name in ("test_id", "run", "slot", "attempt", "serial")}
    signals: Mapping[str, float | None] = reading.get("signals", {})
    return [{**key, "name": n, "value": v} for n, v in signals.items() if v is not None]


def number_or_null(value: float | None) -> float | None:
    """SQLite keeps no NaN: a quantity without a value is NULL in both databases."""
    return None if value is None or math.isnan(value) else float(value)


def plain_text(text: str) -> str:
    """Neither database takes every text that Python has: no lone surrogate, no zero character."""
    return text.replace("\0", "\\0").encode("utf-8", "replace").decode()


def json_text(data: Mapping[str, Any]) -> str:
    """Return a mapping as JSON; what JSON does not know goes in as text."""
    return json.dumps(dict(data), default=str, sort_keys=True)


def check_status(status: str) -> str:
    """Return a status that there is."""
    if status not in STATUSES:
        raise StoreError(f"status {status!r}, expected one of {', '.join(STATUSES)}")
    return status
