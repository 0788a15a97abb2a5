"""The instruments of a running test, with counted failures and supervised waits."""

import logging
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import FencedError, InstrumentError, LimitError, RecognitionError
from drivers.opening import Station
from thermo.planning.plan import Plan
from thermo.station.journal import Journal
from thermo.station.outcome import (
    ForeignChangeError,
    InterferedError,
    LimitTrippedError,
    Phase,
    Progress,
    RunControl,
)
from thermo.station.watch import FailureBudget, LimitWatch

log = logging.getLogger(__name__)

CHECK_S = 10.0  # between two checks of the chamber while waiting
ALARM_S = 10.0  # between two checks of its alarms while reading
SLICE_S = 0.2  # real seconds after which a wait notices the operator

Value = TypeVar("Value")
# shows that the control thread is alive and checks the guardian; returns text for events
Heartbeat = Callable[[], Iterable[str]]


def no_heartbeat() -> tuple[str, ...]:
    """Beat for nobody: there is no guardian."""
    return ()


class Session:
    """One session of a test: instruments, clock, limits and observers.

    `commanded` and `head_commanded` are set just before the first command to the chamber or the
    head. `foreign` is set while readings may be affected by a foreign change, until the chamber has
    been brought to a known temperature. `heartbeat` is called around every call of an instrument
    and in every slice of a wait; an exception from it ends the test.
    """

    def __init__(
        self,
        plan: Plan,
        station: Station,
        clock: Clock,
        journal: Journal,
        control: RunControl,
        heartbeat: Heartbeat = no_heartbeat,
    ) -> None:
        self.plan = plan
        self.station = station
        self.clock = clock
        self.journal = journal
        self.control = control
        self._heartbeat = heartbeat
        self.watch = LimitWatch(plan)
        self.commanded = self.head_commanded = False
        self.chamber_c: float | None = None
        self.foreign = False
        self.look_due_s = -math.inf
        self._rule = station.config.on_foreign_change
        self._changes: tuple[str, ...] = ()  # foreign changes at the last check
        self._undoing = False  # the operator has resumed after them
        self._budgets: dict[str, FailureBudget] = {}
        self._alarms_due_s = -math.inf
        self._shown: Progress | None = None
        speed = getattr(clock, "speed", None)
        self._slice_s = math.inf if speed is None else SLICE_S * speed

    def beat(self) -> None:
        """Send a heartbeat, and record changes of the guardian."""
        for line in self._heartbeat():
            self.journal.event("guardian", line)

    def ask(self, name: str, call: Callable[[], Value]) -> Value | None:
        """Query an instrument; None after a failure, which is counted under `name` and logged.

        Raises
        ------
        InstrumentLostError
            When it has failed too often.
        LimitTrippedError
            If the driver refuses the request, or no longer recognises the instrument because its
            settings were changed; a repetition would not help.
        FencedError
            When somebody else has taken the instrument over.
        """
        limits = self.plan.sequence.limits
        budget = self._budgets.setdefault(
            name,
            FailureBudget(name, limits.max_failures, limits.max_failure_s),
        )
        self.beat()
        try:
            value = call()
        except LimitError as err:
            raise LimitTrippedError(f"{name} refused: {err}") from err
        except RecognitionError as err:
            raise ForeignChangeError(str(err)) from err
        except FencedError:
            raise
        except InstrumentError as err:
            self.journal.event("fault", f"{name}: {err}")
            budget.failed(self.clock.now_s(), err)
            return None
        finally:
            self.beat()
        budget.succeeded()
        return value

    def tell(self, name: str, call: Callable[[], None]) -> bool:
        """Command an instrument; False after a failure, as for `ask`."""

        def done() -> bool:
            call()
            return True

        return self.ask(name, done) is not None

    def tell_chamber(self, call: Callable[[], None]) -> bool:
        """Command the chamber, unless this would overwrite a foreign change.

        False after a failure, or if the station's rule on foreign changes must be applied first,
        which the next check of the chamber does.

        Raises
        ------
        LimitTrippedError
            When somebody else has changed the chamber and the rule is to end.
        """
        if self.commanded and not self._undoing and not self._may_command():
            return False
        self.commanded = True
        done = self.tell("chamber set point", call)
        self._undoing = self._undoing and not done
        return done

    def _may_command(self) -> bool:
        """Check the chamber for foreign changes before a command hides them."""
        if not self._see_changes():
            return False
        if self._changes and self._rule == "end":
            raise ForeignChangeError(f"somebody else changed the chamber: {self._changes_text()}")
        return not self._changes or self._rule == "tell"

    def tell_head(self, call: Callable[[], None]) -> bool:
        """Command the head."""
        self.head_commanded = True
        return self.tell("head move", call)

    def sleep_until(
        self, deadline_s: float, *, unless_paused: bool = False, while_paused: bool = False
    ) -> bool:
        """Wait, noticing the operator.

        Parameters
        ----------
        deadline_s : float
            s on the clock.
        unless_paused, while_paused : bool
            Whether a pause that begins, or is over, cuts it short.

        Returns
        -------
        bool
            False when it was cut short.
        """
        while True:
            self.beat()
            self.control.check()
            if (while_paused and not self.control.paused) or (
                unless_paused and self.control.paused
            ):
                return False
            now_s = self.clock.now_s()
            if now_s >= deadline_s:
                return True
            self.clock.sleep_until_s(min(deadline_s, now_s + self._slice_s))

    def look_at_chamber(self, commanded_c: float | None) -> None:
        """Read the chamber and check it against the limits.

        Parameters
        ----------
        commanded_c : float or None
            Temperature of the programme, °C; None while the chamber is approaching a temperature.
        """
        self.read_chamber()
        self.judge_chamber(commanded_c)

    def read_chamber(self) -> None:
        """Read the chamber's temperature and check for foreign changes."""
        chamber = self.station.chamber
        self.look_due_s = self.clock.now_s() + CHECK_S
        self.chamber_c = self.ask("chamber", chamber.read_temp_c)
        if self.chamber_c is None or not self.commanded:
            return
        self._see_changes()

    def _see_changes(self) -> bool:
        """Read foreign changes and report new ones; False if they cannot be read."""
        read = self.station.chamber.read_foreign_changes
        changes = self.ask("chamber's set point and mode", read)
        if changes is None:
            return False
        for change in changes:
            if change not in self._changes:
                self.journal.event("foreign change", change)
        if changes and not self.foreign:
            self.journal.complain(f"somebody else changed the chamber: {'; '.join(changes)}")
        self._changes = changes
        self.foreign = self.foreign or bool(changes)
        return True

    def judge_chamber(self, commanded_c: float | None) -> None:
        """Check the last reading of the chamber against the limits, and its alarms.

        Raises
        ------
        LimitTrippedError
            If a limit is exceeded, an alarm is active, or somebody else has changed the chamber and
            the station's rule is to end.
        InterferedError
            When the rule is to pause, and the pause is over.
        """
        now_s = self.clock.now_s()
        if self.chamber_c is not None:
            self.watch.chamber(self.chamber_c)
        if now_s >= self._alarms_due_s:
            self._alarms_due_s = now_s + ALARM_S
            alarms = self.ask("chamber alarms", self.station.chamber.read_alarms)
            self.watch.alarms(alarms or ())
        if self._changes and self._rule == "end":
            raise ForeignChangeError(f"somebody else changed the chamber: {self._changes_text()}")
        if self._changes and self._rule == "pause":
            self._stand_back()
        elif self.chamber_c is not None and commanded_c is not None:
            self.watch.programme(now_s, self.chamber_c, commanded_c)

    def _changes_text(self) -> str:
        return "; ".join(self._changes)

    def _stand_back(self) -> None:
        """Send no commands until the operator resumes; the limits are still checked."""
        began_s = self.clock.now_s()
        self.control.pause()
        self.journal.event(
            "pause", f"the test stops commanding the chamber: {self._changes_text()}"
        )
        while self.control.paused:
            self.sleep_until(self.clock.now_s() + CHECK_S, while_paused=True)
            self.read_chamber()
            if self.chamber_c is not None:
                self.watch.chamber(self.chamber_c)
            self.watch.alarms(self.ask("chamber alarms", self.station.chamber.read_alarms) or ())
            if self._shown is not None:
                self._show_again(self._shown)
        self._changes = ()
        self._undoing = True  # the next command overwrites them
        raise InterferedError(began_s)

    def show(
        self, phase: Phase, commanded_c: float, left_s: float, slot: int = 0, segment: int = 0
    ) -> None:
        """Report the progress to the observers."""
        self._shown = Progress(
            test_id=self.journal.test_id,
            run=self.journal.run,
            runs=self.plan.runs,
            phase=phase,
            slot=slot,
            slots=self.plan.slots,
            segment=segment,
            time_s=self.clock.now_s() - self.journal.start_s,
            left_s=left_s,
            commanded_c=commanded_c,
            chamber_c=self.chamber_c,
        )
        self.journal.progress(self._shown)

    def _show_again(self, shown: Progress) -> None:
        """Report to the observers that the test is paused."""
        time_s = self.clock.now_s() - self.journal.start_s
        self.journal.progress(
            replace(shown, phase="pause", time_s=time_s, chamber_c=self.chamber_c)
        )
