"""Notices: what is to be told to people elsewhere, kept until it has been.

A sender takes a notice by putting its next try off: one that dies while it sends leaves the notice
to be tried again.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal, TypeAlias

import sqlalchemy as sa

from thermo.store.database import utc_now
from thermo.store.records import plain_text
from thermo.store.schema import notices as notice_table
from thermo.store.store import Store

NoticeState: TypeAlias = Literal["waiting", "sent", "unwanted", "expired"]

LEASE_S = 60.0  # for one try; a sender that has not come back by then is dead
LONGEST_S = 30.0  # between two tries
KEEP_DAYS = 7.0  # tried for so long; then it is news to nobody


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """A notice.

    Attributes
    ----------
    number : int
    alarm_id : int or None
        What it is about; None: a trial.
    kind, text : str
    entered_utc : str
    state : NoticeState
        "unwanted": of a kind that nobody is told of. "expired": it could not be sent for days.
    tries : int
    next_utc : str
        When it may be tried again.
    delivered : frozenset of str
        The receivers that have it, by a digest of their address.
    last_error : str
    sent_utc : str or None
    """

    number: int
    alarm_id: int | None
    kind: str
    text: str
    entered_utc: str
    state: NoticeState
    tries: int
    next_utc: str
    delivered: frozenset[str]
    last_error: str
    sent_utc: str | None


def enter_notice(
    connection: sa.Connection, kind: str, text: str, *, alarm: int | None = None
) -> int:
    """Enter a notice that waits, within the transaction of what it tells of."""
    now = utc_now()
    values = {
        "alarm_id": alarm,
        "kind": kind,
        "text": plain_text(text),
        "entered_utc": now,
        "state": "waiting",
        "tries": 0,
        "next_utc": now,
        "delivered": "",
        "last_error": "",
    }
    query = sa.insert(notice_table).returning(notice_table.c.id)
    return int(connection.execute(query, [values]).scalar_one())


def take_notice(store: Store) -> Notice | None:
    """Take the oldest notice whose time has come, for one try; None: there is none."""
    t = notice_table.c
    due = sa.select(t.id).where(t.state == "waiting", t.next_utc <= utc_now())
    due = due.order_by(t.id).limit(1)
    with store.snapshot() as connection:
        if connection.execute(due).first() is None:
            return None
    with store.changing() as connection:
        number = connection.execute(due.with_for_update(skip_locked=True)).scalar()
        if number is None:
            return None
        connection.execute(
            sa.update(notice_table)
            .where(t.id == number)
            .values(tries=t.tries + 1, next_utc=_later(LEASE_S))
        )
        return _notices(connection, t.id == number)[0]


def sent(store: Store, notice: Notice, delivered: frozenset[str]) -> None:
    """Say that every receiver has a notice."""
    _change(store, notice, state="sent", delivered=delivered, sent_utc=utc_now())


def not_sent(store: Store, notice: Notice, delivered: frozenset[str], error: str) -> None:
    """Say that some receiver has not got it; it is tried again, later each time."""
    entered = datetime.fromisoformat(notice.entered_utc)
    old = datetime.now(UTC) - entered > timedelta(days=KEEP_DAYS)
    wait_s = min(LONGEST_S, 2.0 ** min(notice.tries - 1, 10))
    _change(
        store,
        notice,
        state="expired" if old else "waiting",
        delivered=delivered,
        last_error=plain_text(error),
        next_utc=_later(wait_s),
    )


def unwanted(store: Store, notice: Notice) -> None:
    """Say that nobody is to be told of this kind."""
    _change(store, notice, state="unwanted", delivered=notice.delivered)


def list_notices(store: Store, *, waiting_only: bool = False) -> tuple[Notice, ...]:
    """Return notices, the oldest first.

    Parameters
    ----------
    store : Store
    waiting_only : bool
        Only those that have still to be sent.
    """
    where = notice_table.c.state == "waiting" if waiting_only else sa.true()
    with store.snapshot() as connection:
        return _notices(connection, where)


def _later(wait_s: float) -> str:
    return (datetime.now(UTC) + timedelta(seconds=wait_s)).isoformat(timespec="microseconds")


def _change(store: Store, notice: Notice, *, delivered: frozenset[str], **values: object) -> None:
    values["delivered"] = " ".join(sorted(delivered))
    with store.changing() as connection:
        connection.execute(
            sa.update(notice_table).where(notice_table.c.id == notice.number).values(values)
        )


def _notices(connection: sa.Connection, where: sa.ColumnElement[bool]) -> tuple[Notice, ...]:
    query = sa.select(notice_table).where(where).order_by(notice_table.c.id)
    return tuple(
        Notice(
            number=row["id"],
            delivered=frozenset(row["delivered"].split()),
            **{str(n): v for n, v in row.items() if n not in ("id", "delivered")},
        )
        for row in connection.execute(query).mappings().all()
    )
