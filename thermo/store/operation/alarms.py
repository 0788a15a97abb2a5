"""Alarms: each stays until a person acknowledges it, and is told to who is to be told."""

from dataclasses import dataclass

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.changes import lock_test
from thermo.store.database import utc_now
from thermo.store.operation import commands
from thermo.store.operation.alarm_kinds import ALARM_KINDS, AlarmKind, Kind
from thermo.store.operation.notices import enter_notice
from thermo.store.records import plain_text
from thermo.store.schema import alarms as alarm_table
from thermo.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """An alarm.

    Attributes
    ----------
    number : int
    test_id : str or None
        None: of no test that has begun.
    kind : Kind
    text : str
        What happened the first time, a line.
    raised_utc, last_utc : str
        The first and the last time before it was acknowledged.
    times : int
    acknowledged_utc, acknowledged_by : str or None
        None: nobody has.
    """

    number: int
    test_id: str | None
    kind: Kind
    text: str
    raised_utc: str
    times: int
    last_utc: str
    acknowledged_utc: str | None
    acknowledged_by: str | None

    @property
    def about(self) -> AlarmKind:
        """Meaning and remedy of its kind."""
        return ALARM_KINDS[self.kind]

    @property
    def is_open(self) -> bool:
        """True as long as nobody has acknowledged it."""
        return self.acknowledged_utc is None


def raise_alarm(
    store: Store, kind: Kind, text: str, *, test_id: str | None = None, times: int = 1
) -> int:
    """Raise an alarm, with a notice of it.

    One that nobody has acknowledged is counted up instead, and nobody is told again.

    Parameters
    ----------
    store : Store
    kind : Kind
    text : str
        What happened, a line.
    test_id : str, optional
    times : int
        How often it happened.

    Returns
    -------
    int
        Its number.
    """
    t, now = alarm_table.c, utc_now()
    same = (t.kind == kind, t.test_id.is_not_distinct_from(test_id), t.acknowledged_utc.is_(None))
    with store.changing() as connection:
        if test_id is not None:
            lock_test(connection, test_id)  # two that raise the same one wait for each other
        open_one = connection.execute(
            sa.select(t.id, t.times).where(*same).order_by(t.id).with_for_update()
        ).first()
        if open_one is not None:
            changed = {"times": open_one.times + times, "last_utc": now}
            connection.execute(sa.update(alarm_table).where(t.id == open_one.id).values(changed))
            return int(open_one.id)
        values = {
            "test_id": test_id,
            "kind": kind,
            "text": plain_text(text),
            "raised_utc": now,
            "times": times,
            "last_utc": now,
        }
        number = connection.execute(sa.insert(alarm_table).returning(t.id), [values]).scalar_one()
        about = ALARM_KINDS[kind]
        told = f"{about.title}{f', test {test_id}' if test_id else ''}: {text}. {about.remedy}"
        enter_notice(connection, kind, told, alarm=number)
        return int(number)


def acknowledge(store: Store, number: int, *, who: str) -> bool:
    """Acknowledge an alarm; False when somebody has already. Who and when is kept for good.

    Raises
    ------
    StoreError
        If there is none of this number.
    """
    t = alarm_table.c
    with store.changing() as connection:
        found = connection.execute(
            sa.select(t.test_id, t.kind, t.acknowledged_utc).where(t.id == number).with_for_update()
        ).first()
        if found is None:
            raise StoreError(f"alarm {number}: there is none of this number")
        if found.acknowledged_utc is not None:
            return False
        connection.execute(
            sa.update(alarm_table)
            .where(t.id == number)
            .values(acknowledged_utc=utc_now(), acknowledged_by=plain_text(who))
        )
        commands.enter(
            connection,
            "acknowledge",
            who=who,
            test_id=found.test_id,
            arguments={"alarm": float(number)},
            outcome=f"alarm {number}, {found.kind}: acknowledged",
        )
    return True


def list_alarms(
    store: Store, test_id: str | None = None, *, open_only: bool = False
) -> tuple[Alarm, ...]:
    """Return alarms, the oldest first.

    Parameters
    ----------
    store : Store
    test_id : str, optional
        Of this test only.
    open_only : bool
        Leave out those that somebody has acknowledged.
    """
    t = alarm_table.c
    query = sa.select(alarm_table).order_by(t.id)
    if test_id is not None:
        query = query.where(t.test_id == test_id)
    if open_only:
        query = query.where(t.acknowledged_utc.is_(None))
    with store.snapshot() as connection:
        found = connection.execute(query).mappings().all()
    return tuple(
        Alarm(number=row["id"], **{str(n): v for n, v in row.items() if n != "id"}) for row in found
    )
