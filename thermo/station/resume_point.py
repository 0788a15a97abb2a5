"""Point at which an interrupted test is resumed, from its store alone."""

from collections.abc import Sequence as Many
from dataclasses import dataclass
from datetime import UTC, datetime

from drivers.clock import Clock
from drivers.opening import Station
from errormodel.errors import StoreError
from thermo.planning.plan import Plan
from thermo.station.journal import clock_identity
from thermo.store.records import ScheduleMark
from thermo.store.store import Store

# kinds of events for a commanded chamber and for a safe chamber
COMMANDED = frozenset(
    ("approach", "power off", "segment", "resoak", "gap", "pause", "not safe", "guardian: not safe")
)
SAFE = frozenset(("safe", "guardian"))
NEAR_C = 0.5  # a controller rounds its set points to less


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumePoint:
    """The point of a test at which it is resumed.

    Attributes
    ----------
    run : int
        The run; one that has not begun yet when `start_s` is None.
    start_s : float or None
        When that run began, s on the present clock.
    shift_s : float
        Delay of its schedule, s.
    slot, segment, attempt : int
        The next reading.
    mid_segment : bool
        True if the schedule was at `slot`; otherwise `segment` was about to be repeated.
    last_time_s : float
        Of the run's last reading, s from its start.
    """

    run: int
    start_s: float | None = None
    shift_s: float = 0.0
    slot: int = 0
    segment: int = 0
    attempt: int = 1
    mid_segment: bool = False
    last_time_s: float = 0.0


def find_resume_point(store: Store, test_id: str, plan: Plan, clock: Clock) -> ResumePoint | None:
    """Return the resume point of a test.

    Returns
    -------
    ResumePoint or None
        None when every run is finished and only the test's own end is missing.

    Raises
    ------
    StoreError
        If the test is finished, or the store does not know it.
    """
    record = store.test(test_id)
    if record.status == "finished":
        raise StoreError(f"test {test_id}: is finished; only an interrupted one can be resumed")
    begun = {run.number: run for run in record.runs}
    for number in range(1, plan.runs + 1):
        if number not in begun:
            return ResumePoint(run=number)
        if begun[number].status != "finished":
            return _within_run(store, test_id, plan, clock, number)
    return None


def _within_run(store: Store, test_id: str, plan: Plan, clock: Clock, number: int) -> ResumePoint:
    last = store.last_reading(test_id, number)
    mark = store.last_schedule_mark(test_id, number)
    if mark is None:  # interrupted between its beginning and its first event
        return ResumePoint(run=number, start_s=clock.now_s())
    record = next(run for run in store.test(test_id).runs if run.number == number)
    last_s = last.time_s if last else 0.0
    slot, segment, attempt, mid_segment = 0, mark.segment, mark.attempt, False
    if last is not None and (last.segment, last.attempt) >= (mark.segment, mark.attempt):
        slot, mid_segment = last.slot + 1, True
        segment, attempt = last.segment, last.attempt
        if slot < plan.slots and (after := int(plan.run(number).segment[slot])) != segment:
            segment, attempt = after, 1
    return ResumePoint(
        run=number,
        start_s=_start_s(plan, clock, mark, record.start_utc, last_s),
        shift_s=mark.shift_s,
        slot=slot,
        segment=segment,
        attempt=attempt,
        mid_segment=mid_segment,
        last_time_s=last_s,
    )


def _start_s(plan: Plan, clock: Clock, mark: ScheduleMark, start_utc: str, last_s: float) -> float:
    """Return when the run began on the present clock.

    On a clock different from that of the run, the elapsed time is taken from the time of day, and
    the time of the run never goes back before its last reading.
    """
    if mark.clock == clock_identity(clock):
        return mark.start_clock_s
    since_s = (datetime.now(UTC) - datetime.fromisoformat(start_utc)).total_seconds()
    since_s *= getattr(clock, "speed", 1.0)
    since_s = max(since_s, last_s + plan.sequence.sampling.period_s)
    return clock.now_s() - since_s


def is_own(occupied: Many[str], store: Store, test_id: str, plan: Plan, station: Station) -> bool:
    """Return True if the killed test itself left the chamber in its present state.

    A test can leave only a profile or program running, because some controllers ramp in this way.
    It belongs to the test if the last event in the store is a command, not a safe condition, and if
    the set point is within the programme of the test.

    Parameters
    ----------
    occupied : sequence of str
        Result of `Chamber.read_occupation`.
    store : Store
    test_id : str
        The test to resume.
    plan : Plan
        Its plan.
    station : Station
        Its instruments; the set point is read.

    Returns
    -------
    bool

    Raises
    ------
    InstrumentError
        If the set point cannot be read.
    """
    if not all("profile" in text or "program" in text for text in occupied):
        return False
    words = [e.kind for e in store.events(test_id) if e.kind in COMMANDED | SAFE]
    if not words or words[-1] in SAFE:
        return False
    asked = [plan.sequence.temperature.start_c, plan.rest_temp_c, *(leg.end_c for leg in plan.legs)]
    return min(asked) - NEAR_C <= station.chamber.read_setpoint_c() <= max(asked) + NEAR_C
