"""Control of head and chamber by a run: the last command of each, and whether it is reached."""

from functools import partial

from thermo.planning.legs import Leg
from thermo.station.checks.quality import OFF_POSITION_DEG
from thermo.station.session import Session


class Head:
    """The head of a session's station.

    Attributes
    ----------
    sent_deg : float or None
        The angle it was last sent to, °; None: not known, it is sent again.
    turned : bool
        True if it was commanded since it was last at rest.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.sent_deg: float | None = None
        self.turned = False

    @property
    def settle_s(self) -> float:
        """The settling time it still needs before a reading, s."""
        return self._session.plan.sequence.sampling.settle_s if self.turned else 0.0

    def send(self, target_deg: float) -> None:
        """Send it to a position, unless it was sent there already."""
        if self.sent_deg == target_deg:
            return
        device = self._session.station.head
        if self._session.tell_head(partial(device.move_to_deg, target_deg)):
            self.sent_deg = target_deg
            self.turned = True

    def is_moving(self) -> bool:
        """Return True if it turns or does not answer."""
        return self._session.ask("head", self._session.station.head.is_moving) is not False

    def check(self, position_deg: float) -> None:
        """Compare its angle with the commanded one; if they differ, it must be sent again."""
        if self.sent_deg is None or abs(position_deg - self.sent_deg) <= OFF_POSITION_DEG:
            return
        self._session.journal.event(
            "position", f"head at {position_deg:.3f}°, sent to {self.sent_deg:.3f}°"
        )
        self.sent_deg = None


class ChamberProgramme:
    """The chamber of a session's station, on the legs of its plan.

    Attributes
    ----------
    next_leg : int
        The leg to be commanded next.
    returning : bool
        True while the chamber returns to the programme after a gap.
    """

    def __init__(self, session: Session, next_leg: int) -> None:
        self._session = session
        self.next_leg = next_leg
        self.returning = False

    def leg_due_by(self, deadline_s: float, programme_start_s: float) -> Leg | None:
        """Return the next leg if it begins by a moment; both are s on the clock."""
        legs = self._session.plan.legs[self.next_leg : self.next_leg + 1]
        # the same sum as for a deadline, so a leg that begins with a slot is due exactly then
        return legs[0] if legs and programme_start_s + legs[0].start_s <= deadline_s else None

    def start_leg(self, commanded_c: float) -> bool:
        """Command the next leg; after a gap, bring the chamber back to the programme first.

        Parameters
        ----------
        commanded_c : float
            Present temperature of the programme, °C.

        Returns
        -------
        bool
            False if the leg has not begun and must be tried again after the next slot.
        """
        session, chamber = self._session, self._session.station.chamber
        leg = session.plan.legs[self.next_leg]
        if self.returning and not self._is_back(commanded_c):
            session.tell_chamber(partial(chamber.hold_temp_c, commanded_c))
            return False
        if leg.is_ramp:
            done = session.tell_chamber(
                partial(chamber.ramp_to_c, leg.end_c, abs(leg.rate_c_per_min))
            )
        else:
            done = session.tell_chamber(partial(chamber.hold_temp_c, leg.end_c))
        if done:
            self.returning = False
            self.next_leg += 1
            session.journal.event("segment", _leg_text(leg))
            session.watch.expect(session.clock.now_s(), leg.step_c)
        return done

    def _is_back(self, commanded_c: float) -> bool:
        here_c = self._session.chamber_c
        tolerance_c = max(1.0, self._session.plan.sequence.temperature.start_tolerance_c)
        return here_c is not None and abs(here_c - commanded_c) <= tolerance_c


def _leg_text(leg: Leg) -> str:
    if leg.is_ramp:
        return f"{leg.index}: ramp to {leg.end_c:g} °C at {abs(leg.rate_c_per_min):g} °C/min"
    return f"{leg.index}: hold {leg.end_c:g} °C for {(leg.end_s - leg.start_s) / 60:g} min"
