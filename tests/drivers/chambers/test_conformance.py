"""What every chamber driver does, whatever the controller and the wire."""

import pytest

from drivers.chambers.open import open_chamber
from drivers.errors import LimitError, RecognitionError
from drivers.station import ChamberConfig
from tests.drivers.chambers.emulated_chamber import RESOLUTION_C, Bench


def test_identifies_itself_and_tells_its_settings(bench):
    said = bench.chamber.identify()
    assert "23.4 °C" in said
    assert "-55 to 85 °C" in said
    settings = bench.chamber.read_settings()
    assert all(isinstance(v, str | float) for v in settings.values())
    assert len(settings) >= 5
    assert bench.chamber.counters.retries == 0
    assert bench.chamber.counters.reconnects == 0


def test_hold_goes_there_and_is_read_back(bench):
    for temp_c in (40.0, -40.5, 0.0):
        bench.chamber.hold_temp_c(temp_c)
        bench.wait(1.0)
        assert bench.chamber.read_setpoint_c() == pytest.approx(temp_c, abs=RESOLUTION_C)
        assert bench.chamber.read_temp_c() == pytest.approx(temp_c, abs=RESOLUTION_C)


def test_ramp_is_uniform_from_the_present_temperature(bench):
    bench.chamber.ramp_to_c(33.4, 1.0)
    bench.wait(0.0)
    seen = []
    for _ in range(12):
        seen.append((bench.chamber.read_setpoint_c(), bench.chamber.read_temp_c()))
        bench.wait(60.0)
    for minute, (setpoint_c, temp_c) in enumerate(seen):
        expected_c = min(23.4 + minute, 33.4)
        assert setpoint_c == pytest.approx(expected_c, abs=RESOLUTION_C)
        assert temp_c == pytest.approx(expected_c, abs=RESOLUTION_C)


def test_ramp_down_through_zero_at_a_fractional_rate(tcp_bench):
    rate = 0.7 if tcp_bench.model == "eurotherm_3504" else 0.73
    tcp_bench.chamber.ramp_to_c(-20.0, rate)
    for minute in range(0, 80, 10):
        expected_c = max(23.4 - rate * minute, -20.0)
        # a step of whole seconds: ± 0.5 s of 3567 s over the ramp's 43.4 °C is 6 mK
        assert tcp_bench.chamber.read_setpoint_c() == pytest.approx(expected_c, abs=0.06)
        tcp_bench.wait(600.0)


def test_ramp_starts_where_the_chamber_is_and_not_where_it_was_sent(lagging_bench):
    chamber = lagging_bench.chamber
    chamber.hold_temp_c(60.0)
    lagging_bench.wait(60.0)
    present_c = chamber.read_temp_c()
    assert 30.0 < present_c < 45.0, "on its way"
    chamber.ramp_to_c(-10.0, 2.0)
    assert chamber.read_setpoint_c() == pytest.approx(present_c, abs=2 * RESOLUTION_C)
    lagging_bench.wait(300.0)
    assert chamber.read_setpoint_c() == pytest.approx(present_c - 10.0, abs=2 * RESOLUTION_C)


def test_ramp_follows_ramp_and_hold_follows_ramp(tcp_bench):
    chamber = tcp_bench.chamber
    chamber.ramp_to_c(70.0, 2.0)
    tcp_bench.wait(300.0)
    chamber.ramp_to_c(-40.0, 3.0)
    tcp_bench.wait(600.0)
    assert chamber.read_setpoint_c() == pytest.approx(33.4 - 30.0, abs=2 * RESOLUTION_C)
    chamber.hold_temp_c(20.0)
    assert chamber.read_setpoint_c() == pytest.approx(20.0, abs=RESOLUTION_C)
    tcp_bench.wait(7200.0)
    assert chamber.read_temp_c() == pytest.approx(20.0, abs=RESOLUTION_C)


def test_after_the_ramp_it_holds(tcp_bench):
    tcp_bench.chamber.ramp_to_c(30.0, 1.0)
    tcp_bench.wait(36000.0)
    assert tcp_bench.chamber.read_temp_c() == pytest.approx(30.0, abs=RESOLUTION_C)
    assert tcp_bench.chamber.read_setpoint_c() == pytest.approx(30.0, abs=RESOLUTION_C)


@pytest.mark.parametrize("decimals", [0, 1, 2])
@pytest.mark.parametrize("model", ["watlow_f4", "eurotherm_3504"])
def test_scaling_goes_by_the_decimals_both_ways(model, decimals):
    bench = Bench(model, "tcp", decimals=decimals)
    try:
        for temp_c in (-40.0, 25.0, 84.0):
            bench.chamber.hold_temp_c(temp_c)
            assert bench.chamber.read_temp_c() == temp_c
            assert bench.plant.air_temp_c(bench.clock.now_s()) == temp_c
    finally:
        bench.close()


def test_decimals_that_disagree_are_found_out():
    bench = Bench("watlow_f4", "tcp", decimals=2)
    try:
        bench.opened.append(
            open_chamber(ChamberConfig(model="watlow_f4", url=bench.emulator.url, decimals=1))
        )
        with pytest.raises(RecognitionError, match="shows 2 decimals, expected 1"):
            bench.opened[-1].identify()
    finally:
        bench.close()


@pytest.mark.parametrize("temp_c", [85.1, -55.1, float("nan"), float("inf"), float("-inf")])
def test_set_points_outside_the_limits_send_nothing(tcp_bench, temp_c):
    chamber = tcp_bench.open()
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.hold_temp_c(temp_c)
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.ramp_to_c(temp_c, 1.0)
    assert chamber.counters.exchanges == 0


@pytest.mark.parametrize("rate", [0.0, -1.0, 0.04, 5.1, float("nan"), float("inf")])
def test_rates_outside_the_limits_send_nothing(tcp_bench, rate):
    chamber = tcp_bench.open()
    with pytest.raises(LimitError, match="nothing was sent"):
        chamber.ramp_to_c(30.0, rate)
    assert chamber.counters.exchanges == 0


def test_the_tighter_limits_apply_after_identify(tcp_bench):
    tcp_bench.emulator.controller.limits_c = (-30.0, 120.0)
    limits = tcp_bench.recognised().limits_c
    # the 3504's map has no set point limits, so the station's stay in force
    low = -55.0 if tcp_bench.model == "eurotherm_3504" else -30.0
    assert (limits.lo, limits.hi) == (low, 85.0)


def test_a_controller_whose_limits_exclude_the_station_is_refused():
    bench = Bench("watlow_f4t", "tcp")
    try:
        bench.emulator.controller.limits_c = (100.0, 120.0)
        with pytest.raises(RecognitionError, match="set points"):
            bench.open().identify()
    finally:
        bench.close()


def test_a_controller_that_cannot_be_made_safe_is_refused_beforehand():
    bench = Bench("watlow_f4t", "tcp")
    try:
        bench.emulator.controller.limits_c = (30.0, 120.0)
        with pytest.raises(RecognitionError, match="safe temperature 25 °C is outside 30 to 85 °C"):
            bench.open().identify()
    finally:
        bench.close()
