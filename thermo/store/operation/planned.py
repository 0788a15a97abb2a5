"""Planned tests: what is to be run, armed by a person, started by the runner.

::

    planned ── arm ──> armed ── start ──> starting ──> running ──> finished
       ^                 |                    |           ├──────> interrupted
       └──── refused <───┴────────────────────┘           └──────> failed

A planned test that is over never starts again: its test is resumed, or it is planned anew.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.database import utc_now
from thermo.store.operation import commands
from thermo.store.records import plain_text
from thermo.store.schema import planned_tests as planned_table
from thermo.store.store import Store

PlannedState: TypeAlias = Literal[
    "planned", "armed", "starting", "running", "finished", "interrupted", "failed", "refused",
    "withdrawn",
]  # fmt: skip
BEFORE_START: tuple[PlannedState, ...] = ("planned", "armed", "refused")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTest:
    """A planned test.

    Attributes
    ----------
    number : int
    planned_utc, planned_by, name : str
    sequence_toml : str
    station_json : str or None
        None: on the emulated station that goes with the sequence.
    speed : float or None
        Multiple of real time, of emulated instruments.
    after_id : int or None
        The planned test after whose good end it starts by itself, once armed; None: by hand only.
    state : PlannedState
    armed_utc, armed_by : str or None
    test_id : str or None
        Once it has begun.
    changed_utc : str
        When the state changed last.
    outcome : str
        Why it is as it is, a sentence.
    """

    number: int
    planned_utc: str
    planned_by: str
    name: str
    sequence_toml: str
    station_json: str | None
    speed: float | None
    after_id: int | None
    state: PlannedState
    armed_utc: str | None
    armed_by: str | None
    test_id: str | None
    changed_utc: str
    outcome: str


def plan_test(
    store: Store,
    *,
    name: str,
    sequence_toml: str,
    station_json: str | None = None,
    speed: float | None = None,
    after: int | None = None,
    who: str,
) -> int:
    """Enter a planned test; nothing starts before it is armed.

    Parameters
    ----------
    store : Store
    name, sequence_toml : str
    station_json : str, optional
        The emulated station that goes with the sequence if not given.
    speed : float, optional
        Of emulated instruments; as fast as can be if not given.
    after : int, optional
        The planned test after whose good end it starts by itself, once armed.
    who : str

    Returns
    -------
    int
        Its number.

    Raises
    ------
    StoreError
        If there is no planned test `after`, or that one will never come to a good end.
    """
    now, t = utc_now(), planned_table.c
    values = {
        "planned_utc": now,
        "planned_by": plain_text(who),
        "name": plain_text(name),
        "sequence_toml": plain_text(sequence_toml),
        "station_json": station_json,
        "speed": speed,
        "after_id": after,
        "state": "planned",
        "changed_utc": now,
        "outcome": "",
    }
    with store.changing() as connection:
        if after is not None:
            before = _need(connection, after)
            if before.state in ("interrupted", "failed", "withdrawn"):
                raise StoreError(f"planned test {after}: is {before.state}, none follows it")
        query = sa.insert(planned_table).returning(t.id)
        number = int(connection.execute(query, [values]).scalar_one())
        _enter(connection, "plan", number, who, f"planned test {number}: {name}")
    return number


def arm_test(store: Store, number: int, *, who: str) -> None:
    """Arm a planned test: from now on it may be started.

    Raises
    ------
    StoreError
        If there is none, or it has been started already.
    """
    with store.changing() as connection:
        _move(connection, number, BEFORE_START, "armed", "", armed_utc=utc_now(), armed_by=who)
        _enter(connection, "arm", number, who, f"planned test {number}: armed")


def withdraw_test(store: Store, number: int, *, who: str) -> None:
    """Take a planned test that has not been started out of the queue.

    Raises
    ------
    StoreError
        If there is none, or it has been started already.
    """
    with store.changing() as connection:
        _move(connection, number, BEFORE_START, "withdrawn", f"withdrawn by {who}")
        _enter(connection, "withdraw", number, who, f"planned test {number}: withdrawn")


def begin_starting(store: Store, number: int) -> PlannedTest:
    """Take an armed test for starting; no two that ask get the same.

    Raises
    ------
    StoreError
        If it is not armed.
    """
    with store.changing() as connection:
        _move(connection, number, ("armed",), "starting", "")
        return _need(connection, number)


def has_begun(store: Store, number: int, test_id: str) -> None:
    """Say that a planned test runs, and as which test."""
    with store.changing() as connection:
        _move(connection, number, ("starting",), "running", "", test_id=test_id)


def refuse_start(store: Store, number: int, outcome: str) -> None:
    """Say why a planned test did not begin; it has to be armed anew."""
    with store.changing() as connection:
        _move(connection, number, ("armed", "starting"), "refused", outcome)


def end_planned(store: Store, number: int, state: PlannedState, outcome: str) -> None:
    """Say how a planned test that ran has ended; of one that was resumed, how it ended then."""
    over: tuple[PlannedState, ...] = ("starting", "running", "interrupted", "failed")
    with store.changing() as connection:
        _move(connection, number, over, state, outcome)


def list_planned(store: Store, *, open_only: bool = False) -> tuple[PlannedTest, ...]:
    """Return planned tests in order of planning.

    Parameters
    ----------
    store : Store
    open_only : bool
        Leave out those that are over.
    """
    still = (*BEFORE_START, "starting", "running")
    where = planned_table.c.state.in_(still) if open_only else sa.true()
    with store.snapshot() as connection:
        return _planned(connection, where)


def read_planned(store: Store, number: int) -> PlannedTest:
    """Return a planned test.

    Raises
    ------
    StoreError
        If there is none of this number.
    """
    with store.snapshot() as connection:
        return _need(connection, number)


# ---- parts of the above


def _enter(
    connection: sa.Connection, action: commands.Action, number: int, who: str, outcome: str
) -> None:
    commands.enter(
        connection, action, who=who, arguments={"planned": float(number)}, outcome=outcome
    )


def _need(connection: sa.Connection, number: int) -> PlannedTest:
    found = _planned(connection, planned_table.c.id == number)
    if not found:
        raise StoreError(f"planned test {number}: there is none of this number")
    return found[0]


def _move(
    connection: sa.Connection,
    number: int,
    before: tuple[PlannedState, ...],
    state: PlannedState,
    outcome: str,
    **more: str,
) -> None:
    t = planned_table.c
    changed = {"state": state, "outcome": plain_text(outcome), "changed_utc": utc_now(), **more}
    done = connection.execute(
        sa.update(planned_table).where(t.id == number, t.state.in_(before)).values(changed)
    )
    if done.rowcount == 0:
        now = _need(connection, number).state
        raise StoreError(f"planned test {number}: is {now}, expected {' or '.join(before)}")


def _planned(connection: sa.Connection, where: sa.ColumnElement[bool]) -> tuple[PlannedTest, ...]:
    query = sa.select(planned_table).where(where).order_by(planned_table.c.id)
    return tuple(
        PlannedTest(number=row["id"], **{str(n): v for n, v in row.items() if n != "id"})
        for row in connection.execute(query).mappings().all()
    )
