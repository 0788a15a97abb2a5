import threading

import pytest
from pydantic import ValidationError

from drivers.clock import SteppedClock
from drivers.emulators.faults import PANEL_KINDS, REPLY_KINDS, STATE_KINDS, FaultPlan
from drivers.station import FaultConfig


def fault(kind, at_s=0.0, device="chamber", **more):
    return FaultConfig(device=device, kind=kind, at_s=at_s, **more)


def test_every_kind_is_a_spoiled_reply_a_state_or_done_at_the_panel():
    from typing import get_args

    from drivers.station import FaultKind

    kinds = [*REPLY_KINDS, *STATE_KINDS, *PANEL_KINDS]
    assert sorted(kinds) == sorted(get_args(FaultKind))


def test_reply_fault_is_due_by_the_clock_and_consumed_once_per_count():
    clock = SteppedClock(100.0)
    plan = FaultPlan([fault("silence", 10.0, count=2)], "chamber", clock)
    assert plan.take_reply_fault() is None
    clock.sleep_until_s(110.0)
    assert [plan.take_reply_fault() for _ in range(3)] == ["silence", "silence", None]


def test_faults_of_other_devices_are_passed_over():
    plan = FaultPlan([fault("silence", device="head")], "chamber", SteppedClock())
    assert plan.take_reply_fault() is None


def test_the_fault_due_longest_goes_first():
    clock = SteppedClock()
    plan = FaultPlan([fault("exception", 5.0), fault("silence", 1.0)], "chamber", clock)
    clock.sleep_until_s(9.0)
    plan.inject("broken_crc")
    assert [plan.take_reply_fault() for _ in range(4)] == [
        "silence",
        "exception",
        "broken_crc",
        None,
    ]


def test_state_lasts_for_its_duration():
    clock = SteppedClock()
    plan = FaultPlan([fault("sensor_break", 5.0, duration_s=10.0)], "chamber", clock)
    seen = []
    for t in (0.0, 5.0, 14.9, 15.0):
        clock.sleep_until_s(t)
        seen.append(plan.active("sensor_break"))
    assert seen == [False, True, True, False]
    assert plan.take_reply_fault() is None, "a state spoils no reply"


def test_state_without_duration_lasts_until_cleared():
    clock = SteppedClock()
    plan = FaultPlan([], "chamber", clock)
    plan.inject("over_temperature")
    clock.sleep_until_s(1e9)
    assert plan.active("over_temperature")
    plan.clear()
    assert not plan.active("over_temperature")


def test_what_is_done_at_the_panel_is_due_by_the_clock_and_done_once():
    clock = SteppedClock()
    planned = [fault("loop_off", 20.0), fault("setpoint_changed", 10.0, temp_c=80.0)]
    plan = FaultPlan(planned, "chamber", clock)
    assert plan.take_panel_actions() == []
    clock.sleep_until_s(30.0)
    assert plan.take_reply_fault() is None, "it spoils no reply"
    assert plan.take_panel_actions() == [("setpoint_changed", 80.0), ("loop_off", None)]
    assert plan.take_panel_actions() == []


def test_what_is_done_at_the_panel_is_done_at_the_chambers():
    with pytest.raises(ValidationError, match="happens to the chamber, not to the head"):
        fault("loop_off", device="head")


@pytest.mark.parametrize(
    "call",
    [
        lambda: FaultPlan([], "oven", SteppedClock()),
        lambda: FaultPlan([], "head", SteppedClock(), late_s=0.0),
        lambda: FaultPlan([], "head", SteppedClock()).inject("fire"),  # type: ignore[arg-type]
        lambda: FaultPlan([], "head", SteppedClock()).inject("silence", count=0),
        lambda: FaultPlan([], "head", SteppedClock()).inject("sensor_break", duration_s=0.0),
        lambda: FaultPlan([], "head", SteppedClock()).active("silence"),
    ],
)
def test_misuse_is_a_value_error(call):
    with pytest.raises(ValueError, match=r"expected one of|must be|is not a state"):
        call()


def test_threads_together_consume_exactly_what_was_planned():
    plan = FaultPlan([fault("silence", count=200)], "chamber", SteppedClock())
    taken: list[str] = []

    def take():
        for _ in range(100):
            if plan.take_reply_fault() is not None:
                taken.append("x")

    threads = [threading.Thread(target=take) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(taken) == 200
