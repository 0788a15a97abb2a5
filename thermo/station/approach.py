"""Bringing the chamber to a temperature, and standing still while the operator wants it."""

import math

from thermo.station.outcome import InterferedError, LimitTrippedError, Phase
from thermo.station.session import CHECK_S, Session


def go_to(
    session: Session,
    temp_c: float,
    phase: Phase,
    left_s: float,
    *,
    stay_s: float = 0.0,
    until_s: float = -math.inf,
) -> None:
    """Bring the chamber to a temperature and let it stay there.

    A pause on the way holds the chamber where it is; one while it stays lets it stay.

    Parameters
    ----------
    session : Session
    temp_c : float
        °C.
    phase : Phase
        For the progress.
    left_s : float
        Expected rest of the test after this, s.
    stay_s : float
        How long it is to stay once it is there, s.
    until_s : float
        When it may leave at the earliest, s on the clock.

    Raises
    ------
    LimitTrippedError
        When it does not get there in the time the sequence allows.
    """
    while True:
        try:
            _reach(session, temp_c, phase, left_s + stay_s)
            session.foreign = False  # what comes now begins at a temperature that is known
            end_s = max(until_s, session.clock.now_s() + stay_s)
            _stay(session, temp_c, "soak" if phase == "approach" else phase, end_s, left_s)
        except InterferedError:
            continue
        return


def _reach(session: Session, temp_c: float, phase: Phase, left_s: float) -> None:
    programme, clock = session.plan.sequence.temperature, session.clock
    deadline_s = clock.now_s() + 60 * programme.start_timeout_min
    told = False
    while True:
        if session.control.paused:
            deadline_s += _pause_on_the_way(session, temp_c, left_s)
            told = False
        if not told:
            told = session.tell_chamber(lambda: session.station.chamber.hold_temp_c(temp_c))
        session.look_at_chamber(None)
        here_c = session.chamber_c
        session.show(phase, temp_c, left_s)
        if told and here_c is not None and abs(here_c - temp_c) <= programme.start_tolerance_c:
            break
        if clock.now_s() >= deadline_s:
            shown = "unread" if here_c is None else f"{here_c:.2f} °C"
            raise LimitTrippedError(
                f"chamber ({shown}) did not come within {programme.start_tolerance_c:g} °C of "
                f"{temp_c:g} °C in {programme.start_timeout_min:g} min"
            )
        session.sleep_until(clock.now_s() + CHECK_S, unless_paused=True)
    session.watch.expect(clock.now_s(), 0.0)


def _stay(session: Session, temp_c: float, phase: Phase, end_s: float, left_s: float) -> None:
    """Watch the chamber stay at a temperature for a time."""
    while (now_s := session.clock.now_s()) < end_s or session.control.paused:
        if session.control.paused:
            what = f"the chamber stays at {temp_c:.2f} °C"
            hold_while_paused(session, temp_c, what, left_s)
            continue
        session.sleep_until(min(end_s, now_s + CHECK_S), unless_paused=True)
        session.look_at_chamber(temp_c)
        session.show(phase, temp_c, left_s + max(0.0, end_s - session.clock.now_s()))


def _pause_on_the_way(session: Session, temp_c: float, left_s: float) -> float:
    """Hold the chamber where it is until the operator resumes; return for how long, s."""
    began_s = session.clock.now_s()
    low, high = session.plan.chamber_limits_c
    here_c = min(max(temp_c if session.chamber_c is None else session.chamber_c, low), high)
    told = session.tell_chamber(lambda: session.station.chamber.hold_temp_c(here_c))
    what = f"the chamber is held at {here_c:.2f} °C on its way to {temp_c:g} °C"
    hold_while_paused(session, here_c, what, left_s, on_the_way=True, told=told)
    return session.clock.now_s() - began_s


def hold_while_paused(
    session: Session,
    temp_c: float,
    what: str,
    left_s: float,
    *,
    on_the_way: bool = False,
    told: bool = True,
    slot: int = 0,
    segment: int = 0,
) -> None:
    """Stand still until the operator resumes, with every limit watched.

    Parameters
    ----------
    session : Session
    temp_c : float
        Where the chamber is held, °C.
    what : str
        What stands still, for the event.
    left_s : float
        Expected rest of the test after the pause, s.
    on_the_way : bool
        Whether that is no temperature of the programme: then only the absolute limits hold.
    told : bool
        False: the chamber is still to be told to hold there.
    slot, segment : int
        For the progress.

    Raises
    ------
    InterferedError
        When somebody else changed the chamber meanwhile, and the wait for the operator is over.
    """
    control, clock = session.control, session.clock
    began_s = clock.now_s()
    session.journal.event("pause", "; ".join(s for s in (what, control.why_paused) if s))
    while control.paused:
        session.show("pause", temp_c, left_s, slot, segment)
        session.sleep_until(clock.now_s() + CHECK_S, while_paused=True)
        told = told or session.tell_chamber(lambda: session.station.chamber.hold_temp_c(temp_c))
        session.look_at_chamber(None if on_the_way else temp_c)
    session.journal.event("pause over", f"after {clock.now_s() - began_s:.1f} s")
