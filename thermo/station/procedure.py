"""A chamber test from its beginning to its safe end, with any instruments and any clock."""

import logging
import platform
from collections.abc import Callable, Generator
from collections.abc import Sequence as Many
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata

from drivers.clock import Clock
from drivers.devices import SafeResult
from drivers.errors import InstrumentError, RecognitionError
from drivers.opening import Station
from errormodel.errors import StoreError
from thermo.planning.sequence import sequence_toml
from thermo.station.job import Job
from thermo.station.journal import Journal
from thermo.station.outcome import (
    ChamberOccupiedError,
    EndedError,
    Observer,
    Observers,
    RunControl,
    Status,
    TestOutcome,
)
from thermo.station.reading import inputs_of, scan_channels
from thermo.station.resume_point import ResumePoint, find_resume_point, is_own
from thermo.station.runs import RunSeries
from thermo.station.safe_end import clean_up, one_line, safe_json
from thermo.station.session import Heartbeat, Session, no_heartbeat
from thermo.store.operation.alarm_kinds import Kind
from thermo.store.records import NewTest
from thermo.store.store import Store

log = logging.getLogger(__name__)

VERSIONS_OF = ("accelbench", "numpy", "scipy", "pymodbus", "pyserial", "SQLAlchemy")


@dataclass(slots=True)
class _End:
    """Status and reason of the procedure's end; the initial values are those of a crash."""

    status: Status = "failed"
    reason: str = "ended without a reason"
    kind: Kind = "program error"


def run_test(
    job: Job,
    station: Station,
    store: Store,
    clock: Clock,
    *,
    observers: Many[Observer] = (),
    control: RunControl | None = None,
    before_command: Callable[[str], None] | None = None,
    take_over: bool = False,
    heartbeat: Heartbeat = no_heartbeat,
) -> TestOutcome:
    """Run a test or resume an interrupted one.

    However it ends (at its end, by a limit, a lost instrument, the operator, a signal or any
    exception), the chamber is put into its safe condition and that is verified, the head is
    stopped, and both are stored with the test. Nothing is written to an instrument that this
    session has not commanded; a resumed test also takes control of the chamber with its first
    command. The caller must convert signals into `RunControl.abort`, as
    `thermo.launch.real.run_on_station` does.

    Parameters
    ----------
    job : Job
        The caller has claimed the test that it goes on with.
    station : Station
        The job's station, open.
    store : Store
        The job's store, open.
    clock : Clock
        The clock of the station.
    observers : sequence of Observer
    control : RunControl, optional
        The operator's control.
    before_command : callable, optional
        Called with the identifier of the test before the first command to the chamber; an exception
        ends the test. The guardian is started here.
    take_over : bool
        True to take over a chamber in use; this is recorded as an event.
    heartbeat : callable
        Called around every call of an instrument, in every slice of a wait and in the clean-up. An
        exception ends the test; returned lines become events.

    Returns
    -------
    TestOutcome

    Raises
    ------
    StoreError
        When the test cannot be begun or resumed; nothing was commanded.
    ChamberOccupiedError
        When somebody else uses the chamber; nothing was commanded or stored.
    RecognitionError
        If the controller does not agree with the station file; nothing was commanded or stored.
    """
    point: ResumePoint | None = ResumePoint(run=1)
    if job.resume is not None:  # before any query to an instrument
        point = find_resume_point(store, job.resume, job.plan, clock)
    test = _Test(
        job, point, station, store, clock, Observers(observers), control or RunControl(), heartbeat
    )
    return test.run(before_command or (lambda _: None), take_over=take_over)


class _Test:
    """One session, from the first query of an instrument to the safe end."""

    def __init__(
        self,
        job: Job,
        point: ResumePoint | None,
        station: Station,
        store: Store,
        clock: Clock,
        observers: Observers,
        control: RunControl,
        heartbeat: Heartbeat,
    ) -> None:
        self._plan = job.plan
        self._resumed = job.resume is not None
        self._test_id = job.resume or ""
        self._point = point  # None: every run is finished
        self._station = station
        self._store = store
        self._clock = clock
        self._observers = observers
        self._control = control
        self._heartbeat = heartbeat
        self._session: Session | None = None
        self._runs: RunSeries | None = None

    def run(self, before_command: Callable[[str], None], *, take_over: bool) -> TestOutcome:
        end = _End()
        try:
            with self._telling(end):
                identities = self._station.identify()
                occupied = self._occupation(take_over=take_over)
                session, runs = self._begin(identities)
                for text in occupied:
                    session.journal.event("take-over", text)
                before_command(self._test_id)
                if self._point is not None:
                    runs.do(self._point, rest_first=self._resumed and self._point.run > 1)
                session.commanded = True  # the safe end is part of every test
                end.status = "finished"
        finally:
            # also on the way of an exception that nobody above expected
            outcome = self._end(end)
        return outcome

    @contextmanager
    def _telling(self, end: _End) -> Generator[None]:
        """Make an exception the reason of the end; re-raise if nothing was begun."""
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
            end.status, end.reason, end.kind = err.status, one_line(err), err.kind
        except (KeyboardInterrupt, SystemExit) as err:
            end.status, end.reason, end.kind = "interrupted", type(err).__name__, "interrupted"
        except (InstrumentError, StoreError) as err:
            end.status, end.reason = "failed", one_line(err)
            end.kind = "store" if isinstance(err, StoreError) else "link lost"
        except Exception as err:
            log.exception("the test ended because of an error of the program")
            end.status, end.reason = "failed", f"{type(err).__name__}: {one_line(err)}"
            end.kind = "program error"

    # ---- the beginning ----

    def _occupation(self, *, take_over: bool) -> tuple[str, ...]:
        """Return the state of the chamber; raise if it may be in use by somebody else."""
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

    def _begin(self, identities: dict[str, str]) -> tuple[Session, RunSeries]:
        """Enter the test, or its resumption, into the store."""
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
        self._session, self._runs = session, RunSeries(session)
        if self._resumed:
            journal.event("resumed", f"on {station.config.chamber.url}")
        else:
            journal.event("begun", f"{plan.runs} runs of {plan.slots} slots")
        return session, self._runs

    # ---- the end ----

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
            end.status, end.reason, end.kind = "failed", done.fenced, "guardian"
        if self._runs is not None and end.status == "finished":
            with self._telling(end):
                end.reason = self._runs.judge()
        if done.chamber.commanded and not done.chamber.verified:
            log.error("the chamber's safe condition is not verified: %s", done.chamber.steps)
        reason = self._record(end, done.chamber)
        complaints = tuple(session.journal.complaints) if session else ()
        if end.status == "finished":
            end.kind = "complaint" if complaints else "finished"
        return TestOutcome(
            test_id=self._test_id,
            status=end.status,
            reason=reason,
            safe=done.chamber,
            head_stopped=done.head_stopped,
            readings=session.journal.readings if session else 0,
            skipped=session.journal.skipped if session else 0,
            flagged=session.journal.flagged if session else 0,
            complaints=complaints,
            kind=end.kind,
        )

    def _record(self, end: _End, safe: SafeResult) -> str:
        """Store the end of the test and return its reason, including a refusal by the store."""
        session = self._session
        if session is None:  # it was not begun, or is unchanged since before the resumption
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
