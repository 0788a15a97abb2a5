"""The runs of a test in order, the rests between them, and the verdicts after each run."""

from contextlib import suppress
from datetime import UTC, datetime

from thermo.station.approach import go_to
from thermo.station.checks.quality import find_bad_shares
from thermo.station.checks.run_in import decide_run_in
from thermo.station.checks.uniformity import judge_test
from thermo.station.outcome import GO_ON, Decision, InterferedError
from thermo.station.resume_point import ResumePoint
from thermo.station.run import Run
from thermo.station.session import Session
from thermo.store.database import StoreAwayError


class RunSeries:
    """The runs of a session's test."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._plan = session.plan
        self._store = session.journal.store
        self._test_id = session.journal.test_id
        self._clock = session.clock
        self._unjudged: int | None = None  # the last run, until its ramps have a verdict
        self._decision = GO_ON

    def do(self, point: ResumePoint, *, rest_first: bool) -> None:
        """Do the remaining runs, or as many as needed; the last has no verdict yet.

        Parameters
        ----------
        point : ResumePoint
            Point to continue from; ``ResumePoint(run=1)`` for a new test.
        rest_first : bool
            True to begin with the rest: before a resumption, the rest time of the accelerometers is
            unknown.
        """
        plan = self._plan
        for number in range(point.run, plan.runs + 1):
            after_s = (plan.runs - number) * (plan.rest_s + plan.approach_s + plan.run_s)
            begun = number == point.run and point.start_s is not None
            # before every new run, not after every completed one, so that a resumed test checks
            # again
            if not begun and number > 1:
                self._judge_ramps()
                with suppress(InterferedError):  # what comes next commands the chamber anew
                    # between two queries of a store that does not answer
                    self._session.look_at_chamber(None)
                self._decision = self._decide(number - 1)
                if self._decision.stop:
                    return
            if not begun and (number > point.run or rest_first):
                self._rest(after_s + plan.approach_s + plan.run_s)
            self._session.journal.run = number
            run = self._go_on(point, after_s) if begun else self._begin(number, after_s)
            run.finish()
            self._finish(number)

    def _go_on(self, point: ResumePoint, after_s: float) -> Run:
        """Take up an interrupted run."""
        assert point.start_s is not None
        self._session.journal.start_s = point.start_s
        self._store.begin_run(self._test_id, point.run, datetime.now(UTC))
        run = Run(self._session, point, after_s)
        run.go_on(point)
        return run

    def _begin(self, number: int, after_s: float) -> Run:
        """Bring head and chamber to the start of a run, and begin it."""
        session, plan = self._session, self._plan
        run = Run(session, ResumePoint(run=number), after_s)
        session.journal.start_s = self._clock.now_s()
        run.send_head()
        self._approach(after_s + plan.run_s)
        # the head is given its settling time before the first slot as before any other
        start_s = self._clock.now_s() + plan.sequence.sampling.settle_s
        session.journal.start_s = start_s
        self._store.begin_run(self._test_id, number, datetime.now(UTC), start_s)
        run.begin()
        return run

    def _finish(self, number: int) -> None:
        with suppress(InterferedError):  # no reading of this run comes after it
            self._session.look_at_chamber(None)  # changes since the last one are reported
        self._store.finish_run(self._test_id, number, "finished")
        self._session.journal.event("run finished", f"run {number} of {self._plan.runs}")
        self._unjudged = number

    def _approach(self, left_s: float) -> None:
        programme = self._plan.sequence.temperature
        self._session.journal.event("approach", f"to {programme.start_c:g} °C")
        stay_s = 60 * programme.start_soak_min
        go_to(self._session, programme.start_c, "approach", left_s, stay_s=stay_s)

    def _rest(self, left_s: float) -> None:
        """Let the accelerometers rest unpowered; the power itself is switched by hand or timer."""
        plan, journal = self._plan, self._session.journal
        if plan.rest_s == 0:
            return
        end_s = self._clock.now_s() + plan.rest_s
        journal.event(
            "power off", f"rest of {plan.rest_s / 3600:g} h at {plan.rest_temp_c:g} °C begins"
        )
        go_to(self._session, plan.rest_temp_c, "rest", left_s, until_s=end_s)
        journal.event("power on", "the rest is over")

    # ---- verdicts ----

    def judge(self) -> str:
        """Check the readings after all runs, and return the reason of the end.

        The chamber is already safe, so it does not wait for the store.
        """
        journal = self._session.journal
        self._judge_ramps()
        self._session.beat()
        if not self._decision.stop:
            self._decision = self._decide(self._plan.runs)
        self._judge_shares()
        for text in journal.complaints:
            journal.event("complaint", text)
        how = f", with {len(journal.complaints)} complaints" if journal.complaints else ""
        return self._decision.reason + how

    def _decide(self, number: int) -> Decision:
        """Decide from the store whether the test continues after a run."""
        journal, decision = self._session.journal, GO_ON
        if self._plan.sequence.run_in is not None:
            journal.run = number  # after a resumption it is nobody's yet
            decision = decide_run_in(self._store, self._test_id, self._plan.sequence, number)
        for line in decision.lines:
            journal.event(decision.kind, line)
        return decision

    def _judge_ramps(self) -> None:
        """Give the verdict on the ramps of the last run, once."""
        number, self._unjudged = self._unjudged, None
        if number is None:
            return
        try:
            readings = self._store.readings(self._test_id, number)
        except StoreAwayError as err:  # no reason to end the test: the verdict can be given later
            self._session.journal.event("ramp", f"run {number} has no verdict yet: {err}")
            return
        for verdict in judge_test(self._plan, readings):
            self._session.journal.event("ramp", verdict.sentence)

    def _judge_shares(self) -> None:
        session = self._session
        try:
            bad = find_bad_shares(self._store, self._test_id, self._plan, session.beat)
        except StoreAwayError as err:  # the test is done, and whether it is good is not known
            bad = [f"missed and flagged readings were not checked: {err}"]
        for text in bad:
            session.journal.complain(text)
