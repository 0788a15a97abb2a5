"""Nothing is commanded that was not recognised, is in use, or was taken over."""

import json

import pytest

from drivers.errors import DeviceError, FencedError, LinkError, RecognitionError
from tests.thermo.station.commanding import PROFILE, abort_after, kill_after, kinds, writes
from tests.thermo.station.running import run_test
from thermo.station.outcome import ChamberOccupiedError, RunControl


@pytest.mark.parametrize("name", ["chamber", "digitiser", "head"])
def test_an_instrument_that_is_another_leaves_the_chamber_alone(short, station, store, world, name):
    def hook(call: str) -> None:
        if call == f"{name}.identify":
            raise DeviceError(f"{name}: shows 0 decimals, expected 1")

    world.hook = hook
    outcome = run_test(short, station, store, world.clock)
    assert (outcome.status, outcome.test_id) == ("failed", "")
    assert not outcome.safe.commanded
    assert not outcome.safe.verified
    assert writes(world) == []


@pytest.mark.parametrize("resumed", [False, True])
def test_a_controller_that_is_not_recognised_is_refused_and_nothing_is_stored(
    short, station, store, world, resumed
):
    test_id = None
    if resumed:
        control = RunControl()
        abort_after(world, control, 12)
        test_id = run_test(short, station, store, world.clock, control=control).test_id
    before, since = store.tests(), len(world.calls)

    def hook(call: str) -> None:
        if call == "chamber.identify":
            raise RecognitionError("chamber: not recognised: shows 0 decimals, expected 1")

    world.hook = hook
    sequence = None if resumed else short
    for _ in range(2):  # nobody is left holding it
        with pytest.raises(RecognitionError, match="shows 0 decimals"):
            run_test(sequence, station, store, world.clock, resume=test_id)
    assert writes(world, since) == []
    assert store.tests() == before


def test_a_guardian_that_does_not_start_leaves_the_chamber_alone(short, station, store, world):
    def refuse(_: str) -> None:
        raise LinkError("guardian: another test runs on the chamber")

    outcome = run_test(short, station, store, world.clock, before_command=refuse)
    assert outcome.status == "failed"
    assert not outcome.safe.commanded
    assert writes(world) == ["digitiser.configure"]
    record = store.test(outcome.test_id)
    assert json.loads(record.safe_result_json)["commanded"] is False
    assert "not commanded" in kinds(store, outcome.test_id)
    assert "not safe" not in kinds(store, outcome.test_id)


def test_a_chamber_in_use_is_refused_and_nothing_is_stored(short, station, store, world):
    station.chamber.occupation = PROFILE
    with pytest.raises(ChamberOccupiedError, match=r"profile 3 is running.*--take-over") as caught:
        run_test(short, station, store, world.clock)
    assert "\n" not in str(caught.value)
    assert writes(world) == []
    assert store.tests() == ()


def test_a_chamber_in_use_is_taken_over_when_asked(short, station, store, world):
    station.chamber.occupation = PROFILE
    outcome = run_test(short, station, store, world.clock, take_over=True)
    assert outcome.clean
    told = [e.text for e in store.events(outcome.test_id) if e.kind == "take-over"]
    assert told == list(PROFILE)


@pytest.mark.parametrize("found", [PROFILE, ("the loop is off",)])
def test_a_resumed_test_takes_no_chamber_that_it_had_left_safe(short, station, store, world, found):
    control = RunControl()
    abort_after(world, control, 12)
    test_id = run_test(short, station, store, world.clock, control=control).test_id
    world.hook = lambda _: None
    before, since = store.test(test_id), len(world.calls)
    station.chamber.occupation = found
    with pytest.raises(ChamberOccupiedError):
        run_test(None, station, store, world.clock, resume=test_id)
    assert writes(world, since) == []
    assert store.test(test_id) == before  # as it was, to be resumed later
    assert not store.is_claimed(test_id)
    station.chamber.occupation = ()
    assert run_test(None, station, store, world.clock, resume=test_id).clean


def test_a_killed_test_takes_up_the_profile_it_had_left_running(
    short, station, store, world, monkeypatch
):
    test_id = kill_after(store, station, world, short, 12, monkeypatch)
    station.chamber.occupation = PROFILE
    outcome = run_test(None, station, store, world.clock, resume=test_id)
    assert outcome.clean
    told = [e.text for e in store.events(test_id) if e.kind == "take-over"]
    assert told == ["profile 3 is running, as this test left it"]


@pytest.mark.parametrize(
    ("found", "setpoint_c"),
    [
        (PROFILE, 70.0),  # nothing of the programme leads there
        (("the loop is off",), 22.0),  # no test switches it off
        ((*PROFILE, "the set point is remote"), 22.0),
    ],
)
def test_a_killed_test_does_not_take_what_it_cannot_have_left(
    short, station, store, world, monkeypatch, found, setpoint_c
):
    test_id = kill_after(store, station, world, short, 12, monkeypatch)
    station.chamber.occupation = found
    world.setpoint_c = setpoint_c
    since = len(world.calls)
    with pytest.raises(ChamberOccupiedError):
        run_test(None, station, store, world.clock, resume=test_id)
    assert writes(world, since) == []


def test_a_killed_test_with_only_its_end_missing_makes_the_chamber_safe(
    edit_sequence, station, store, world, monkeypatch
):
    sequence = edit_sequence(("repeats = 2", "repeats = 1"))
    with monkeypatch.context() as dying:
        dying.setattr(store, "finish_test", lambda *_: None)
        test_id = run_test(sequence, station, store, world.clock).test_id
    store.claim(test_id).release()
    world.setpoint_c = 26.0
    outcome = run_test(None, station, store, world.clock, resume=test_id)
    assert outcome.clean
    assert world.is_safe


def test_a_controller_that_was_fenced_commands_nothing_more(short, station, store, world):
    fenced_at: list[int] = []

    def heartbeat() -> tuple[str, ...]:
        if world.calls.count("digitiser.scan") >= 12:
            fenced_at.append(len(world.calls))
            raise FencedError("the guardian has taken the chamber over")
        return ()

    outcome = run_test(short, station, store, world.clock, heartbeat=heartbeat)
    assert outcome.status == "failed"
    assert "guardian has taken" in outcome.reason
    assert not outcome.safe.verified
    assert "chamber.make_safe" not in world.calls
    assert not any("attempt" in step for step in outcome.safe.steps)  # it is not waited for
    assert [c for c in writes(world, fenced_at[0]) if c.startswith("chamber")] == []
