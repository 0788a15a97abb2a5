"""One run of a test: readings at equal intervals while the chamber follows the programme."""

import math
from functools import partial

from drivers.devices import ChannelReading
from thermo.planning.legs import Leg, commanded_c, leg_at
from thermo.planning.plan import RunPlan
from thermo.planning.schedule import Schedule
from thermo.station.approach import go_to, hold_while_paused
from thermo.station.checks.quality import Quality
from thermo.station.outcome import InterferedError, ThermistorLostError
from thermo.station.reading import inputs_of, make_rows
from thermo.station.resume_point import ResumePoint
from thermo.station.session import Session
from thermo.station.steering import ChamberProgramme, Head
from thermo.store.records import ReadingRow

LOOK_S = 2.0  # no check of the chamber starts within this time before something is due


class Run:
    """One run, from its first slot or from its interruption.

    The plan's time p is due at ``start + shift + p`` on the clock: `shift_s` grows when a pause or
    a repeated segment moves the rest of the programme.
    """

    def __init__(self, session: Session, point: ResumePoint, rest_s: float) -> None:
        self._session = session
        self._plan = session.plan
        self._run: RunPlan = session.plan.run(point.run)
        self._rest_s = rest_s  # of the test, after this run
        self._inputs = inputs_of(session.plan.sequence, session.station.config)
        self._shift_s = point.shift_s
        self._slot = point.slot
        self._segment = point.segment
        self._attempt = point.attempt
        self._chamber = ChamberProgramme(session, point.segment)
        self._head = Head(session)
        self._gap = False  # the next reading is the first after a gap
        accelerometers = session.plan.sequence.accelerometers
        self._quality = Quality(
            serials=tuple(a.serial for a in accelerometers),
            mount_deg={a.serial: a.mount_deg for a in accelerometers},
            max_bad_share=session.plan.sequence.limits.max_bad_share,
        )

    # ---- time ----

    def _now_s(self) -> float:
        """Return the time from the run's start."""
        return self._session.clock.now_s() - self._session.journal.start_s

    def _schedule(self) -> Schedule:
        return Schedule(
            start_s=self._session.journal.start_s + self._shift_s,
            period_s=self._plan.sequence.sampling.period_s,
        )

    def _commanded_c(self) -> float:
        return float(commanded_c(self._plan.legs, self._now_s() - self._shift_s))

    def _left_s(self) -> float:
        return max(0.0, self._plan.run_s - (self._now_s() - self._shift_s)) + self._rest_s

    # ---- the run ----

    def send_head(self) -> None:
        """Send the head to the first position before the run begins."""
        self._move_head()

    def begin(self) -> None:
        """Store that the schedule is at its beginning."""
        self._mark()

    def go_on(self, point: ResumePoint) -> None:
        """Resume an interrupted run by the sequence's rule for gaps."""
        rule = self._plan.sequence.after_gap
        gap_s = self._now_s() - point.last_time_s
        self._session.journal.event(
            "gap", f"{gap_s:.1f} s without readings before slot {point.slot}"
        )
        if rule.gap_rule == "accept" and gap_s <= rule.max_gap_s and point.mid_segment:
            self._accept_late()
        else:
            self._resoak()

    def finish(self) -> None:
        """Read every remaining slot."""
        while self._slot < self._plan.slots:
            self._session.control.check()
            try:
                if self._session.control.paused:
                    self._pause()
                elif self._wait_for_slot():
                    self._take_slot()
            except InterferedError as err:
                self._chamber.returning = True
                self._after_pause(err.began_s)

    def _mark(self) -> None:
        self._session.journal.schedule(
            shift_s=self._shift_s, segment=self._segment, attempt=self._attempt
        )

    # ---- one slot ----

    def _wait_for_slot(self) -> bool:
        """Wait for the slot and start the legs before it; False for a pause or a missed slot."""
        schedule = self._schedule()
        deadline_s = schedule.deadline_s(self._slot)
        while (leg := self._leg_due_by(deadline_s - 1e-6)) is not None:
            due_s = schedule.start_s + leg.start_s
            if not self._sleep_until(due_s, unless_paused=True):
                return False
            if not self._chamber.start_leg(self._commanded_c()):
                break
        self._move_head()
        if not self._sleep_until(deadline_s - self._head.settle_s, unless_paused=True):
            return False
        return not self._missed()

    def _sleep_until(self, deadline_s: float, *, unless_paused: bool = False) -> bool:
        """Wait with regular checks of the chamber; False if a pause was requested."""
        session = self._session
        while session.look_due_s < deadline_s - LOOK_S:
            if not session.sleep_until(session.look_due_s, unless_paused=unless_paused):
                return False
            session.look_at_chamber(self._commanded_c())
        return session.sleep_until(deadline_s, unless_paused=unless_paused)

    def _missed(self) -> bool:
        """Skip slots that are completely missed or that the head cannot reach in time."""
        session = self._session
        first = self._schedule().first_open(self._slot, session.clock.now_s())
        if first == self._slot:
            return False
        if first < self._plan.slots and self._run.position_deg[first] != self._head.sent_deg:
            first += 1
        first = min(first, self._plan.slots)
        self._skip(first - self._slot)
        session.journal.event(
            "missed", f"slots {self._slot}…{first - 1}: skipped, because they are late"
        )
        self._enter(first)
        return True

    def _take_slot(self) -> None:
        session = self._session
        flags = self._settle()
        if self._missed():
            return
        scan_s = self._now_s()
        lateness_s = session.clock.now_s() - self._schedule().deadline_s(self._slot)
        scan = session.ask("digitiser", session.station.digitiser.scan)
        position_deg = session.ask("head", session.station.head.read_position_deg)
        session.read_chamber()
        if session.foreign:
            flags.append("foreign")
        if scan is None or position_deg is None:
            self._skip(1)
            session.journal.event("skipped", f"slot {self._slot}: no reading")
        else:
            self._store(scan, scan_s, lateness_s, position_deg, flags)
        slot, segment = self._slot, self._segment
        self._enter(self._slot + 1)
        session.judge_chamber(self._commanded_c())
        if self._slot < self._plan.slots:
            self._move_head()
            if self._leg_due_by(self._schedule().deadline_s(slot)) is not None:
                self._chamber.start_leg(self._commanded_c())
        session.show("run", self._commanded_c(), self._left_s(), slot + 1, segment)

    def _settle(self) -> list[str]:
        """Wait for the settling time of the head; return faults of the slot."""
        flags = ["gap"] if self._gap or self._chamber.returning else []
        session, deadline_s = self._session, self._schedule().deadline_s(self._slot)
        moving = False
        if self._head.turned:
            settled_s = session.clock.now_s() + self._head.settle_s
            moving = self._head.is_moving()
            deadline_s = deadline_s if moving else max(deadline_s, settled_s)
            self._head.turned = moving
        self._sleep_until(deadline_s)
        if moving:  # it was when the settling time began
            flags.append("moving" if self._head.is_moving() else "unsettled")
        return flags

    def _store(
        self,
        scan: tuple[ChannelReading, ...],
        scan_s: float,
        lateness_s: float,
        position_deg: float,
        flags: list[str],
    ) -> None:
        if self._head.sent_deg is not None:
            self._alarm(self._quality.see_head(position_deg, self._head.sent_deg))
            self._head.check(position_deg)
        rows = make_rows(
            scan,
            self._inputs,
            slot=self._slot,
            attempt=self._attempt,
            segment=self._segment,
            scan_s=scan_s,
            # read back after the scan: for a turning head it is not the angle of the scan
            position_deg=None if "moving" in flags else position_deg,
            chamber_c=self._session.chamber_c,
            lateness_s=lateness_s,
            flags=flags,
            signals=self._session.station.config.signal_channels,
        )
        self._session.journal.rows(rows)
        self._gap = False
        self._alarm(self._quality.see_rows(rows))
        self._alarm(self._quality.see_shares(rows), complain=False)
        for row in rows:
            self._watch_accelerometer(row)

    def _watch_accelerometer(self, row: ReadingRow) -> None:
        session, limits = self._session, self._plan.sequence.limits
        temp_c = math.nan if row.temp_c is None else row.temp_c
        chamber_c = math.nan if row.chamber_c is None else row.chamber_c
        try:
            session.watch.accelerometer(row.serial, temp_c, chamber_c)
        except ThermistorLostError as err:
            if limits.on_thermistor_lost == "end":
                raise
            session.journal.event("alarm", str(err))
            session.control.pause()

    def _alarm(self, found: list[str], *, complain: bool = True) -> None:
        """Report faults of the instruments at once; a share is checked again at the end."""
        for text in found:
            self._session.journal.event("alarm", text)
            if complain:
                self._session.journal.complain(text)

    def _skip(self, slots: int) -> None:
        self._session.journal.skipped += slots
        self._alarm(self._quality.see_missed(slots), complain=False)

    def _enter(self, slot: int) -> None:
        """Make `slot` the next one to be read."""
        self._slot = slot
        if slot < self._plan.slots and int(self._run.segment[slot]) != self._segment:
            self._segment, self._attempt = int(self._run.segment[slot]), 1

    # ---- chamber and head ----

    def _leg_due_by(self, deadline_s: float) -> Leg | None:
        """Return the next leg to be commanded if it begins by a moment of the clock."""
        return self._chamber.leg_due_by(deadline_s, self._schedule().start_s)

    def _move_head(self) -> None:
        """Send the head to the next slot's position."""
        self._head.send(float(self._run.position_deg[self._slot]))

    # ---- gaps ----

    def _pause(self) -> None:
        session = self._session
        began_s, temp_c = session.clock.now_s(), self._commanded_c()
        told = session.tell_chamber(partial(session.station.chamber.hold_temp_c, temp_c))
        head = "" if self._head.sent_deg is None else f", head at {self._head.sent_deg:g}°"
        what = f"schedule held before slot {self._slot}, {temp_c:.2f} °C{head}"
        try:
            hold_while_paused(
                session,
                temp_c,
                what,
                self._left_s(),
                told=told,
                slot=self._slot,
                segment=self._segment,
            )
        except InterferedError:
            self._chamber.returning = True
        self._after_pause(began_s)

    def _after_pause(self, began_s: float) -> None:
        """Continue by the sequence's rule for gaps."""
        session = self._session
        if self._slot >= self._plan.slots:
            return
        gap_s = session.clock.now_s() - began_s
        session.journal.event("gap", f"{gap_s:.1f} s of pause before slot {self._slot}")
        rule = self._plan.sequence.after_gap
        if rule.gap_rule == "accept" and gap_s <= rule.max_gap_s:
            self._shift_s += gap_s
            self._take_up_leg()
            self._gap = True
        else:
            self._resoak()

    def _accept_late(self) -> None:
        """Continue at the present time of the programme while the chamber returns to it."""
        self._gap = self._chamber.returning = True
        first = self._schedule().first_open(self._slot, self._session.clock.now_s())
        first = min(max(first + 1, self._slot), self._plan.slots)
        self._skip(first - self._slot)
        self._enter(first)
        if self._slot >= self._plan.slots:
            return
        self._move_head()
        self._take_up_leg()

    def _take_up_leg(self) -> None:
        """Command the present leg again."""
        self._mark()
        now_s = self._session.clock.now_s()
        self._chamber.next_leg = int(leg_at(self._plan.legs, self._now_s() - self._shift_s))
        here_c = self._session.ask("chamber", self._session.station.chamber.read_temp_c)
        self._session.chamber_c = here_c
        commanded_c = self._commanded_c()
        self._session.watch.expect(now_s, (commanded_c if here_c is None else here_c) - commanded_c)
        self._chamber.start_leg(self._commanded_c())

    def _resoak(self) -> None:
        """Void the segment's readings, go back to where it starts, and begin it again."""
        session, segment = self._session, self._segment
        leg = self._plan.legs[segment]
        journal = session.journal
        self._attempt = journal.store.mark_attempt(journal.test_id, journal.run, segment)
        self._mark()
        slots = (self._run.segment == segment).nonzero()[0]
        self._slot = int(slots[0])
        resoak_min = self._plan.sequence.after_gap.resoak_min
        journal.event(
            "resoak",
            f"segment {segment} from {leg.start_c:g} °C again, attempt {self._attempt}, after "
            f"{resoak_min:g} min there",
        )
        self._chamber.returning = False
        self._move_head()
        left_s = self._plan.run_s - leg.start_s + self._rest_s
        go_to(session, leg.start_c, "resoak", left_s, stay_s=60 * resoak_min)
        # the head is given its settling time before the first slot as before any other
        settle_s = self._plan.sequence.sampling.settle_s
        self._shift_s = self._now_s() + settle_s - leg.start_s
        self._chamber.next_leg = segment
        self._mark()
