"""The queue of commands: what somebody asked of a test, who, when, and what came of it.

A command waits until whoever carries it out takes it; it ends done or refused, with a sentence.
Every one stays in the store: the queue is the history, too.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store.database import utc_now
from thermo.store.records import plain_text
from thermo.store.schema import command_arguments as argument_table
from thermo.store.schema import commands as command_table
from thermo.store.store import Store

Action: TypeAlias = Literal[
    "pause", "resume", "abort", "acknowledge", "plan", "arm", "withdraw", "start", "resume_test"
]
CommandState: TypeAlias = Literal["waiting", "taken", "done", "refused"]
Argument: TypeAlias = str | float | bool

OF_CONTROLLERS: tuple[Action, ...] = ("pause", "resume", "abort")
OF_THE_RUNNER: tuple[Action, ...] = ("start", "resume_test")


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A command and what became of it.

    Attributes
    ----------
    number : int
        In order of asking.
    asked_utc, who : str
    test_id : str or None
        None: it is not of a test that has begun.
    action : Action
    arguments : mapping
        Text, numbers and truth values by name.
    state : CommandState
    taken_utc, taken_by : str or None
    answered_utc : str or None
    outcome : str
        A sentence; empty before the answer.
    """

    number: int
    asked_utc: str
    who: str
    test_id: str | None
    action: Action
    arguments: Mapping[str, Argument]
    state: CommandState
    taken_utc: str | None
    taken_by: str | None
    answered_utc: str | None
    outcome: str

    @property
    def answered(self) -> bool:
        """True when nothing more will become of it."""
        return self.state in ("done", "refused")


def ask(
    store: Store,
    action: Action,
    *,
    who: str,
    test_id: str | None = None,
    arguments: Mapping[str, Argument] | None = None,
) -> int:
    """Enter a command that waits to be taken.

    Parameters
    ----------
    store : Store
    action : Action
    who : str
        Who asks.
    test_id : str, optional
        Of which test.
    arguments : mapping, optional
        Text, numbers and truth values by name.

    Returns
    -------
    int
        Its number.

    Raises
    ------
    StoreError
        If there is no such test, or the store refuses.
    """
    with store.changing() as connection:
        return enter(connection, action, who=who, test_id=test_id, arguments=arguments)


def enter(
    connection: sa.Connection,
    action: Action,
    *,
    who: str,
    test_id: str | None = None,
    arguments: Mapping[str, Argument] | None = None,
    outcome: str | None = None,
) -> int:
    """Do what `ask` does within a transaction; with an `outcome` it is done at once."""
    if not who.strip():
        raise StoreError(f"{action}: nobody asks it, expected a name")
    now = utc_now()
    values = {
        "asked_utc": now,
        "who": plain_text(who),
        "test_id": test_id,
        "action": action,
        "state": "waiting" if outcome is None else "done",
        "answered_utc": None if outcome is None else now,
        "outcome": plain_text(outcome or ""),
    }
    number = connection.execute(
        sa.insert(command_table).returning(command_table.c.id), [values]
    ).scalar_one()
    rows = [_argument_row(number, name, value) for name, value in (arguments or {}).items()]
    if rows:
        connection.execute(sa.insert(argument_table), rows)
    return int(number)


def take_next(
    store: Store, *, by: str, actions: Collection[Action], test_id: str | None = None
) -> Command | None:
    """Take the oldest command that waits; no two that ask get the same.

    Looking alone changes nothing, so that it may be done often.

    Parameters
    ----------
    store : Store
    by : str
        Who takes it.
    actions : collection of Action
        What is carried out by who asks.
    test_id : str, optional
        Of this test only.

    Returns
    -------
    Command or None
        None: none waits.
    """
    t = command_table.c
    waiting = [t.state == "waiting", t.action.in_(list(actions))]
    if test_id is not None:
        waiting.append(t.test_id == test_id)
    oldest = sa.select(t.id).where(*waiting).order_by(t.id).limit(1)
    with store.snapshot() as connection:
        if connection.execute(oldest).first() is None:
            return None
    with store.changing() as connection:
        number = connection.execute(oldest.with_for_update(skip_locked=True)).scalar()
        if number is None:
            return None
        connection.execute(
            sa.update(command_table)
            .where(t.id == number)
            .values(state="taken", taken_utc=utc_now(), taken_by=plain_text(by))
        )
        return _commands(connection, t.id == number)[0]


