"""The store's questions to its database, each inside a transaction that the caller began."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.migration import MARK_KIND, mark_of_event
from thermo.store.records import (
    EventRecord,
    RunRecord,
    ScheduleMark,
    TestRecord,
    TestSummary,
    signal_values,
)
from thermo.store.schema import events as event_table
from thermo.store.schema import readings as reading_table
from thermo.store.schema import runs as run_table
from thermo.store.schema import schedule_marks as mark_table
from thermo.store.schema import signals as signal_table
from thermo.store.schema import tests as test_table
from thermo.store.schema import voided as voided_table


def need_test(connection: sa.Connection, test_id: str) -> Mapping[str, Any]:
    """Return a test's row; `StoreError` when there is none."""
    query = sa.select(test_table).where(test_table.c.id == test_id)
    found = connection.execute(query).mappings().first()
    if found is None:
        raise StoreError(f"test {test_id!r}: no test has this id")
    return {str(name): value for name, value in found.items()}


def has_test(connection: sa.Connection, test_id: str) -> bool:
    """Tell whether there is a test of this id."""
    query = sa.select(test_table.c.id).where(test_table.c.id == test_id)
    return connection.execute(query).first() is not None


def running_tests(connection: sa.Connection) -> tuple[str, ...]:
    """Return the ids of the tests whose status is running, the oldest first."""
    t = test_table.c
    found = connection.execute(
        sa.select(t.id).where(t.status == "running").order_by(t.created_utc, t.id)
    )
    return tuple(found.scalars())


def run_status(connection: sa.Connection, test_id: str, number: int) -> str | None:
    """Return a run's status; None when it has not begun."""
    return connection.execute(
        sa.select(run_table.c.status).where(
            run_table.c.test_id == test_id, run_table.c.number == int(number)
        )
    ).scalar()


def has_row(connection: sa.Connection, table: sa.Table, values: Mapping[str, Any]) -> bool:
    """Tell whether a row of these values is in a table."""
    same = [table.c[name].is_not_distinct_from(value) for name, value in values.items()]
    return connection.execute(sa.select(sa.literal(1)).where(*same)).first() is not None


def has_readings(connection: sa.Connection, values: Sequence[Mapping[str, Any]]) -> bool:
    """Tell whether readings are all stored with the very values given."""
    names = [column.name for column in reading_table.columns]
    key = [column.name for column in reading_table.primary_key.columns]
    for value in values:
        where = [reading_table.c[name] == value[name] for name in key]
        found = connection.execute(sa.select(reading_table).where(*where)).mappings().first()
        if found is None or any(found[name] != value[name] for name in names):
            return False
        if "signals" in value and not _has_signals(connection, value):
            return False
    return True


def _has_signals(connection: sa.Connection, value: Mapping[str, Any]) -> bool:
    """Tell whether a reading's signals are stored with the very values given."""
    given = signal_values(value)
    key = [c.name for c in signal_table.primary_key.columns if c.name != "name"]
    where = [signal_table.c[name] == value[name] for name in key]
    query = sa.select(signal_table.c.name, signal_table.c.value).where(*where)
    return {(r.name, r.value) for r in connection.execute(query)} == {
        (one["name"], one["value"]) for one in given
    }


def signal_names(connection: sa.Connection, test_id: str) -> tuple[str, ...]:
    """Return the names of a test's recorded signals."""
    s = signal_table.c
    query = sa.select(s.name).where(s.test_id == test_id).distinct().order_by(s.name)
    return tuple(connection.execute(query).scalars())


def need_open_attempt(
    connection: sa.Connection, test_id: str, run: int, segment: int, attempt: int
) -> None:
    """Refuse readings of what is over, and of what was given up."""
    status = run_status(connection, test_id, run)
    if status is None:
        raise StoreError(f"test {test_id} run {run}: has not begun; nothing was changed")
    if status == "finished":
        raise StoreError(f"test {test_id} run {run}: is finished; nothing was changed")
    if attempt in voided_attempts(connection, test_id, run, segment):
        raise StoreError(
            f"test {test_id} run {run}: attempt {attempt} at segment {segment} was abandoned, "
            f"expected a new attempt; nothing was changed"
        )


def attempts(connection: sa.Connection, test_id: str, run: int, segment: int) -> set[int]:
    """Return the attempts at a segment that have readings."""
    r = reading_table.c
    found = connection.execute(
        sa.select(r.attempt)
        .where(r.test_id == test_id, r.run == int(run), r.segment == int(segment))
        .distinct()
    )
    return set(found.scalars())


