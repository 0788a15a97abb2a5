"""The tables. What is only ever added (`_ADD_ONLY`) the database itself refuses to change.

Version 2 added `signals` and `schedule_marks`; before it marks were events, see
`thermo.store.migration`.
"""

from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

SCHEMA_VERSION = 2

metadata = sa.MetaData()

schema_version = sa.Table(
    "schema_version",
    metadata,
    sa.Column("version", sa.Integer, primary_key=True),
    sa.Column("created_utc", sa.String, nullable=False),
)

tests = sa.Table(
    "tests",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("created_utc", sa.String, nullable=False),
    sa.Column("name", sa.String, nullable=False),
    sa.Column("sequence_toml", sa.Text, nullable=False),
    sa.Column("station_json", sa.Text, nullable=False),
    sa.Column("versions_json", sa.Text, nullable=False),
    sa.Column("settings_json", sa.Text, nullable=False),
    sa.Column("status", sa.String, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
    sa.Column("safe_result_json", sa.Text, nullable=False),
)

runs = sa.Table(
    "runs",
    metadata,
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("start_utc", sa.String, nullable=False),
    sa.Column("start_clock_s", sa.Double),
    sa.Column("status", sa.String, nullable=False),
)


def _reading_key() -> tuple[sa.Column[Any], ...]:
    """Return the columns that tell a reading from all others."""
    return (
        sa.Column("test_id", sa.String, primary_key=True),
        sa.Column("run", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("slot", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("attempt", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("serial", sa.String, primary_key=True),
    )


readings = sa.Table(
    "readings",
    metadata,
    *_reading_key(),
    sa.Column("segment", sa.Integer, nullable=False),
    sa.Column("time_s", sa.Double, nullable=False),
    sa.Column("temp_c", sa.Double),
    sa.Column("position_deg", sa.Double),
    sa.Column("output", sa.Double),
    sa.Column("chamber_c", sa.Double),
    sa.Column("lateness_s", sa.Double),
    sa.Column("flag", sa.String, nullable=False),
    sa.ForeignKeyConstraint(["test_id", "run"], ["runs.test_id", "runs.number"]),
    sqlite_with_rowid=False,  # the key's order is the order of arrival: appended, not inserted
)

# signals recorded beside the quantities of every reading
signals = sa.Table(
    "signals",
    metadata,
    *_reading_key(),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("value", sa.Double, nullable=False),
    sa.ForeignKeyConstraint(["test_id", "run"], ["runs.test_id", "runs.number"]),
    sqlite_with_rowid=False,
)

voided = sa.Table(
    "voided",
    metadata,
    sa.Column("test_id", sa.String, primary_key=True),
    sa.Column("run", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("segment", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("attempt", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("flag", sa.String, nullable=False),
    sa.Column("created_utc", sa.String, nullable=False),
    sa.ForeignKeyConstraint(["test_id", "run"], ["runs.test_id", "runs.number"]),
)

events = sa.Table(
    "events",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id"), nullable=False, index=True),
    sa.Column("run", sa.Integer),
    sa.Column("time_s", sa.Double),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("text", sa.Text, nullable=False),
    sa.Column("logged_utc", sa.String, nullable=False),
)

schedule_marks = sa.Table(
    "schedule_marks",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("test_id", sa.String, nullable=False),
    sa.Column("run", sa.Integer, nullable=False),
    sa.Column("start_clock_s", sa.Double, nullable=False),
    sa.Column("shift_s", sa.Double, nullable=False),
    sa.Column("segment", sa.Integer, nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("clock", sa.String, nullable=False),
    sa.Column("logged_utc", sa.String, nullable=False),
    sa.ForeignKeyConstraint(["test_id", "run"], ["runs.test_id", "runs.number"]),
    sa.Index("schedule_marks_of_run", "test_id", "run"),
)

_ADD_ONLY = ("readings", "signals", "voided", "events", "schedule_marks")


def _guard(table: sa.Table) -> None:
    refusal = f"{table.name} are only added, never changed"
    for action in ("UPDATE", "DELETE"):
        trigger = sa.DDL(
            f"CREATE TRIGGER {table.name}_no_{action.lower()} BEFORE {action} ON {table.name} "
            f"BEGIN SELECT RAISE(ABORT, '{refusal}'); END"
        )
        event.listen(table, "after_create", trigger.execute_if(dialect="sqlite"))
    function = sa.DDL(
        f"CREATE FUNCTION {table.name}_add_only() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{refusal}'; END $$"
    )
    trigger = sa.DDL(
        f"CREATE TRIGGER {table.name}_add_only BEFORE UPDATE OR DELETE OR TRUNCATE ON "
        f"{table.name} FOR EACH STATEMENT EXECUTE FUNCTION {table.name}_add_only()"
    )
    for ddl in (function, trigger):
        event.listen(table, "after_create", ddl.execute_if(dialect="postgresql"))


for _name in _ADD_ONLY:
    _guard(metadata.tables[_name])