def answer(store: Store, number: int, state: Literal["done", "refused"], outcome: str) -> bool:
    """Say what became of a command; False when that had been said already.

    Parameters
    ----------
    store : Store
    number : int
    state : str
        "done" or "refused".
    outcome : str
        A sentence.
    """
    return _answer(store, command_table.c.id == number, ("waiting", "taken"), state, outcome) > 0


def withdraw(store: Store, number: int, outcome: str) -> bool:
    """Refuse a command that nobody has taken yet; False when somebody has."""
    return _answer(store, command_table.c.id == number, ("waiting",), "refused", outcome) > 0


def refuse_left(store: Store, test_id: str, outcome: str, *, before_utc: str | None = None) -> int:
    """Refuse what a test's controllers, which are gone, have not answered; return how many.

    Parameters
    ----------
    store : Store
    test_id, outcome : str
    before_utc : str, optional
        Only what was asked before this moment.
    """
    t = command_table.c
    which = sa.and_(t.test_id == test_id, t.action.in_(OF_CONTROLLERS))
    if before_utc is not None:
        which = sa.and_(which, t.asked_utc < before_utc)
    return _answer(store, which, ("waiting", "taken"), "refused", outcome)


def read_command(store: Store, number: int) -> Command:
    """Return a command.

    Raises
    ------
    StoreError
        If there is none of this number.
    """
    with store.snapshot() as connection:
        found = _commands(connection, command_table.c.id == number)
    if not found:
        raise StoreError(f"command {number}: there is none of this number")
    return found[0]


def list_commands(
    store: Store, test_id: str | None = None, *, newest: int | None = None
) -> tuple[Command, ...]:
    """Return commands, the oldest first: who asked for what, and what became of it.

    Parameters
    ----------
    store : Store
    test_id : str, optional
        Of this test only.
    newest : int, optional
        Only so many, the newest.
    """
    where = sa.true() if test_id is None else command_table.c.test_id == test_id
    with store.snapshot() as connection:
        return _commands(connection, where, newest)


# ---- parts of the above


def _answer(
    store: Store, which: sa.ColumnElement[bool], before: tuple[str, ...], state: str, outcome: str
) -> int:
    with store.changing() as connection:
        done = connection.execute(
            sa.update(command_table)
            .where(which, command_table.c.state.in_(before))
            .values(state=state, outcome=plain_text(outcome), answered_utc=utc_now())
        )
        return done.rowcount


def _argument_row(number: int, name: str, value: Argument) -> dict[str, Any]:
    row: dict[str, Any] = {"command_id": number, "name": name, "text": None, "number": None}
    if isinstance(value, bool):
        return row | {"kind": "truth", "number": float(value)}
    if isinstance(value, str):
        return row | {"kind": "text", "text": plain_text(value)}
    return row | {"kind": "number", "number": float(value)}


def _commands(
    connection: sa.Connection, where: sa.ColumnElement[bool], newest: int | None = None
) -> tuple[Command, ...]:
    t = command_table.c
    query = sa.select(command_table).where(where).order_by(t.id.desc()).limit(newest)
    found = list(reversed(connection.execute(query).mappings().all()))
    of = argument_table.c.command_id.in_([row["id"] for row in found])
    arguments: dict[int, dict[str, Argument]] = {}
    for one in connection.execute(sa.select(argument_table).where(of)):
        value: Argument = one.text if one.kind == "text" else float(one.number)
        value = bool(value) if one.kind == "truth" else value
        arguments.setdefault(one.command_id, {})[one.name] = value
    return tuple(
        Command(
            number=row["id"],
            arguments=arguments.get(row["id"], {}),
            **{str(name): value for name, value in row.items() if name != "id"},
        )
        for row in found
    )
