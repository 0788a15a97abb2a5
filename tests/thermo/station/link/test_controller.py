"""People act on a running test through its store: pause, resume, abort, heartbeats, alarms."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

from tests.thermo.station.running import run_test
from tests.thermo.station.test_store import PATIENCE_S, Outage
from thermo.station.link.controller import ControllerLink, Health
from thermo.station.outcome import RunControl, TestInterruptedError, TestOutcome
from thermo.store.operation.alarms import list_alarms
from thermo.store.operation.commands import Action, ask, list_commands, read_command
from thermo.store.operation.controllers import read_beat
from thermo.store.spool import bypass as store_bypass
from thermo.store.spool.spooled_store import open_spooled_store
from thermo.store.store import Store, open_store

GENEROUS_S = 120.0  # for another thread or process on a loaded machine

ASK = (
    "import sys, time; from thermo.store.store import open_store; "
    "from thermo.store.operation.commands import ask; "
    "print(ask(open_store(sys.argv[1]), 'pause', who='anna', test_id=sys.argv[2]), flush=True); "
    "time.sleep(1000)"
)


def wait_until(met: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + GENEROUS_S
    while not met():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


class Operator:
    """Acts on a test at chosen calls of its instruments: asks, and waits until that has acted.

    The test's clock stands still meanwhile, so that nothing depends on how fast anybody is.
    """

    def __init__(self, world, url: str) -> None:
        self.url = url
        self.test_id = ""
        self.control = RunControl()
        self.at: list[tuple[str, int, Callable[[], None]]] = []
        self.asked: list[int] = []
        self._counts: dict[str, int] = {}
        self._hook = world.hook
        world.hook = self

    def __call__(self, name: str) -> None:
        self._hook(name)
        self._counts[name] = self._counts.get(name, 0) + 1
        due = [act for call, n, act in self.at if (call, n) == (name, self._counts[name])]
        for act in due:
            act()

    def ask(self, action: Action, reason: str = "") -> Callable[[], None]:
        def asked() -> None:
            with open_store(self.url) as store:
                given = {"reason": reason} if reason else {}
                number = ask(store, action, who="anna", test_id=self.test_id, arguments=given)
                self.asked.append(number)
                self.wait_until_acted(store, number)

        return asked

    def wait_until_acted(self, store: Store, number: int) -> None:
        def acted() -> bool:
            command = read_command(store, number)
            if command.action == "abort" and not command.answered:
                return self._is_aborted()
            there = self.control.paused == (command.action == "pause")
            return command.answered or (command.state == "taken" and there)

        wait_until(acted)

    def _is_aborted(self) -> bool:
        try:
            self.control.check()
        except TestInterruptedError:
            return True
        return False

    def when_paused(self, act: Callable[[], None]) -> "OnPause":
        return OnPause(act)


class OnPause:
    """Acts once, when the test is first shown as paused."""

    def __init__(self, act: Callable[[], None]) -> None:
        self._act = act
        self._done = False

    def on_reading(self, run, rows) -> None:
        pass

    def on_event(self, event) -> None:
        pass

    def on_progress(self, progress) -> None:
        if progress.phase == "pause" and not self._done:
            self._done = True
            self._act()


def run_linked(
    sequence, station, store: Store, world, operator: Operator, *, observers=(), health=Health
) -> TestOutcome:
    """Run a test as the launch does, with its link."""
    control = operator.control
    with ControllerLink(
        operator.url, control, world.clock, sequence.sampling.period_s, health=health
    ) as link:

        def begin(test_id: str) -> None:
            operator.test_id = test_id
            link.begin(test_id)

        outcome = run_test(
            sequence, station, store, world.clock,
            control=control, before_command=begin, observers=(link.notes, *observers),
        )  # fmt: skip
        link.end(outcome)
    return outcome


@pytest.fixture
def operator(world, store) -> Operator:
    return Operator(world, str(store.path))


def commands_of(store: Store) -> list[tuple[str, str, str]]:
    return [(c.action, c.state, c.outcome) for c in list_commands(store)]


def test_a_test_is_paused_resumed_and_aborted_from_its_store(
    short, station, store, world, operator
):
    operator.at = [
        ("digitiser.scan", 10, operator.ask("pause", "a look")),
        ("digitiser.scan", 45, operator.ask("abort", "enough")),
    ]
    resume = operator.when_paused(operator.ask("resume"))
    outcome = run_linked(short, station, store, world, operator, observers=[resume])
    assert (outcome.status, outcome.kind) == ("interrupted", "aborted")
    assert outcome.reason == "aborted by anna: enough"
    assert world.is_safe
    pause, resumed, abort = commands_of(store)
    assert pause[:2] == ("pause", "done")
    assert "schedule held before slot" in pause[2]
    assert "paused by anna: a look" in pause[2]
    assert resumed[:2] == ("resume", "done")
    assert abort[:2] == ("abort", "done")
    assert "safe condition is verified" in abort[2]
    kinds = [e.kind for e in store.events(outcome.test_id)]
    assert kinds.index("pause") < kinds.index("pause over") < kinds.index("resoak")
    beat = read_beat(store, outcome.test_id)
    assert beat is not None
    assert (beat.state, beat.store) == ("ended", "answers")
    assert [a.kind for a in list_alarms(store)] == ["aborted"]


def test_a_pause_on_the_way_holds_the_chamber_where_it_is(short, station, store, world, operator):
    held: list[float] = []
    hold = station.chamber.hold_temp_c

    def hold_temp_c(temp_c: float) -> None:
        held.append(temp_c)
        hold(temp_c)

    station.chamber.hold_temp_c = hold_temp_c
    shown: list[float] = []

    class Shown(OnPause):
        def on_progress(self, progress) -> None:
            if progress.phase == "pause":
                shown.append(progress.commanded_c)
            super().on_progress(progress)

    operator.at = [("chamber.read_alarms", 1, operator.ask("pause"))]
    # the first alarm is read on the way to 20 °C; the chamber was told 20 °C before
    station.chamber.read_temp_c = lambda: 24.0 if len(held) < 2 else held[-1]
    resume = Shown(operator.ask("resume"))
    operator.at.append(("digitiser.scan", 3, operator.ask("abort")))
    outcome = run_linked(short, station, store, world, operator, observers=[resume])
    assert outcome.kind == "aborted", outcome
    assert held[:3] == [20.0, 24.0, 20.0]
    assert set(shown) == {24.0}


def test_an_operator_whose_process_is_killed_has_asked_all_the_same(
    short, station, store, world, operator
):
    def ask_and_die() -> None:
        with subprocess.Popen(
            [sys.executable, "-c", ASK, operator.url, operator.test_id],
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            number = int(process.stdout.readline())
            process.send_signal(signal.SIGKILL)
        operator.wait_until_acted(store, number)

    operator.at = [("digitiser.scan", 10, ask_and_die)]
    resume = operator.when_paused(operator.ask("resume"))
    outcome = run_linked(short, station, store, world, operator, observers=[resume])
    assert outcome.status == "finished", outcome
    assert [c[:2] for c in commands_of(store)] == [("pause", "done"), ("resume", "done")]
    assert [a.kind for a in list_alarms(store)] == ["finished"]


def test_what_cannot_be_done_is_refused_with_the_reason(short, station, store, world, operator):
    last = 2 * 28
    operator.at = [
        ("digitiser.scan", 10, operator.ask("resume")),
        ("digitiser.scan", last, operator.ask("pause")),
    ]
    outcome = run_linked(short, station, store, world, operator)
    assert outcome.status == "finished"
    resume, pause = commands_of(store)
    assert resume == ("resume", "refused", "the test is not paused")
    assert pause[:2] == ("pause", "refused")
    assert "the test ended before: all runs done" in pause[2]


def test_what_was_asked_before_a_resumption_is_not_done_after_it(
    short, station, store, world, operator
):
    operator.at = [("digitiser.scan", 10, operator.ask("abort"))]
    first = run_linked(short, station, store, world, operator)
    number = ask(store, "abort", who="bert", test_id=first.test_id)
    control = RunControl()
    with ControllerLink(operator.url, control, world.clock, 15.0) as link:

        def begin(test_id: str) -> None:
            link.begin(test_id)
            wait_until(lambda: read_command(store, number).answered)

        second = run_test(
            short, station, store, world.clock, resume=first.test_id,
            control=control, before_command=begin, observers=(link.notes,),
        )  # fmt: skip
        link.end(second)
    assert second.status == "finished"
    assert read_command(store, number).state == "refused"
    assert "resumed" in [a.kind for a in list_alarms(store, first.test_id)]


def test_no_reading_waits_for_the_link_while_the_store_is_locked(
    short, station, world, store_url, monkeypatch
):
    monkeypatch.setattr(store_bypass, "READ_PATIENCE_S", 0.5)
    operator = Operator(world, store_url)
    with open_spooled_store(store_url, patience_s=PATIENCE_S) as store:

        def health() -> Health:
            return Health(store=store.trouble)

        # the scan that gives the store back would never come if anything waited for it
        with Outage(world, store_url, begin=12, end=50) as outage:
            operator._hook = outage
            world.hook = operator
            outcome = run_linked(short, station, store, world, operator, health=health)
        assert store.settle(60.0) == ""
    assert outcome.status == "finished", outcome
    assert outcome.skipped == outcome.flagged == 0
    assert outage.readings_while_away == 37
    with open_store(store_url) as again:
        lateness_s = again.readings(outcome.test_id)["lateness_s"]
        assert lateness_s.max() < 1e-6  # the clock steps: any wait for the link would show
