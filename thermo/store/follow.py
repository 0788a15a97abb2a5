"""Following a test from another process: what was added to it since the last look."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from thermo.store.queries import need_test
from thermo.store.reader import StoreReader
from thermo.store.records import EventRecord, ReadingRow
from thermo.store.schema import events as event_table
from thermo.store.schema import readings as reading_table
from thermo.store.schema import voided as voided_table

PIECE = 20_000  # readings taken at one look

_ROW = tuple(n for n in ReadingRow.__dataclass_fields__ if n != "signals")


@dataclass(frozen=True, slots=True)
class Place:
    """Place up to which a test has been read.

    Attributes
    ----------
    run, slot : int
        The last reading; readings are added in this order within an attempt.
    event : int
        Number of the last event.
    attempts : int
        Attempts given up so far: a repeated segment begins again at an earlier slot, and the test
        is then read from its beginning.
    """

    run: int = 0
    slot: int = -1
    event: int = 0
    attempts: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """Readings and events that were added to a test.

    Attributes
    ----------
    readings : tuple of (int, ReadingRow)
        Number of the run and reading, those of one scan together; given-up attempts are left out.
    events : tuple of EventRecord
    place : Place
        For the next look.
    afresh : bool
        True if `readings` begins again with the test's first.
    more : bool
        True if there is more to be had at once.
    """

    readings: tuple[tuple[int, ReadingRow], ...]
    events: tuple[EventRecord, ...]
    place: Place
    afresh: bool
    more: bool


def read_added(store: StoreReader, test_id: str, place: Place) -> Added:
    """Return what was added to a test since a place.

    The cost is that of what is new, not of the test's length.

    Parameters
    ----------
    store : StoreReader
    test_id : str
    place : Place
        `Place()` for the beginning.

    Raises
    ------
    StoreError
        If there is no such test, or the store does not answer.
    """
    with store.snapshot() as connection:
        need_test(connection, test_id)
        given_up = _given_up(connection, test_id)
        afresh = len(given_up) != place.attempts
        if afresh:
            place = Place(event=place.event, attempts=len(given_up))
        rows = _readings(connection, test_id, place)
        events, event = _events(connection, test_id, place.event)
    more = len(rows) == PIECE
    if more:  # the last scan may be cut through: it comes whole the next time
        last = (rows[-1].run, rows[-1].slot)
        rows = [r for r in rows if (r.run, r.slot) != last] or rows
    if rows:
        place = Place(rows[-1].run, rows[-1].slot, event, place.attempts)
    else:
        place = Place(place.run, place.slot, event, place.attempts)
    readings = tuple(
        (int(r.run), ReadingRow(**{name: getattr(r, name) for name in _ROW}))
        for r in rows
        if (r.run, r.segment, r.attempt) not in given_up
    )
    return Added(readings=readings, events=events, place=place, afresh=afresh, more=more)


def _given_up(connection: sa.Connection, test_id: str) -> set[tuple[int, int, int]]:
    v = voided_table.c
    query = sa.select(v.run, v.segment, v.attempt).where(v.test_id == test_id)
    return {(row.run, row.segment, row.attempt) for row in connection.execute(query)}


def _readings(connection: sa.Connection, test_id: str, place: Place) -> Sequence[sa.Row[Any]]:
    r = reading_table.c
    later = sa.tuple_(r.run, r.slot) > sa.tuple_(sa.literal(place.run), sa.literal(place.slot))
    query = (
        sa.select(r.run, *(r[name] for name in _ROW))
        .where(r.test_id == test_id, later)
        .order_by(r.run, r.slot, r.attempt, r.serial)
        .limit(PIECE)
    )
    return connection.execute(query).all()


def _events(
    connection: sa.Connection, test_id: str, after: int
) -> tuple[tuple[EventRecord, ...], int]:
    e = event_table.c
    query = (
        sa.select(e.id, e.run, e.time_s, e.kind, e.text, e.logged_utc)
        .where(e.test_id == test_id, e.id > after)
        .order_by(e.id)
    )
    found = connection.execute(query).all()
    records = tuple(
        EventRecord(run=f.run, time_s=f.time_s, kind=f.kind, text=f.text, logged_utc=f.logged_utc)
        for f in found
    )
    return records, int(found[-1].id) if found else after
