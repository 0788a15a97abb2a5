"""The tables. What is only ever added, or kept for good, the database itself guards.

Version 2 added `signals` and `schedule_marks`; before it marks were events, see
`thermo.store.migration`. Version 3 added what people ask of tests and are told of them, used in
`thermo.store.operation`.
"""

from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

SCHEMA_VERSION = 3

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

# ---- what people ask of tests, and what they are told

commands = sa.Table(
    "commands",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("asked_utc", sa.String, nullable=False),
    sa.Column("who", sa.String, nullable=False),
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id"), index=True),
    sa.Column("action", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False, index=True),
    sa.Column("taken_utc", sa.String),
    sa.Column("taken_by", sa.String),
    sa.Column("answered_utc", sa.String),
    sa.Column("outcome", sa.Text, nullable=False),
)

command_arguments = sa.Table(
    "command_arguments",
    metadata,
    sa.Column("command_id", sa.Integer, sa.ForeignKey("commands.id"), primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("text", sa.Text),
    sa.Column("number", sa.Double),
)

controllers = sa.Table(
    "controllers",
    metadata,
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id"), primary_key=True),
    sa.Column("host", sa.String, nullable=False),
    sa.Column("pid", sa.Integer, nullable=False),
    sa.Column("pid_start", sa.BigInteger),
    sa.Column("began_utc", sa.String, nullable=False),
    sa.Column("beat_utc", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False),
    sa.Column("phase", sa.String, nullable=False),
    sa.Column("run", sa.Integer, nullable=False),
    sa.Column("runs", sa.Integer, nullable=False),
    sa.Column("slot", sa.Integer, nullable=False),
    sa.Column("slots", sa.Integer, nullable=False),
    sa.Column("segment", sa.Integer, nullable=False),
    sa.Column("time_s", sa.Double, nullable=False),
    sa.Column("left_s", sa.Double, nullable=False),
    sa.Column("end_utc", sa.String),
    sa.Column("speed", sa.Double),
    sa.Column("commanded_c", sa.Double),
    sa.Column("chamber_c", sa.Double),
    sa.Column("position_deg", sa.Double),
    sa.Column("lateness_s", sa.Double),
    sa.Column("max_lateness_s", sa.Double),
    sa.Column("link", sa.Text, nullable=False),
    sa.Column("guardian", sa.Text, nullable=False),
    sa.Column("store", sa.Text, nullable=False),
    sa.Column("last_fault", sa.Text, nullable=False),
)

planned_tests = sa.Table(
    "planned_tests",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("planned_utc", sa.String, nullable=False),
    sa.Column("planned_by", sa.String, nullable=False),
    sa.Column("name", sa.String, nullable=False),
    sa.Column("sequence_toml", sa.Text, nullable=False),
    sa.Column("station_json", sa.Text),
    sa.Column("speed", sa.Double),
    sa.Column("after_id", sa.Integer, sa.ForeignKey("planned_tests.id")),
    sa.Column("state", sa.String, nullable=False, index=True),
    sa.Column("armed_utc", sa.String),
    sa.Column("armed_by", sa.String),
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id")),
    sa.Column("changed_utc", sa.String, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
)

alarms = sa.Table(
    "alarms",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("test_id", sa.String, sa.ForeignKey("tests.id"), index=True),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("text", sa.Text, nullable=False),
    sa.Column("raised_utc", sa.String, nullable=False),
    sa.Column("times", sa.Integer, nullable=False),
    sa.Column("last_utc", sa.String, nullable=False),
    sa.Column("acknowledged_utc", sa.String),
    sa.Column("acknowledged_by", sa.String),
)

notices = sa.Table(
    "notices",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("alarm_id", sa.Integer, sa.ForeignKey("alarms.id")),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("text", sa.Text, nullable=False),
    sa.Column("entered_utc", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False, index=True),
    sa.Column("tries", sa.Integer, nullable=False),
    sa.Column("next_utc", sa.String, nullable=False),
    sa.Column("delivered", sa.Text, nullable=False),
    sa.Column("last_error", sa.Text, nullable=False),
    sa.Column("sent_utc", sa.String),
)

# the tables that each version added
ADDED = {
    2: (schedule_marks, signals),
    3: (commands, command_arguments, controllers, planned_tests, alarms, notices),
}

_ADD_ONLY = ("readings", "signals", "voided", "events", "schedule_marks", "command_arguments")
# rows that stay for good, and the columns of them that never change
_KEPT = {
    "commands": ("id", "asked_utc", "who", "test_id", "action"),
    "planned_tests": ("id", "planned_utc", "planned_by", "sequence_toml", "station_json"),
    "alarms": ("id", "test_id", "kind", "text", "raised_utc"),
    "notices": ("id", "alarm_id", "kind", "text", "entered_utc"),
}


def _guard(table: sa.Table, columns: tuple[str, ...] = ()) -> None:
    """Have the database refuse to delete rows, and to change them or these columns of them."""
    refusal = f"{table.name} are only added, never changed"
    if columns:
        refusal = f"{table.name} are kept for good, {', '.join(columns)} as they were entered"
    update = f"UPDATE OF {', '.join(columns)}" if columns else "UPDATE"
    for name, action in (("update", update), ("delete", "DELETE")):
        trigger = sa.DDL(
            f"CREATE TRIGGER {table.name}_no_{name} BEFORE {action} ON {table.name} "
            f"BEGIN SELECT RAISE(ABORT, '{refusal}'); END"
        )
        event.listen(table, "after_create", trigger.execute_if(dialect="sqlite"))
    function = sa.DDL(
        f"CREATE FUNCTION {table.name}_add_only() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{refusal}'; END $$"
    )
    trigger = sa.DDL(
        f"CREATE TRIGGER {table.name}_add_only BEFORE {update} OR DELETE OR TRUNCATE ON "
        f"{table.name} FOR EACH STATEMENT EXECUTE FUNCTION {table.name}_add_only()"
    )
    for ddl in (function, trigger):
        event.listen(table, "after_create", ddl.execute_if(dialect="postgresql"))


for _name in _ADD_ONLY:
    _guard(metadata.tables[_name])
for _name, _columns in _KEPT.items():
    _guard(metadata.tables[_name], _columns)
