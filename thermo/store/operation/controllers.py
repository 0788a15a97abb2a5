"""Heartbeats of controllers: one row a test, written anew about once a second while it runs."""

from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from typing import Literal, TypeAlias

import sqlalchemy as sa

from thermo.store.schema import controllers as controller_table
from thermo.store.store import Store

SILENT_S = 4.0  # without a beat, of which there is one a second; then it is called silent

ControllerState: TypeAlias = Literal["running", "ended"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerBeat:
    """State of a test as its controller told it last.

    Attributes
    ----------
    test_id : str
    host, pid, pid_start : str, int, int or None
        The process; the last is its beginning, in clock ticks since boot.
    began_utc, beat_utc : str
        When this sitting began, and when it told this.
    state : str
        "running", or "ended" when it said so itself.
    phase : str
        "approach", "soak", "run", "pause", "resoak", "rest" or "clean-up".
    run, runs, slot, slots, segment : int
    time_s, left_s : float
        From the run's start, and to the test's expected end, s on the test's clock.
    end_utc : str or None
        When it is expected to end; None: the clock has no rate.
    speed : float or None
        Multiple of real time; None: as fast as can be.
    commanded_c, chamber_c, position_deg : float or None
    lateness_s, max_lateness_s : float or None
        Of the newest scan, and the largest of the sitting, s on the test's clock.
    link, guardian, store : str
        How instruments, guardian and store are, in words.
    last_fault : str
        Empty: none.
    """

    test_id: str
    host: str
    pid: int
    pid_start: int | None
    began_utc: str
    beat_utc: str
    state: ControllerState = "running"
    phase: str = ""
    run: int = 0
    runs: int = 0
    slot: int = 0
    slots: int = 0
    segment: int = 0
    time_s: float = 0.0
    left_s: float = 0.0
    end_utc: str | None = None
    speed: float | None = None
    commanded_c: float | None = None
    chamber_c: float | None = None
    position_deg: float | None = None
    lateness_s: float | None = None
    max_lateness_s: float | None = None
    link: str = ""
    guardian: str = ""
    store: str = ""
    last_fault: str = ""

    @property
    def age_s(self) -> float:
        """Real seconds since it was told, by the wall clocks."""
        return (datetime.now(UTC) - datetime.fromisoformat(self.beat_utc)).total_seconds()

    @property
    def is_silent(self) -> bool:
        """True when it says that it runs and has not been heard for too long."""
        return self.state == "running" and self.age_s > SILENT_S


_NAMES = tuple(f.name for f in fields(ControllerBeat))


def write_beat(store: Store, beat: ControllerBeat) -> None:
    """Enter a beat in the place of the test's one before."""
    values = asdict(beat)
    with store.changing() as connection:
        done = connection.execute(
            sa.update(controller_table)
            .where(controller_table.c.test_id == beat.test_id)
            .values(values)
        )
        if done.rowcount == 0:
            connection.execute(sa.insert(controller_table), [values])


def read_beat(store: Store, test_id: str) -> ControllerBeat | None:
    """Return a test's last beat; None: no controller has ever told of it."""
    return next(iter(_beats(store, controller_table.c.test_id == test_id)), None)


def list_beats(store: Store, *, running_only: bool = False) -> tuple[ControllerBeat, ...]:
    """Return every test's last beat, the oldest sitting first.

    Parameters
    ----------
    store : Store
    running_only : bool
        Leave out those that have ended.
    """
    return _beats(store, controller_table.c.state == "running" if running_only else sa.true())


def end_beat(store: Store, beat: ControllerBeat) -> bool:
    """Call a controller that is gone ended; False when it, or its successor, has beaten since."""
    t = controller_table.c
    with store.changing() as connection:
        done = connection.execute(
            sa.update(controller_table)
            .where(t.test_id == beat.test_id, t.beat_utc == beat.beat_utc, t.state == "running")
            .values(state="ended")
        )
        return done.rowcount > 0


def _beats(store: Store, where: sa.ColumnElement[bool]) -> tuple[ControllerBeat, ...]:
    query = sa.select(controller_table).where(where).order_by(controller_table.c.began_utc)
    with store.snapshot() as connection:
        found = connection.execute(query).mappings().all()
    return tuple(ControllerBeat(**{name: row[name] for name in _NAMES}) for row in found)
