"""Every chamber driver's way to the safe condition, and the alarms it tells."""

import pytest

from drivers.chambers import watch as chamber_watch
from drivers.errors import DeviceError
from tests.drivers.chambers.emulated_chamber import RESOLUTION_C


def test_make_safe_ends_a_ramp_verifies_and_can_be_repeated(bench):
    bench.chamber.ramp_to_c(70.0, 1.0)
    bench.wait(600.0)
    for _ in range(2):
        result = bench.chamber.make_safe(25.0)
        assert result.verified, result.steps
        bench.wait(600.0)
        assert bench.chamber.read_setpoint_c() == pytest.approx(25.0, abs=RESOLUTION_C)
        assert bench.chamber.read_temp_c() == pytest.approx(25.0, abs=RESOLUTION_C)


def test_make_safe_works_from_a_fresh_link_when_the_first_was_left_lying(bench):
    bench.chamber.ramp_to_c(70.0, 1.0)
    bench.wait(60.0)
    bench.chamber.close()  # as the kernel does for a process that was killed
    fresh = bench.open()
    assert fresh.make_safe(25.0).verified
    bench.wait(60.0)
    assert fresh.read_temp_c() == pytest.approx(25.0, abs=RESOLUTION_C)


def test_make_safe_reports_and_does_not_raise_when_nobody_answers(bench):
    never_recognised = bench.open(retries=0)
    bench.emulator.close()
    result = bench.chamber.make_safe(25.0)
    assert not result.verified
    assert len(result.steps) >= 2
    assert all("failed" in step and "\n" not in step for step in result.steps)
    fresh = never_recognised.make_safe(25.0)
    assert (fresh.verified, fresh.commanded, len(fresh.steps)) == (False, False, 1)
    assert "not commanded: chamber: " in fresh.steps[0]


def test_make_safe_tries_every_step_when_one_is_refused(tcp_bench):
    tcp_bench.chamber.ramp_to_c(70.0, 1.0)
    tcp_bench.faults.inject("exception")
    result = tcp_bench.chamber.make_safe(25.0)
    assert result.verified, "the second pass succeeds"
    assert "once more:" in result.steps


def test_make_safe_recognises_and_lives_through_a_refusal_of_that(tcp_bench):
    fresh = tcp_bench.open()
    tcp_bench.faults.inject("exception")
    assert fresh.make_safe(25.0).verified


def test_make_safe_outside_the_limits_still_ends_the_ramp(tcp_bench, monkeypatch):
    monkeypatch.setattr(chamber_watch, "FOLLOW_S", 0.05)  # it will not go there, so why wait
    tcp_bench.chamber.ramp_to_c(70.0, 1.0)
    tcp_bench.wait(60.0)
    result = tcp_bench.chamber.make_safe(200.0)
    assert not result.verified
    before_c = tcp_bench.chamber.read_setpoint_c()
    # the F4 ends a profile at the static set point, where the ramp began
    here_c = 23.4 if tcp_bench.model == "watlow_f4" else 24.4
    assert before_c == pytest.approx(here_c, abs=RESOLUTION_C), "and not the ramp's target"
    tcp_bench.wait(600.0)
    assert tcp_bench.chamber.read_setpoint_c() == before_c


def test_sensor_break_is_an_alarm_and_no_temperature(bench):
    assert bench.chamber.read_alarms() == ()
    bench.faults.inject("sensor_break")
    with pytest.raises(DeviceError):
        bench.chamber.read_temp_c()
    assert bench.chamber.read_alarms() != ()
    bench.faults.clear()
    assert bench.chamber.read_alarms() == ()
    assert bench.chamber.read_temp_c() == pytest.approx(23.4, abs=RESOLUTION_C)


def test_over_temperature_is_an_alarm(tcp_bench):
    tcp_bench.faults.inject("over_temperature")
    tcp_bench.chamber.read_temp_c()
    tcp_bench.wait(740.0)  # 74 °C at 0.1 °C/s
    alarms = tcp_bench.chamber.read_alarms()
    assert any("over-temperature" in a for a in alarms)
    tcp_bench.wait(3600.0)
    tcp_bench.chamber.read_alarms()
    cut_off_c = tcp_bench.plant.air_temp_c(tcp_bench.clock.now_s())
    tcp_bench.wait(3600.0)
    assert tcp_bench.plant.air_temp_c(tcp_bench.clock.now_s()) == cut_off_c


def test_stuck_temperature_stays_and_comes_loose(tcp_bench):
    tcp_bench.faults.inject("stuck_temperature", duration_s=100.0)
    tcp_bench.chamber.read_temp_c()
    tcp_bench.chamber.hold_temp_c(50.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(23.4, abs=RESOLUTION_C)
    tcp_bench.wait(101.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(50.0, abs=RESOLUTION_C)
