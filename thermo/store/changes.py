"""The store's changes to its database, each inside a transaction that the caller began."""

from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.store import queries, schema
from thermo.store.database import utc_now
from thermo.store.records import signal_values
from thermo.store.schema import readings as reading_table
from thermo.store.schema import runs as run_table
from thermo.store.schema import signals as signal_table
from thermo.store.schema import tests as test_table


def set_run_status(connection: sa.Connection, test_id: str, number: int, status: str) -> None:
    """Change a run's status."""
    connection.execute(
        sa.update(run_table)
        .where(run_table.c.test_id == test_id, run_table.c.number == int(number))
        .values(status=status)
    )


def end_open_runs(connection: sa.Connection, test_id: str, status: str) -> None:
    """Give the runs of a test that are still running the status it ended with."""
    connection.execute(
        sa.update(run_table)
        .where(run_table.c.test_id == test_id, run_table.c.status == "running")
        .values(status=status)
    )


def lock_test(connection: sa.Connection, test_id: str) -> None:
    """Keep others from adding to a test until the transaction ends (SQLite has one writer anyway).

    Rows that refer to a test share-lock it, so this also waits for those that are on their way.
    """
    connection.execute(
        sa.select(test_table.c.id).where(test_table.c.id == test_id).with_for_update()
    )


def insert_once(connection: sa.Connection, table: sa.Table, values: Mapping[str, Any]) -> None:
    """Add a row of a test unless it is there in every value."""
    # whoever else adds a row of this test, perhaps the same one, waits here
    lock_test(connection, values["test_id"])
    if not queries.has_row(connection, table, values):
        connection.execute(sa.insert(table), [dict(values)])


def begin_run(connection: sa.Connection, values: Mapping[str, Any]) -> None:
    """Enter a run; one that was entered before keeps its start and is running again.

    Raises
    ------
    StoreError
        If it is finished, or there is no such test.
    """
    test_id, number = values["test_id"], values["number"]
    status = queries.run_status(connection, test_id, number)
    if status == "finished":
        raise StoreError(f"test {test_id} run {number}: is finished")
    if status is not None:
        set_run_status(connection, test_id, number, "running")
        return
    queries.need_test(connection, test_id)
    connection.execute(sa.insert(run_table), [dict(values)])


def finish_run(connection: sa.Connection, test_id: str, run: int, status: str) -> None:
    """Give a run the status it ended with.

    Raises
    ------
    StoreError
        If it has not begun, or is finished and that is not its status.
    """
    old = queries.run_status(connection, test_id, run)
    if old is None:
        raise StoreError(f"test {test_id} run {run}: has not begun")
    if old == "finished" != status:
        raise StoreError(f"test {test_id} run {run}: is finished already")
    set_run_status(connection, test_id, run, status)


def finish_test(connection: sa.Connection, test_id: str, ending: Mapping[str, str]) -> None:
    """Enter how a test ended: its columns status, outcome and safe_result_json.

    Raises
    ------
    StoreError
        If it is finished already, in another way.
    """
    old = queries.need_test(connection, test_id)
    if old["status"] == "finished" and any(old[k] != v for k, v in ending.items()):
        raise StoreError(f"test {test_id}: is finished already")
    connection.execute(sa.update(test_table).where(test_table.c.id == test_id).values(ending))
    if ending["status"] != "finished":
        end_open_runs(connection, test_id, ending["status"])


def reopen_test(connection: sa.Connection, test_id: str) -> None:
    """Mark a test as running again.

    Raises
    ------
    StoreError
        If it is finished.
    """
    if queries.need_test(connection, test_id)["status"] == "finished":
        raise StoreError(f"test {test_id}: is finished and cannot be resumed")
    connection.execute(
        sa.update(test_table)
        .where(test_table.c.id == test_id)
        .values(status="running", outcome="", safe_result_json="")
    )


def void_attempts(
    connection: sa.Connection,
    test_id: str,
    run: int,
    segment: int,
    flag: str,
    attempt: int | None,
) -> int:
    """Void the attempts at a segment so far, or one of them; return the number of the next."""
    made = queries.attempts(connection, test_id, run, segment)
    old = queries.voided_attempts(connection, test_id, run, segment)
    chosen = (made if attempt is None else {attempt}) - old
    mark = {
        "test_id": test_id,
        "run": int(run),
        "segment": int(segment),
        "flag": flag,
        "created_utc": utc_now(),
    }
    if chosen:
        rows = [mark | {"attempt": number} for number in sorted(chosen)]
        connection.execute(sa.insert(schema.voided), rows)
    return max(made | old | chosen, default=0) + 1


_INSERT_READINGS = sa.insert(reading_table)


def insert_readings(connection: sa.Connection, values: Sequence[Mapping[str, Any]]) -> None:
    """Add readings; their signals stand in a table of their own."""
    plain = [{n: v for n, v in value.items() if n != "signals"} for value in values]
    connection.execute(_INSERT_READINGS, plain)
    signals = [one for value in values for one in signal_values(value)]
    if signals:
        connection.execute(sa.insert(signal_table), signals)
