import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from thermo.planning.schedule import Schedule

periods = st.floats(0.01, 1000)


def test_deadlines_are_absolute() -> None:
    schedule = Schedule(start_s=1e6, period_s=0.1)
    assert schedule.deadline_s(1_000_000) == pytest.approx(1e6 + 1e5, abs=1e-6)


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.inf, math.nan])
def test_a_period_that_is_none_is_refused(period_s: float) -> None:
    with pytest.raises(ValueError, match="period"):
        Schedule(start_s=0, period_s=period_s)


@given(periods, st.integers(0, 10_000), st.floats(0, 1))
def test_a_slot_up_to_a_period_late_is_still_taken(period: float, slot: int, late: float) -> None:
    schedule = Schedule(start_s=5.0, period_s=period)
    assert schedule.first_open(slot, schedule.deadline_s(slot) + late * period) == slot


@given(periods, st.integers(0, 10_000), st.floats(1.001, 500))
def test_slots_missed_wholly_are_left_out(period: float, slot: int, late: float) -> None:
    schedule = Schedule(start_s=5.0, period_s=period)
    now_s = schedule.deadline_s(slot) + late * period
    found = schedule.first_open(slot, now_s)
    assert found > slot
    # the slot taken is late by at most a period, and the one before it by more
    assert now_s - schedule.deadline_s(found) <= period * (1 + 1e-6)
    assert now_s - schedule.deadline_s(found - 1) > period * (1 - 1e-6)


def test_never_earlier_than_asked() -> None:
    assert Schedule(start_s=100.0, period_s=10.0).first_open(3, now_s=0.0) == 3


def test_moved() -> None:
    assert Schedule(start_s=1.0, period_s=2.0).moved(5.0).deadline_s(3) == 12.0
