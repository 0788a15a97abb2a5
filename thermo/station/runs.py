"""The runs of a test one after the other, the rests between them, and what is judged after each."""

from contextlib import suppress
from datetime import UTC, datetime

from thermo.station.approach import go_to
from thermo.station.outcome import GO_ON, Decision, InterferedError
from thermo.station.quality import find_bad_shares
from thermo.station.resume_point import ResumePoint
from thermo.station.run import Run
from thermo.station.run_in import decide_run_in
from thermo.station.session import Session
from thermo.station.uniformity import judge_test
from thermo.store.database import StoreAwayError


class RunSeries:
    """The runs of a session's test."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._plan = session.plan
        self._store = session.journal.store
        self._test_id = session.journal.test_id
        self._clock = session.clock
        self._unjudged: int | None = None  # the run done last, while its ramps are not judged
        self._decision = GO_ON

    def do(self, point: ResumePoint, *, rest_first: bool) -> None:
        """Do the runs that are left, or as many as are needed; the last one is not judged yet.

        Parameters
        ----------
        point : ResumePoint
            Where to go on; ``ResumePoint(run=1)`` for a new test.
        rest_first : bool
            Whether the rest before the first of them is to be kept: nobody knows how long the
            accelerometers rested before a resumption.
        """
        plan = self._plan
        for number in range(point.run, plan.runs + 1):
            after_s = (plan.runs - number) * (plan.rest_s + plan.approach_s + plan.run_s)
            begun = number == point.run and point.start_s is not None
            # before every new run, not after every one done: a resumed test asks again
            if not begun and number > 1:
                self._judge_ramps()
                with suppress(InterferedError):  # what comes next commands the chamber anew
                    # between two questions to a store that is away
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
        """Bring head and chamber to where a run begins, and begin it."""
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
            self._session.look_at_chamber(None)  # what was changed since the last one is told
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
        """Judge what was read after all runs are done, and return why the test is done.

        The chamber is safe by now: it does not wait for a store that does not answer.
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
        """Decide, from what is stored, whether the test goes on after a run."""
        journal, decision = self._session.journal, GO_ON
        if self._plan.sequence.run_in is not None:
            journal.run = number  # after a resumption it is nobody's yet
            decision = decide_run_in(self._store, self._test_id, self._plan.sequence, number)
        for line in decision.lines:
            journal.event(decision.kind, line)
        return decision

    def _judge_ramps(self) -> None:
        """Judge the ramps of the run that was done last, once."""
        number, self._unjudged = self._unjudged, None
        if number is None:
            return
        try:
            readings = self._store.readings(self._test_id, number)
        except StoreAwayError as err:  # no reason to end the test: they can be judged later
            self._session.journal.event("ramp", f"run {number} is not judged now: {err}")
            return
        for verdict in judge_test(self._plan, readings):
            self._session.journal.event("ramp", verdict.sentence)

    def _judge_shares(self) -> None:
        session = self._session
        try:
            bad = find_bad_shares(self._store, self._test_id, self._plan, session.beat)
        except StoreAwayError as err:  # the test is done, and whether it is good is not known
            bad = [f"readings missed and flagged are not judged: {err}"]
        for text in bad:
            session.journal.complain(text)
