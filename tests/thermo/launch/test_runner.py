"""The queue: what starts, what waits for a person, and what never starts again by itself."""

from pathlib import Path

import pytest

from errormodel.errors import StoreError
from tests.thermo.launch.test_dead_controllers import wait_until
from tests.thermo.store.short_test import NEW
from thermo.launch import runner as runner_module
from thermo.launch.detached import NotStartedError, Started
from thermo.launch.runner import Runner
from thermo.station.job import Job
from thermo.store.operation.alarms import list_alarms
from thermo.store.operation.commands import ask, read_command
from thermo.store.operation.planned import (
    arm_test,
    end_planned,
    has_begun,
    list_planned,
    plan_test,
    read_planned,
)
from thermo.store.store import Store, open_store

SHORT = Path(__file__).parents[3] / "examples/sequences/short.toml"
TEXT = SHORT.read_text(encoding="utf-8")
SAFE, UNSAFE = '{"verified": true}', '{"verified": false}'


class Launches:
    """Stands in for detached controllers: enters tests as they do, and ends them as it is told."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.started: list[int] = []
        self.refusal = ""

    def __call__(self, job: Job, *, planned: int, **_: object) -> Started:
        if self.refusal:
            raise NotStartedError(self.refusal)
        self.started.append(planned)
        test_id = self._store.begin_test(NEW)
        has_begun(self._store, planned, test_id)
        return Started(test_id=test_id, pid=1)

    def end(self, number: int, status: str, safe: str = SAFE) -> None:
        test_id = read_planned(self._store, number).test_id
        assert test_id is not None
        self._store.finish_test(test_id, status, "over", safe)
        end_planned(self._store, number, status, "over")


@pytest.fixture
def store(tmp_path):
    with open_store(tmp_path / "store.sqlite") as opened:
        yield opened


@pytest.fixture
def launches(store, monkeypatch) -> Launches:
    made = Launches(store)
    monkeypatch.setattr(runner_module, "start_detached", made)
    return made


@pytest.fixture
def runner(store) -> Runner:
    return Runner(str(store.path))


def planned(store: Store, after: int | None = None, *, armed: bool = True) -> int:
    number = plan_test(store, name="short", sequence_toml=TEXT, after=after, who="anna")
    if armed:
        arm_test(store, number, who="anna")
    return number


def start(store: Store, number: int) -> int:
    return ask(store, "start", who="anna", arguments={"planned": float(number)})


def test_an_armed_test_waits_until_somebody_starts_it(store, launches, runner):
    number = planned(store)
    runner.turn(store)
    assert launches.started == []
    asked = start(store, number)
    runner.turn(store)
    assert launches.started == [number]
    assert read_command(store, asked).state == "done"
    assert str(read_planned(store, number).test_id) in read_command(store, asked).outcome


def test_one_that_is_not_armed_is_refused(store, launches, runner):
    number = planned(store, armed=False)
    asked = [start(store, number), start(store, 99)]
    runner.turn(store)
    assert launches.started == []
    assert [read_command(store, n).state for n in asked] == ["refused"] * 2
    assert "arm it first" in read_command(store, asked[0]).outcome


def test_the_next_starts_only_armed_and_after_a_good_end(store, launches, runner):
    first = planned(store)
    second = planned(store, after=first, armed=False)
    third = planned(store, after=second)
    start(store, first)
    runner.turn(store)
    runner.turn(store)
    assert launches.started == [first]
    launches.end(first, "finished")
    runner.turn(store)
    assert launches.started == [first]  # the next is not armed
    arm_test(store, second, who="bert")
    runner.turn(store)
    runner.turn(store)
    assert launches.started == [first, second]
    launches.end(second, "finished")
    runner.turn(store)
    assert launches.started == [first, second, third]


@pytest.mark.parametrize(
    ("status", "safe"), [("failed", SAFE), ("interrupted", SAFE), ("finished", UNSAFE)]
)
def test_after_a_bad_end_nothing_starts_by_itself(store, launches, runner, status, safe):
    first = planned(store)
    second = planned(store, after=first)
    start(store, first)
    runner.turn(store)
    launches.end(first, status, safe)
    for _ in range(3):
        runner.turn(store)
    assert launches.started == [first]
    again = start(store, first)  # nor is the one that is over started anew
    runner.turn(store)
    assert read_command(store, again).state == "refused"
    start(store, second)  # a person decides
    runner.turn(store)
    assert launches.started == [first, second]


def test_why_one_was_not_started_is_an_alarm_and_it_has_to_be_armed_anew(store, launches, runner):
    number = planned(store)
    launches.refusal = "the chamber is in use"
    asked = start(store, number)
    runner.turn(store)
    assert read_command(store, asked).state == "refused"
    assert (read_planned(store, number).state, "in use" in read_planned(store, number).outcome) == (
        "refused", True
    )  # fmt: skip
    (alarm,) = list_alarms(store)
    assert (alarm.kind, "in use" in alarm.text) == ("not started", True)
    launches.refusal = ""
    runner.turn(store)
    assert launches.started == []


def test_two_runners_do_not_work_on_one_store(store, launches, runner):
    import threading

    stop = threading.Event()
    stop.set()
    store.claim(runner_module.CLAIM)
    with pytest.raises(StoreError, match="another runner works on this store: process"):
        runner.run(stop)


@pytest.mark.slow
def test_two_tests_in_a_row_are_run_by_processes_of_their_own(store, runner):
    first = planned(store)
    second = planned(store, after=first)
    asked = start(store, first)

    def over() -> bool:
        runner.turn(store)
        return not list_planned(store, open_only=True)

    wait_until(over)
    assert read_command(store, asked).state == "done"
    states = [read_planned(store, n).state for n in (first, second)]
    assert states == ["finished", "finished"]
    assert [t.status for t in store.tests()] == ["finished"] * 2
