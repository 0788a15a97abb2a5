"""A chamber test from its beginning to its safe end, over any instruments and any clock."""

import logging
import platform
from collections.abc import Callable
from collections.abc import Sequence as Many
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata

from drivers.clock import Clock
from drivers.devices import SafeResult
from drivers.errors import InstrumentError
from drivers.opening import Station
from errormodel.errors import StoreError
from thermo.plan import Plan, make_plan
from thermo.run_in_station import decide_run_in
from thermo.sequence import Sequence, parse_sequence, sequence_toml
from thermo.station_journal import Journal
from thermo.station_reading import inputs_of, scan_channels
from thermo.station_resume import ResumePoint, find_resume_point
from thermo.station_run import Run
from thermo.station_safe import clean_up, one_line, safe_json
from thermo.station_session import Session
from thermo.station_types import (
    GO_ON,
    Decision,
    EndedError,
    Observer,
    Observers,
    RunControl,
    Status,
    TestOutcome,
)
from thermo.store import NewTest, Store
from thermo.store_open import StoreAwayError
from thermo.uniformity import judge_test

log = logging.getLogger(__name__)

VERSIONS_OF = ("accelbench", "numpy", "scipy", "pymodbus", "pyserial", "SQLAlchemy")


@dataclass(slots=True)
class _End:
    """How the procedure ended; what it holds until then is what a crash would mean."""

    status: Status = "failed"
    reason: str = "ended without a reason"


def run_test(
    sequence: Sequence | None,
    station: Station,
    store: Store,
    clock: Clock,
    *,
    resume: str | None = None,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
    before_command: Callable[[str], None] | None = None,
) -> TestOutcome:
    """Run a test sequence, or go on with an interrupted one.

    However it ends (at its end, by a limit, a lost instrument, the operator, a signal or any
    exception), the chamber is put into its safe condition and that is verified, the head is
    stopped, and both are stored with the test. Signals are the caller's business: turn them into
    `RunControl.abort`, as `thermo.station_shell.run_on_station` does.

    Parameters
    ----------
    sequence : Sequence or None
        With `resume`, None or the sequence that test was begun with.
    station : Station
    store : Store
    clock : Clock
        The one the station lives in.
    resume : str, optional
        The test to go on with.
    observers : sequence of Observer
    control : RunControl, optional
        The operator's hand.
    before_command : callable, optional
        Called with the test's id before the chamber is told anything; what it raises ends the
        test. The guardian is started here.

    Returns
    -------
    TestOutcome

    Raises
    ------
    InputError
        When the station cannot do what the sequence asks; nothing was commanded or stored.
    StoreError
        When the test cannot be begun or resumed; nothing was commanded.
    """
    if resume is not None:
        sequence = stored_sequence(store, resume, sequence)
    if sequence is None:
        raise ValueError("a sequence is needed for a new test")
    plan = make_plan(sequence, station.config)
    if resume is not None:
        store.claim(resume)
        try:
            find_resume_point(store, resume, plan, clock)
            store.reopen_test(resume)
        except BaseException:
            store.claim(resume).release()
            raise
    test = _Test(plan, station, store, clock, Observers(observers), control or RunControl())
    return test.run(resume, before_command)


def stored_sequence(store: Store, test_id: str, given: Sequence | None = None) -> Sequence:
    """Return the sequence a test was begun with; another one given is a `StoreError`."""
    stored = parse_sequence(store.test(test_id).sequence_toml, f"test {test_id}")
    if given is not None and given != stored:
        raise StoreError(f"test {test_id}: was begun with another sequence than the one given")
    return stored


