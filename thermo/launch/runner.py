"""The runner: starts what people ask for and what is due in the queue, in detached controllers.

It holds no test: what it has started goes on without it, and what it finds when it starts again is
all in the store.
"""

import json
import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

from drivers.errors import InstrumentError
from drivers.station import StationConfig
from errormodel.errors import InputError, StoreError, WorkbenchError
from thermo.launch.arming import Check, check_arming
from thermo.launch.dead_controllers import settle_dead_controllers
from thermo.launch.detached import NotStartedError, Started, start_detached
from thermo.planning.sequence import parse_sequence
from thermo.station.job import Job, make_job, make_resumed_job
from thermo.station.link.controller import this_process
from thermo.store.operation.alarms import raise_alarm
from thermo.store.operation.commands import OF_THE_RUNNER, Command, answer, take_next
from thermo.store.operation.planned import (
    PlannedTest,
    begin_starting,
    list_planned,
    read_planned,
    refuse_start,
)
from thermo.store.store import Store, open_store

log = logging.getLogger(__name__)

TURN_S = 0.5  # between two looks, real s
AGAIN_S = 2.0  # after the store refused
CLAIM = "the-runner"

Tell = Callable[[str], None]
Answer = Literal["done", "refused"]


class Runner:
    """Carries out `start` and `resume_test`, and the queue of planned tests.

    Parameters
    ----------
    store_url : str
    notify : Path, optional
        Given to the controllers it starts.
    tell : callable
        Told in a line what is done.
    """

    def __init__(
        self, store_url: str, *, notify: Path | None = None, tell: Tell = log.info
    ) -> None:
        self._url = store_url
        self._notify = notify
        self._tell = tell

    def run(self, stop: threading.Event) -> None:
        """Work until `stop` is set; the tests that it has started go on.

        Raises
        ------
        StoreError
            At the start only: the store does not answer, or another runner works on it.
        """
        store: Store | None = open_store(self._url)
        try:
            self._begin(store)
            while not stop.is_set():
                wait_s = TURN_S
                try:
                    store = store or self._open_again()
                    self.turn(store)
                except StoreError as err:
                    log.warning("%s", err)
                    if store is not None:
                        store.close()
                    store, wait_s = None, AGAIN_S
                stop.wait(wait_s)
        finally:
            if store is not None:
                store.close()

    def _open_again(self) -> Store:
        store = open_store(self._url, existing=True)
        try:
            self._begin(store)
        except BaseException:
            store.close()
            raise
        return store

    def _begin(self, store: Store) -> None:
        """Take the store's one place for a runner, and see to what the last one left half done."""
        try:
            store.claim(CLAIM)
        except StoreError as err:
            _, _, who = str(err).partition("is being run by ")
            raise StoreError(f"another runner works on this store: {who or err}") from None
        for planned in list_planned(store, open_only=True):
            if planned.state == "starting":
                said = "the runner ended while it was being started; see whether it runs, then arm"
                self._refuse(store, planned.number, said)

    def turn(self, store: Store) -> None:
        """Do once what there is to do."""
        for test_id in settle_dead_controllers(store, self._url):
            self._tell(f"test {test_id}: its controller is gone")
        while (command := take_next(store, by=this_process(), actions=OF_THE_RUNNER)) is not None:
            self._carry_out(store, command)
        for planned in list_planned(store, open_only=True):
            if planned.state == "armed" and _is_due(store, planned):
                self._start(store, planned.number)

    # ---- parts of the above

    def _carry_out(self, store: Store, command: Command) -> None:
        if command.action == "resume_test":
            told = self._resume(command)
        else:
            told = self._start_asked(store, command)
        answer(store, command.number, *told)
        self._tell(f"{command.action} by {command.who}: {told[1]}")

    def _start_asked(self, store: Store, command: Command) -> tuple[Answer, str]:
        number = command.arguments.get("planned")
        if not isinstance(number, float):
            return "refused", "which planned test is not said"
        try:
            planned = read_planned(store, int(number))
        except StoreError as err:
            return "refused", str(err)
        if planned.state != "armed":
            return "refused", f"planned test {planned.number} is {planned.state}: arm it first"
        return self._start(store, planned.number)

    def _start(self, store: Store, number: int) -> tuple[Answer, str]:
        """Start an armed test after a last look at everything that it needs."""
        try:
            planned = begin_starting(store, number)
        except StoreError as err:
            return "refused", str(err)
        try:
            job = planned_job(planned, self._url)
            _need_green(check_arming(job.sequence, _given(job), self._url))
            started = self._launch(job, speed=planned.speed, planned=number)
        except (WorkbenchError, InstrumentError) as err:
            self._refuse(store, number, str(err))
            return "refused", f"planned test {number}: {err}"
        said = f"planned test {number} has begun as test {started.test_id}"
        self._tell(said)
        return "done", said

    def _resume(self, command: Command) -> tuple[Answer, str]:
        test_id, speed = command.test_id, command.arguments.get("speed")
        if test_id is None:
            return "refused", "which test is not said"
        try:
            job = make_resumed_job(test_id, self._url)
            started = self._launch(job, speed=speed if isinstance(speed, float) else None)
        except (WorkbenchError, InstrumentError) as err:
            return "refused", str(err)
        return "done", f"test {test_id} goes on in process {started.pid}"

    def _launch(self, job: Job, *, speed: float | None, planned: int | None = None) -> Started:
        return start_detached(job, speed=speed, planned=planned, notify=self._notify)

    def _refuse(self, store: Store, number: int, why: str) -> None:
        with suppress(StoreError):  # its own process has said so already
            refuse_start(store, number, why)
        raise_alarm(store, "not started", f"planned test {number}: {why}")
        self._tell(f"planned test {number} was not started: {why}")


def planned_job(planned: PlannedTest, store_url: str) -> Job:
    """Return the job of a planned test.

    Raises
    ------
    InputError
        If sequence and station do not agree.
    """
    source = f"planned test {planned.number}"
    sequence, station = parse_sequence(planned.sequence_toml, source), None
    if planned.station_json is not None:
        try:
            station = StationConfig.model_validate_json(planned.station_json)
        except ValueError as err:
            raise InputError(source, "station", str(err)) from None
    return make_job(sequence, store_url, station, source=source)


def _given(job: Job) -> StationConfig | None:
    return None if job.emulated else job.station


def _need_green(checks: tuple[Check, ...]) -> None:
    red = [f"{c.name}: {c.found}. {c.remedy}" for c in checks if not c.passed]
    if red:
        raise NotStartedError("; ".join(red))


def _is_due(store: Store, planned: PlannedTest) -> bool:
    """Return True if the test it follows came to a good end, with the chamber verified safe."""
    if planned.after_id is None:
        return False
    before = read_planned(store, planned.after_id)
    if before.state != "finished" or before.test_id is None:
        return False
    safe = store.test(before.test_id).safe_result_json
    return bool(safe) and json.loads(safe).get("verified") is True
