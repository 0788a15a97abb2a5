"""Migration of stores that an earlier version of the tables was made for.

Version 1 kept a run's schedule marks as JSON in the text of events of the kind "schedule". A store
of it gets the new table when it is opened; its events stay what they are, and are read as marks. A
spool that an earlier program left flows in as such events too. It had no signals. Versions 1 and 2
had no table for what people ask of tests; they get them empty.
"""

import json
from dataclasses import fields

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store import schema
from thermo.store.records import ScheduleMark

OLDEST = 1
MARK_KIND = "schedule"


def migrate(connection: sa.Connection, version: int) -> None:
    """Bring the tables of an earlier version to the present one, within the open transaction."""
    for table in tables_since(version):
        table.create(connection)
    connection.execute(sa.update(schema.schema_version).values(version=schema.SCHEMA_VERSION))


def tables_since(version: int) -> tuple[sa.Table, ...]:
    """Return the tables that a store of an earlier version has not got, in order of making."""
    return tuple(t for since, added in schema.ADDED.items() if since > version for t in added)


def mark_of_event(text: str, test_id: str) -> ScheduleMark:
    """Return the mark in the text of an event of version 1.

    Raises
    ------
    StoreError
        If it is none.
    """
    try:
        data = json.loads(text)
        return ScheduleMark(
            start_clock_s=float(data["start_clock_s"]),
            shift_s=float(data["shift_s"]),
            segment=int(data["segment"]),
            attempt=int(data["attempt"]),
            clock=str(data["clock"]),
        )
    except (ValueError, KeyError, TypeError):
        names = ", ".join(f.name for f in fields(ScheduleMark))
        raise StoreError(
            f"test {test_id}: event {MARK_KIND!r}: {text[:80]!r}, expected JSON with {names}"
        ) from None
