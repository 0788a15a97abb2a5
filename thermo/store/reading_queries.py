"""The readings of a test as tables: whole, piece by piece, counted."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import sqlalchemy as sa

from thermo.store.queries import need_test, signal_names
from thermo.store.records import QUANTITIES, ReadingRow
from thermo.store.schema import readings as reading_table
from thermo.store.schema import signals as signal_table
from thermo.store.schema import voided as voided_table

PIECE = 1 << 16  # readings of a stream at a time: some 25 MB
TEXTS = ("serial", "flag", "voided")
_ATTEMPT = ("test_id", "run", "segment", "attempt")
_READING = ("test_id", "run", "slot", "attempt", "serial")
ROW = ("serial", "slot", "attempt", "segment", *QUANTITIES, "flag")


class ReadingCount(NamedTuple):
    """Number of readings of an accelerometer in a run, and of those with these quantities."""

    run: int
    serial: str
    readings: int
    positions: int
    chamber_temperatures: int


def last_reading(connection: sa.Connection, test_id: str, run: int) -> ReadingRow | None:
    """Return the reading of a run that is latest in time."""
    r = reading_table.c
    found = connection.execute(
        sa.select(*(r[name] for name in ROW))
        .where(r.test_id == test_id, r.run == int(run))
        .order_by(r.time_s.desc(), r.slot.desc(), r.attempt.desc(), r.serial.desc())
        .limit(1)
    )
    row = found.mappings().first()
    return None if row is None else ReadingRow(**row)  # type: ignore[arg-type]


def readings_frame(connection: sa.Connection, test_id: str, run: int | None) -> pd.DataFrame:
    """Return readings as a table, in order of run, time and serial."""
    need_test(connection, test_id)
    r = reading_table.c
    names = signal_names(connection, test_id)
    query = _readings_with_marks(test_id, names).order_by(r.run, r.time_s, r.serial)
    if run is not None:
        query = query.where(r.run == int(run))
    return _frame(connection.execute(query).all(), names)


def reading_pieces(
    connection: sa.Connection, test_id: str, serials: Sequence[str], *, by_serial: bool
) -> Iterator[pd.DataFrame]:
    """Yield the readings that count of some accelerometers piece by piece, as in `readings_frame`.

    They come in order of run, time and serial, or of run, serial (by code point) and time.
    """
    r = reading_table.c
    collation = "C" if connection.dialect.name == "postgresql" else "BINARY"
    order = (sa.collate(r.serial, collation), r.time_s) if by_serial else (r.time_s, r.serial)
    names = signal_names(connection, test_id)
    query = _that_count(_readings_with_marks(test_id, names), serials).order_by(r.run, *order)
    streamed = connection.execution_options(stream_results=True, max_row_buffer=PIECE)
    for rows in streamed.execute(query).partitions(PIECE):
        yield _frame(rows, names)


def reading_counts(
    connection: sa.Connection, test_id: str, serials: Sequence[str]
) -> list[ReadingCount]:
    """Count the readings that count of some accelerometers, for each of their runs."""
    need_test(connection, test_id)
    r = reading_table.c
    query = sa.select(
        r.run,
        r.serial,
        sa.func.count().label("readings"),
        sa.func.count(r.position_deg).label("positions"),
        sa.func.count(r.chamber_c).label("chamber_temperatures"),
    ).select_from(_joined())
    query = query.where(r.test_id == test_id).group_by(r.run, r.serial).order_by(r.run)
    return [ReadingCount(*row) for row in connection.execute(_that_count(query, serials))]


def _joined(signals: Sequence[sa.FromClause] = (), names: Sequence[str] = ()) -> sa.Join:
    r, v = reading_table.c, voided_table.c
    same = (getattr(r, name) == getattr(v, name) for name in _ATTEMPT)
    joined = reading_table.outerjoin(voided_table, sa.and_(*same))
    for one, name in zip(signals, names, strict=True):
        same = [r[key] == one.c[key] for key in _READING]
        joined = joined.outerjoin(one, sa.and_(*same, one.c.name == name))
    return joined


def _readings_with_marks(test_id: str, names: Sequence[str] = ()) -> sa.Select[Any]:
    """Return the query of a test's readings, with the signals named as further columns."""
    r, v = reading_table.c, voided_table.c
    columns = (r[name] for name in ("run", *ROW))
    signals = [signal_table.alias(f"signal_{k}") for k in range(len(names))]
    values = (one.c.value.label(name) for one, name in zip(signals, names, strict=True))
    query = sa.select(*columns, sa.func.coalesce(v.flag, "").label("voided"), *values)
    return query.select_from(_joined(signals, names)).where(r.test_id == test_id)


def _that_count(query: Any, serials: Sequence[str]) -> sa.Select[Any]:
    marked = sa.func.coalesce(voided_table.c.flag, "") != ""
    return query.where(~marked, reading_table.c.serial.in_(list(serials)))


def _frame(rows: Sequence[sa.Row[Any]], signals: Sequence[str] = ()) -> pd.DataFrame:
    names = ("run", *ROW, "voided", *signals)
    columns = dict(zip(names, zip(*rows, strict=True), strict=True)) if rows else {}
    kinds: dict[str, Any] = dict.fromkeys(names, np.int64)
    kinds |= dict.fromkeys((*QUANTITIES, *signals), np.float64) | dict.fromkeys(TEXTS, object)
    return pd.DataFrame({n: np.array(columns.get(n, ()), dtype=kinds[n]) for n in names})