class _Test:
    """One sitting, from the first question to an instrument to the safe end."""

    def __init__(
        self,
        plan: Plan,
        station: Station,
        store: Store,
        clock: Clock,
        observers: Observers,
        control: RunControl,
    ) -> None:
        self._plan = plan
        self._station = station
        self._store = store
        self._clock = clock
        self._observers = observers
        self._control = control
        self._test_id = ""
        self._resumed = False
        self._session: Session | None = None

    def run(self, resume: str | None, before_command: Callable[[str], None] | None) -> TestOutcome:
        end = _End()
        self._test_id, self._resumed = resume or "", resume is not None
        try:
            end.reason = self._procedure(resume, before_command or (lambda _: None))
            end.status = "finished"
        except EndedError as err:
            end.status, end.reason = err.status, one_line(err)
        except (KeyboardInterrupt, SystemExit) as err:
            end.status, end.reason = "interrupted", type(err).__name__
        except (InstrumentError, StoreError) as err:
            end.reason = one_line(err)
        except Exception as err:
            log.exception("the test ends by an error of the program")
            end.reason = f"{type(err).__name__}: {one_line(err)}"
        finally:
            # also on the way of an exception that nobody above expected
            outcome = self._end(end)
        return outcome

    # ---- the procedure ----

    def _procedure(self, resume: str | None, before_command: Callable[[str], None]) -> str:
        """Do what is left of the test, and return why it is done."""
        station, plan = self._station, self._plan
        identities = station.identify()
        inputs = inputs_of(plan.sequence, station.config)
        channels = scan_channels(inputs)
        station.digitiser.configure(channels, nplc=station.config.digitiser.nplc)
        settings = {"identity": identities, **station.read_settings()}
        if not resume:
            self._test_id = self._store.begin_test(
                NewTest(
                    name=plan.sequence.name,
                    sequence_toml=sequence_toml(plan.sequence),
                    station_json=station.config.model_dump_json(),
                    versions=_versions(),
                    settings=settings,
                )
            )
        journal = Journal(self._store, self._test_id, self._observers, self._clock)
        session = Session(plan, station, self._clock, journal, self._control)
        self._session = session
        if resume:
            journal.event("resumed", f"on {station.config.chamber.url}")
            point = find_resume_point(self._store, self._test_id, plan, self._clock)
        else:
            journal.event("begun", f"{plan.runs} runs of {plan.slots} slots")
            point = ResumePoint(run=1)
        if point is not None:
            before_command(self._test_id)
            return self._runs(session, point, pause_first=bool(resume) and point.run > 1)
        return self._decide(session, plan.runs).reason

    def _decide(self, session: Session, number: int) -> Decision:
        """Decide, from what is stored, whether the test goes on after a run."""
        decision = GO_ON
        if self._plan.sequence.run_in is not None:
            session.journal.run = number  # after a resumption it is nobody's yet
            decision = decide_run_in(self._store, self._test_id, self._plan.sequence, number)
        for line in decision.lines:
            session.journal.event(decision.kind, line)
        return decision

    def _runs(self, session: Session, point: ResumePoint, *, pause_first: bool) -> str:
        plan = self._plan
        for number in range(point.run, plan.runs + 1):
            after_s = (plan.runs - number) * (plan.rest_s + plan.approach_s + plan.run_s)
            begun = number == point.run and point.start_s is not None
            # before every new run, not after every one done: a resumed test asks again
            if not begun and number > 1 and (decision := self._decide(session, number - 1)).stop:
                return decision.reason
            if not begun and (number > point.run or pause_first):
                self._rest(session, after_s + plan.approach_s + plan.run_s)
            journal = session.journal
            journal.run = number
            if begun and point.start_s is not None:
                journal.start_s = point.start_s
                self._store.begin_run(self._test_id, number, datetime.now(UTC))
                run = Run(session, point, after_s)
                run.go_on(point)
            else:
                run = Run(session, ResumePoint(run=number), after_s)
                journal.start_s = self._clock.now_s()
                run.send_head()
                self._approach(session, after_s + plan.run_s)
                # the head is given its settling time before the first slot as before any other
                journal.start_s = self._clock.now_s() + plan.sequence.sampling.settle_s
                self._store.begin_run(self._test_id, number, datetime.now(UTC), journal.start_s)
                run.begin()
            run.finish()
            self._store.finish_run(self._test_id, number, "finished")
            journal.event("run finished", f"run {number} of {plan.runs}")
            self._judge_ramps(session, number)
        return self._decide(session, plan.runs).reason

    def _judge_ramps(self, session: Session, number: int) -> None:
        try:
            readings = self._store.readings(self._test_id, number)
        except StoreAwayError as err:  # no reason to end the test: they can be judged later
            session.journal.event("ramp", f"run {number} is not judged now: {err}")
            return
        for verdict in judge_test(self._plan, readings):
            session.journal.event("ramp", verdict.sentence)

    def _approach(self, session: Session, left_s: float) -> None:
        programme = self._plan.sequence.temperature
        session.journal.event("approach", f"to {programme.start_c:g} °C")
        stay_s = 60 * programme.start_soak_min
        session.go_to(programme.start_c, "approach", left_s, stay_s=stay_s)

    def _rest(self, session: Session, left_s: float) -> None:
        """Let the accelerometers rest unpowered; the power itself is switched by hand or timer."""
        plan, journal = self._plan, session.journal
        if plan.rest_s == 0:
            return
        end_s = self._clock.now_s() + plan.rest_s
        journal.event(
            "power off", f"rest of {plan.rest_s / 3600:g} h at {plan.rest_temp_c:g} °C begins"
        )
        session.go_to(plan.rest_temp_c, "rest", left_s + plan.rest_s)
        stay_s = max(0.0, end_s - self._clock.now_s())
        session.stay(plan.rest_temp_c, "rest", stay_s, left_s)
        journal.event("power on", "the rest is over")

    # ---- the end ----

    def _end(self, end: _End) -> TestOutcome:
        session, station = self._session, self._station
        done = clean_up(
            station.chamber,
            station.head,
            station.config.chamber.safe_temp_c,
            self._clock,
            commanded=self._resumed or (session is not None and session.commanded),
        )
        if not done.chamber.verified:
            log.error("the chamber's safe condition is not verified: %s", done.chamber.steps)
        reason = self._record(end, done.chamber)
        return TestOutcome(
            test_id=self._test_id,
            status=end.status,
            reason=reason,
            safe=done.chamber,
            head_stopped=done.head_stopped,
            readings=session.journal.readings if session else 0,
            skipped=session.journal.skipped if session else 0,
            flagged=session.journal.flagged if session else 0,
        )

    def _record(self, end: _End, safe: SafeResult) -> str:
        """Store how the test ended, and return why; a store that refuses becomes part of that."""
        if not self._test_id:
            return end.reason
        try:
            session = self._session
            if session is not None:
                session.journal.event(
                    "safe" if safe.verified else "not safe", "; ".join(safe.steps)
                )
                for name, device in self._station.devices.items():
                    session.journal.event("link", f"{name}: {device.counters}")
            self._store.finish_test(self._test_id, end.status, end.reason, safe_json(safe))
        except BaseException as err:
            log.exception("the end of test %s could not be stored", self._test_id)
            return f"{end.reason}; not stored: {one_line(err)}"
        return end.reason


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in VERSIONS_OF:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
