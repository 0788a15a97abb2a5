"""Actions of a visitor: each checks the role, is logged, and goes through the store.

Every function may wait for a store or a controller, so pages call them in a thread.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from accelbench.panel.access.sessions import Sessions, Visitor
from accelbench.panel.access.users import Role
from accelbench.panel.action_log import ActionLog, Detail, log_path
from accelbench.panel.folders import TomlFolder
from accelbench.panel.jobs import KINDS, Jobs, results_path
from accelbench.panel.settings import PanelSettings
from drivers.errors import InstrumentError
from drivers.station import StationConfig
from errormodel.errors import InputError, WorkbenchError
from thermo.launch.arming import Check, all_passed, check_arming
from thermo.launch.control import ask_controller
from thermo.launch.notify import TITLE, deliver, read_notify
from thermo.launch.real import load_station
from thermo.planning.sequence import Sequence, load_sequence, parse_sequence, sequence_toml
from thermo.station.job import Job, make_job
from thermo.store.operation import alarms, planned
from thermo.store.operation.commands import Action, Argument, ask, read_command
from thermo.store.store import Store, open_store

START_PATIENCE_S = 200.0  # the runner waits so long for a test to begin
CONTROL_PATIENCE_S = 20.0
LOOK_S = 0.1


@dataclass(frozen=True, slots=True)
class Outcome:
    """End of an action: done or not, and a sentence."""

    done: bool
    said: str


@dataclass(frozen=True, slots=True)
class Actions:
    """The actions of the page.

    Parameters
    ----------
    settings : PanelSettings
    sessions : Sessions
    """

    settings: PanelSettings
    sessions: Sessions

    @property
    def log(self) -> ActionLog:
        """The log of actions."""
        return ActionLog(log_path(self.settings))

    @property
    def sequences(self) -> TomlFolder:
        """The folder of sequences."""
        return TomlFolder(self.settings.sequences)

    @property
    def stations(self) -> TomlFolder:
        """The folder of station files."""
        return TomlFolder(self.settings.stations)

    @property
    def jobs(self) -> Jobs:
        """Results made of stored tests."""
        return Jobs(results_path(self.settings), self.settings.store)

    def evaluate(self, visitor: Visitor, kind: str, tests: tuple[str, ...]) -> Outcome:
        """Start a fit, a comparison or a search for missing effects of stored tests."""

        def do() -> str:
            name = self.jobs.start(kind, tests, self._who(visitor))
            return f"{KINDS[kind][0]} of {len(tests)} test(s) has begun: {name}"

        return self._carry_out(visitor, "operate", f"evaluate: {kind}", do, tests=" ".join(tests))

    # ---- planning

    def save_sequence(self, visitor: Visitor, name: str, text: str) -> Outcome:
        """Check a sequence and keep it in the folder of sequences."""

        def do() -> str:
            parse_sequence(text, name)
            self.sequences.save(name, text)
            return f"{name} is kept in the folder of sequences"

        return self._carry_out(visitor, "operate", "save sequence", do, file=name)

    def job(self, sequence: str, station: str | None) -> Job:
        """Return the job of a sequence of the folder and a station of the folder.

        Raises
        ------
        InputError
            If a file is wrong, or they do not agree.
        """
        config = None if station is None else load_station(self.stations.file(station))
        given = load_sequence(self.sequences.file(sequence))
        return make_job(given, self.settings.store, config, source=sequence)

    def plan(
        self,
        visitor: Visitor,
        sequence: str,
        station: str | None,
        speed: float | None,
        after: int | None,
    ) -> Outcome:
        """Put a test into the queue."""

        def do() -> str:
            job = self.job(sequence, station)
            config = None if station is None else job.station
            if config is not None and config.emulation is None and speed is not None:
                raise InputError(
                    str(station), "", "real instruments have no time multiple; leave it empty"
                )
            with self._store() as store:
                number = planned.plan_test(
                    store,
                    name=job.sequence.name,
                    sequence_toml=sequence_toml(job.sequence),
                    station_json=None if config is None else config.model_dump_json(),
                    speed=speed,
                    after=after,
                    who=self._who(visitor),
                )
            return f"test {number} is planned: {job.sequence.name}"

        return self._carry_out(
            visitor, "operate", "plan", do, sequence=sequence, station=station, speed=speed
        )

    def check(self, visitor: Visitor, number: int) -> tuple[Check, ...]:
        """Look at everything that a planned test needs; nothing is commanded."""
        self.sessions.need(visitor, "view")
        with self._store() as store:
            one = planned.read_planned(store, number)
        return check_arming(*_job_of(one), self.settings.store)

    def arm(self, visitor: Visitor, number: int) -> tuple[tuple[Check, ...], Outcome]:
        """Look at everything again, and arm the test if all of it is good."""
        checks: tuple[Check, ...] = ()

        def do() -> str:
            nonlocal checks
            checks = self.check(visitor, number)
            red = [c.name for c in checks if not c.passed]
            if not all_passed(checks):
                raise InputError(f"planned test {number}", "", f"not good: {', '.join(red)}")
            with self._store() as store:
                planned.arm_test(store, number, who=self._who(visitor))
            return f"planned test {number} is armed"

        done = self._carry_out(visitor, "operate", "arm", do, planned=number)
        return checks, done

    def withdraw(self, visitor: Visitor, number: int) -> Outcome:
        """Take a planned test out of the queue."""

        def do() -> str:
            with self._store() as store:
                planned.withdraw_test(store, number, who=self._who(visitor))
            return f"planned test {number} is withdrawn"

        return self._carry_out(visitor, "operate", "withdraw", do, planned=number)

    def start(self, visitor: Visitor, number: int) -> Outcome:
        """Start an armed test and wait until it has begun."""
        return self._ask_runner(visitor, "start", planned=number)

    def resume_test(self, visitor: Visitor, test_id: str) -> Outcome:
        """Go on with an interrupted test, on the station it was begun on."""
        return self._ask_runner(visitor, "resume_test", test_id=test_id)

    # ---- running tests

    def control(self, visitor: Visitor, action: Action, test_id: str, reason: str) -> Outcome:
        """Pause, resume or abort a running test."""

        def do() -> str:
            with self._store() as store:
                command = ask_controller(
                    store,
                    action,
                    test_id,
                    who=self._who(visitor),
                    reason=reason,
                    patience_s=CONTROL_PATIENCE_S,
                )
            if command.state != "done":
                raise InputError(f"{action} {test_id}", command.state, command.outcome or "waits")
            return command.outcome

        return self._carry_out(visitor, "operate", action, do, test=test_id, reason=reason or None)

    def acknowledge(self, visitor: Visitor, number: int) -> Outcome:
        """Acknowledge an alarm."""

        def do() -> str:
            with self._store() as store:
                first = alarms.acknowledge(store, number, who=self._who(visitor))
            return f"alarm {number}: " + ("acknowledged" if first else "had been acknowledged")

        return self._carry_out(visitor, "operate", "acknowledge", do, alarm=number)

    def try_notices(self, visitor: Visitor) -> Outcome:
        """Send a trial to every address of the notices' file."""

        def do() -> str:
            config = read_notify(self.settings.notify)
            if config is None:
                raise InputError("notices", "", "no file says who is told; see --notify")
            text = f"A trial of accelbench's notices, sent by {self._who(visitor)}."
            failed = [error for url in config.urls if (error := deliver(url, TITLE, text))]
            if failed:
                raise InputError("notices", "", "; ".join(failed))
            return f"{len(config.urls)} address(es) took the trial"

        return self._carry_out(visitor, "operate", "try notices", do)

    # ---- parts of the above

    def _store(self) -> Store:
        return open_store(self.settings.store)

    def _who(self, visitor: Visitor) -> str:
        return visitor.name if self.sessions.everybody else f"{visitor.name} (page)"

    def _ask_runner(
        self,
        visitor: Visitor,
        action: Action,
        *,
        planned: int | None = None,
        test_id: str | None = None,
    ) -> Outcome:
        arguments: dict[str, Argument] = {} if planned is None else {"planned": float(planned)}

        def do() -> str:
            with self._store() as store:
                number = ask(
                    store, action, who=self._who(visitor), test_id=test_id, arguments=arguments
                )
                give_up_s = time.monotonic() + START_PATIENCE_S
                while not (command := read_command(store, number)).answered:
                    if time.monotonic() > give_up_s:
                        raise InputError(action, "", "nobody works on the queue")
                    time.sleep(LOOK_S)
            if command.state != "done":
                raise InputError(action, command.state, command.outcome)
            return command.outcome

        return self._carry_out(visitor, "operate", action, do, planned=planned, test=test_id)

    def _carry_out(
        self,
        visitor: Visitor,
        needed: Role,
        action: str,
        do: Callable[[], str],
        **details: Detail,
    ) -> Outcome:
        """Check the role, log what is asked, do it, and log what came of it."""
        who = self._who(visitor)
        try:
            self.sessions.need(visitor, needed)
        except WorkbenchError as err:
            self.log.write(who, action, f"refused: {err}", **details)
            return Outcome(done=False, said=str(err))
        try:
            self.log.write(who, action, "asked", **details)
            outcome = Outcome(done=True, said=do())
        except (WorkbenchError, InstrumentError) as err:
            outcome = Outcome(done=False, said=str(err))
        self.log.write(who, action, outcome.said, **details)
        return outcome


def _job_of(one: planned.PlannedTest) -> tuple[Sequence, StationConfig | None]:
    text = one.station_json
    station = None if text is None else StationConfig.model_validate_json(text)
    return parse_sequence(one.sequence_toml, f"planned test {one.number}"), station
