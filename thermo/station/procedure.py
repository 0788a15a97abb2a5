"""A chamber test from its beginning to its safe end, over any instruments and any clock."""

import logging
import platform
from collections.abc import Callable, Generator
from collections.abc import Sequence as Many
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata

from drivers.clock import Clock
from drivers.devices import SafeResult
from drivers.errors import InstrumentError, RecognitionError
from drivers.opening import Station
from errormodel.errors import StoreError
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import Sequence, parse_sequence, sequence_toml
from thermo.station.journal import Journal
from thermo.station.outcome import (
    GO_ON,
    ChamberOccupiedError,
    Decision,
    EndedError,
    InterferedError,
    Observer,
    Observers,
    RunControl,
    Status,
    TestOutcome,
)
from thermo.station.quality import find_bad_shares
from thermo.station.reading import inputs_of, scan_channels
from thermo.station.resume_point import ResumePoint, find_resume_point, is_own
from thermo.station.run import Run
from thermo.station.run_in import decide_run_in
from thermo.station.safe_end import clean_up, one_line, safe_json
from thermo.station.session import Heartbeat, Session, no_heartbeat
from thermo.station.uniformity import judge_test
from thermo.store.database import StoreAwayError
from thermo.store.store import NewTest, Store

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
    take_over: bool = False,
    heartbeat: Heartbeat = no_heartbeat,
) -> TestOutcome:
    """Run a test sequence, or go on with an interrupted one.

    However it ends (at its end, by a limit, a lost instrument, the operator, a signal or any
    exception), the chamber is put into its safe condition and that is verified, the head is
    stopped, and both are stored with the test. What this sitting has not commanded is not
    written to: a resumed test too takes charge of the chamber with its first command. Signals are
    the caller's business: turn them into `RunControl.abort`, as
    `thermo.launch.real.run_on_station` does.

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
    take_over : bool
        Whether a chamber that somebody else uses is taken over; it is an event of the test.
    heartbeat : callable
        Called around every call of an instrument, in every slice of a wait and in the clean-up.
        What it raises ends the test; what it returns becomes events.

    Returns
    -------
    TestOutcome

    Raises
    ------
    InputError
        When the station cannot do what the sequence asks; nothing was commanded or stored.
    StoreError
        When the test cannot be begun or resumed; nothing was commanded.
    ChamberOccupiedError
        When somebody else uses the chamber; nothing was commanded or stored.
    RecognitionError
        When the chamber's controller is not the station file's; nothing was commanded or stored.
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
        except BaseException:
            store.claim(resume).release()
            raise
    test = _Test(
        plan, station, store, clock, Observers(observers), control or RunControl(), heartbeat
    )
    return test.run(resume, before_command or (lambda _: None), take_over=take_over)


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
        heartbeat: Heartbeat,
    ) -> None:
        self._plan = plan
        self._station = station
        self._store = store
        self._clock = clock
        self._observers = observers
        self._control = control
        self._heartbeat = heartbeat
        self._test_id = ""
        self._resumed = False
        self._session: Session | None = None
        self._unjudged: int | None = None  # the run done last, while its ramps are not judged
        self._decision = GO_ON

    def run(
        self, resume: str | None, before_command: Callable[[str], None], *, take_over: bool
    ) -> TestOutcome:
        end = _End()
        self._test_id, self._resumed = resume or "", resume is not None
        try:
            with self._telling(end):
                identities = self._station.identify()
                occupied = self._occupation(take_over=take_over)
                session, point = self._begin(identities)
                for text in occupied:
                    session.journal.event("take-over", text)
                self._procedure(session, point, before_command)
                end.status = "finished"
        finally:
            # also on the way of an exception that nobody above expected
            outcome = self._end(end)
        return outcome

    @contextmanager
    def _telling(self, end: _End) -> Generator[None]:
        """Make an exception the reason of the end; what says that nothing was begun goes on."""
        try:
            yield
        except ChamberOccupiedError as err:
            end.reason = one_line(err)
            raise
        except RecognitionError as err:
            end.reason = one_line(err)
            if self._session is None:  # the station file is wrong, or the controller is another
                raise
        except EndedError as err:
            end.status, end.reason = err.status, one_line(err)
        except (KeyboardInterrupt, SystemExit) as err:
            end.status, end.reason = "interrupted", type(err).__name__
        except (InstrumentError, StoreError) as err:
            end.status, end.reason = "failed", one_line(err)
        except Exception as err:
            log.exception("the test ends by an error of the program")
            end.status, end.reason = "failed", f"{type(err).__name__}: {one_line(err)}"

    # ---- the procedure ----

    def _occupation(self, *, take_over: bool) -> tuple[str, ...]:
        """Return what the chamber is found to do; raise when it may be somebody else's."""
        occupied = self._station.chamber.read_occupation()
        if not occupied or take_over:
            return occupied
        if self._resumed and is_own(
            occupied, self._store, self._test_id, self._plan, self._station
        ):
            return tuple(f"{text}, as this test left it" for text in occupied)
        raise ChamberOccupiedError(
            f"chamber {self._station.config.chamber.url}: {'; '.join(occupied)}; nothing was "
            "commanded. Free it at its panel, or start with --take-over"
        )

    def _begin(self, identities: dict[str, str]) -> tuple[Session, ResumePoint | None]:
        """Enter the test, or its resumption, into the store, and find where it begins."""
        station, plan = self._station, self._plan
        channels = scan_channels(
            inputs_of(plan.sequence, station.config), station.config.signal_channels
        )
        station.digitiser.configure(channels, nplc=station.config.digitiser.nplc)
        if self._resumed:
            self._store.reopen_test(self._test_id)
        else:
            self._test_id = self._store.begin_test(
                NewTest(
                    name=plan.sequence.name,
                    sequence_toml=sequence_toml(plan.sequence),
                    station_json=station.config.model_dump_json(),
                    versions=_versions(),
                    settings={"identity": identities, **station.read_settings()},
                )
            )
        journal = Journal(self._store, self._test_id, self._observers, self._clock)
        session = Session(plan, station, self._clock, journal, self._control, self._heartbeat)
        self._session = session
        if self._resumed:
            journal.event("resumed", f"on {station.config.chamber.url}")
            point = find_resume_point(self._store, self._test_id, plan, self._clock)
        else:
            journal.event("begun", f"{plan.runs} runs of {plan.slots} slots")
            point = ResumePoint(run=1)
        return session, point

    def _procedure(
        self, session: Session, point: ResumePoint | None, before_command: Callable[[str], None]
    ) -> None:
        """Do what is left of the test."""
        before_command(self._test_id)
        if point is not None:
            first = self._resumed and point.run > 1
            self._runs(session, point, pause_first=first)
        session.commanded = True  # the safe end belongs to the test, also if nothing else was left

    def _decide(self, session: Session, number: int) -> Decision:
        """Decide, from what is stored, whether the test goes on after a run."""
        decision = GO_ON
        if self._plan.sequence.run_in is not None:
            session.journal.run = number  # after a resumption it is nobody's yet
            decision = decide_run_in(self._store, self._test_id, self._plan.sequence, number)
        for line in decision.lines:
            session.journal.event(decision.kind, line)
        return decision

    def _runs(self, session: Session, point: ResumePoint, *, pause_first: bool) -> None:
        """Do the runs that are left, or as many as are needed; the last one is not judged yet."""
        plan = self._plan
        for number in range(point.run, plan.runs + 1):
            after_s = (plan.runs - number) * (plan.rest_s + plan.approach_s + plan.run_s)
            begun = number == point.run and point.start_s is not None
            # before every new run, not after every one done: a resumed test asks again
            if not begun and number > 1:
                self._judge_ramps(session)
                with suppress(InterferedError):  # what comes next commands the chamber anew
                    session.look_at_chamber(None)  # between two questions to a store that is away
                self._decision = self._decide(session, number - 1)
                if self._decision.stop:
                    return
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
            with suppress(InterferedError):  # no reading of this run comes after it
                session.look_at_chamber(None)  # what was changed since the last reading is told
            self._store.finish_run(self._test_id, number, "finished")
            journal.event("run finished", f"run {number} of {plan.runs}")
            self._unjudged = number

    def _judge_ramps(self, session: Session) -> None:
        """Judge the ramps of the run that was done last, once."""
        number, self._unjudged = self._unjudged, None
        if number is None:
            return
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
        session.go_to(plan.rest_temp_c, "rest", left_s, until_s=end_s)
        journal.event("power on", "the rest is over")

    # ---- the end ----

    def _judge(self, session: Session, end: _End) -> None:
        """Judge what was read, and say why the test is done.

        The chamber is safe by now: it does not wait for a store that does not answer.
        """
        self._judge_ramps(session)
        session.beat()
        if not self._decision.stop:
            self._decision = self._decide(session, self._plan.runs)
        self._judge_shares(session)
        complaints = session.journal.complaints
        for text in complaints:
            session.journal.event("complaint", text)
        how = f", with {len(complaints)} complaints" if complaints else ""
        end.reason = self._decision.reason + how

    def _judge_shares(self, session: Session) -> None:
        try:
            bad = find_bad_shares(self._store, self._test_id, self._plan, session.beat)
        except StoreAwayError as err:  # the test is done, and whether it is good is not known
            bad = [f"readings missed and flagged are not judged: {err}"]
        for text in bad:
            session.journal.complain(text)

    def _end(self, end: _End) -> TestOutcome:
        session, station = self._session, self._station
        done = clean_up(
            station.chamber,
            station.head,
            station.config.chamber.safe_temp_c,
            self._clock,
            chamber_commanded=session is not None and session.commanded,
            head_commanded=session is not None and session.head_commanded,
            heartbeat=self._heartbeat,
        )
        if done.fenced:
            end.status, end.reason = "failed", done.fenced
        if session is not None and end.status == "finished":
            with self._telling(end):
                self._judge(session, end)
        if done.chamber.commanded and not done.chamber.verified:
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
            complaints=tuple(session.journal.complaints) if session else (),
        )

    def _record(self, end: _End, safe: SafeResult) -> str:
        """Store how the test ended, and return why; a store that refuses becomes part of that."""
        session = self._session
        if session is None:  # it was not begun, or is what it was before it was to be resumed
            if self._resumed:
                self._store.claim(self._test_id).release()
            return end.reason
        try:
            kind = "safe" if safe.verified else "not safe"
            session.journal.event(
                kind if safe.commanded else "not commanded", "; ".join(safe.steps)
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