def all_attempts(connection: sa.Connection, test_id: str) -> set[tuple[int, int, int]]:
    """Return a test's attempts, with readings or voided, as (run, segment, attempt)."""
    return {
        (row.run, row.segment, row.attempt)
        for t in (reading_table.c, voided_table.c)
        for row in connection.execute(
            sa.select(t.run, t.segment, t.attempt).where(t.test_id == test_id).distinct()
        )
    }


def voided_attempts(connection: sa.Connection, test_id: str, run: int, segment: int) -> set[int]:
    """Return the attempts at a segment that do not count."""
    v = voided_table.c
    found = connection.execute(
        sa.select(v.attempt).where(
            v.test_id == test_id, v.run == int(run), v.segment == int(segment)
        )
    )
    return set(found.scalars())


def first_present(
    connection: sa.Connection, values: Sequence[Mapping[str, Any]]
) -> Mapping[str, Any] | None:
    """Return the first of some readings that is stored already, or stands twice among them."""
    seen: set[tuple[Any, ...]] = set()
    key = [column.name for column in reading_table.primary_key.columns]
    for value in values:
        where = [reading_table.c[name] == value[name] for name in key]
        mark = tuple(value[name] for name in key)
        found = connection.execute(sa.select(sa.literal(1)).where(*where)).first()
        if found is not None or mark in seen:
            return value
        seen.add(mark)
    return None


def test(connection: sa.Connection, test_id: str) -> TestRecord:
    """Return a test with its runs."""
    row = dict(need_test(connection, test_id))
    found = connection.execute(
        sa.select(run_table).where(run_table.c.test_id == test_id).order_by(run_table.c.number)
    )
    run_records = tuple(
        RunRecord(
            number=r.number, start_utc=r.start_utc, start_clock_s=r.start_clock_s, status=r.status
        )
        for r in found
    )
    versions, settings = json.loads(row.pop("versions_json")), json.loads(row.pop("settings_json"))
    return TestRecord(**row, versions=versions, settings=settings, runs=run_records)


def tests(connection: sa.Connection) -> tuple[TestSummary, ...]:
    """Return all tests, the oldest first."""
    t = test_table.c
    run_count = sa.select(sa.func.count()).where(run_table.c.test_id == t.id).scalar_subquery()
    count = sa.select(sa.func.count()).where(reading_table.c.test_id == t.id).scalar_subquery()
    found = connection.execute(
        sa.select(
            t.id,
            t.created_utc,
            t.name,
            t.status,
            t.outcome,
            run_count.label("runs"),
            count.label("readings"),
        ).order_by(t.created_utc, t.id)
    )
    return tuple(TestSummary(**row) for row in found.mappings())  # type: ignore[arg-type]


def events(connection: sa.Connection, test_id: str) -> tuple[EventRecord, ...]:
    """Return what happened in a test, in the order of logging."""
    e = event_table.c
    found = connection.execute(
        sa.select(e.run, e.time_s, e.kind, e.text, e.logged_utc)
        .where(e.test_id == test_id)
        .order_by(e.id)
    )
    return tuple(EventRecord(**row) for row in found.mappings())  # type: ignore[arg-type]


def last_schedule_mark(connection: sa.Connection, test_id: str, run: int) -> ScheduleMark | None:
    """Return a run's newest mark, from its table or from an event of the tables' version 1."""
    m, e = mark_table.c, event_table.c
    newest = connection.execute(
        sa.select(m.start_clock_s, m.shift_s, m.segment, m.attempt, m.clock, m.logged_utc)
        .where(m.test_id == test_id, m.run == int(run))
        .order_by(m.id.desc())
        .limit(1)
    ).first()
    event = connection.execute(
        sa.select(e.text, e.logged_utc)
        .where(e.test_id == test_id, e.run == int(run), e.kind == MARK_KIND)
        .order_by(e.id.desc())
        .limit(1)
    ).first()
    # an earlier program may still have run the test when its store got the table
    if event is not None and (newest is None or event.logged_utc > newest.logged_utc):
        return mark_of_event(event.text, test_id)
    if newest is None:
        return None
    return ScheduleMark(
        start_clock_s=newest.start_clock_s,
        shift_s=newest.shift_s,
        segment=newest.segment,
        attempt=newest.attempt,
        clock=newest.clock,
    )
