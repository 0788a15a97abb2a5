"""The physical twin: heat flows as it should, and the output is that of the error model."""

import numpy as np
import pytest

from drivers.digitisers.thermistor import temp_c_from_ohm
from drivers.station import InputConfig
from thermo.twin.accelerometer import emulated_accelerometer
from thermo.twin.plant import Twin, TwinSettings

WIRED = InputConfig(serial="Q1", output_channel=101, thermistor_channel=111)
QUIET = TwinSettings(thermistor_noise_c=0.0, head_offset_arcsec=0.0, head_harmonic_arcsec=0.0)


def quiet_twin(**effects: float) -> Twin:
    one = emulated_accelerometer("Q1", effects=effects)
    silent = type(one)(model=one.model, values=one.values, white_ug=0.0, drift_ug=0.0)
    return Twin([WIRED], {"Q1": silent}, QUIET)


def test_in_a_long_ramp_everything_lags_by_the_sum_of_the_time_constants() -> None:
    twin = quiet_twin()
    twin.drive_chamber(0.0, 25.0, -175.0, 1.0 / 60.0)
    now_s = 6000.0
    for t in range(0, 6001, 60):
        twin.air_temp_c(float(t))
    setpoint_c = 25.0 - now_s / 60.0
    air, inside = twin.air_temp_c(now_s), twin.inside_temp_c(now_s, 0)
    # a first-order lag follows a ramp of 1 °C/min by its time constant: 60, then 180 + 60 s more;
    # 1 s is the step of the integration
    assert air - setpoint_c == pytest.approx(60.0 / 60.0, abs=1.1 / 60)
    assert inside - air == pytest.approx((180.0 + 60.0) / 60.0, abs=2.1 / 60)
    seen = temp_c_from_ohm(twin.channel_value(now_s, 111), WIRED.thermistor)
    assert seen == pytest.approx(inside, abs=1e-6)


def test_the_output_is_the_model_equation_at_the_inside_temperature() -> None:
    twin = quiet_twin()
    twin.turn_head(0.0, 30.0, 20.0)
    assert twin.head_is_moving(1.0)
    assert not twin.head_is_moving(2.0)
    one = emulated_accelerometer("Q1").values
    a_i, a_p = np.sin(np.pi / 6), np.cos(np.pi / 6)
    expected = one["k1"] * (a_i + one["k0"] + one["k2"] * a_i**2 + one["delta_o"] * a_p)
    # 1.3 mA/g nominal through 1 kΩ; the twin stands at the reference temperature
    assert twin.channel_value(10.0, 101) == pytest.approx(1.3 * expected, rel=1e-12)


def test_a_hidden_loop_shows_the_direction() -> None:
    plain, looped = quiet_twin(), quiet_twin(bias_hysteresis=20e-6, bias_hysteresis_width=10.0)
    difference = {}
    for twin in (plain, looped):
        twin.drive_chamber(0.0, 25.0, 70.0, 2.0 / 60.0)
        for t in range(0, 4000, 10):
            value = twin.channel_value(float(t), 101)
        up = value
        twin.drive_chamber(4000.0, 70.0, -40.0, 2.0 / 60.0)
        for t in range(4000, 9000, 10):
            value = twin.channel_value(float(t), 101)
        difference[twin] = (up, value)
    gain = 1.3 * emulated_accelerometer("Q1").values["k1"]
    loop = [
        (b - a) / gain * 1e6 for a, b in zip(difference[plain], difference[looped], strict=True)
    ]
    assert loop[0] == pytest.approx(20.0, abs=0.8)  # 45 °C is 4.5 widths: 1 % short; K1(T) 0.4 %
    assert loop[1] == pytest.approx(-20.0, abs=0.8)


def test_a_loop_follows_a_temperature_that_nobody_reads() -> None:
    # up to 70 °C and back between two readings at 25 °C, as in a rest between two runs
    told = {}
    for read_s in (10, 9000):
        twin = quiet_twin(bias_hysteresis=20e-6, bias_hysteresis_width=10.0)
        twin.channel_value(0.0, 101)
        twin.drive_chamber(0.0, 25.0, 70.0, 2.0 / 60.0)
        for t in range(10, 18001, 10):
            if t == 4500:
                twin.drive_chamber(4500.0, 70.0, 25.0, 2.0 / 60.0)
            twin.air_temp_c(float(t))  # a station watches the chamber all the time
            if t % read_s == 0:
                value = twin.channel_value(float(t), 101)
        told[read_s] = value / 1.3 * 1e6
    # seen every 30 s the turn is missed by 1 °C at most: a tenth of the width, less as it rounds
    assert told[9000] == pytest.approx(told[10], abs=0.2)
    flat = quiet_twin()
    assert told[10] - flat.channel_value(0.0, 101) / 1.3 * 1e6 == pytest.approx(-20.0, abs=1.0)


def test_a_heater_that_runs_away_and_comes_back() -> None:
    twin = quiet_twin()
    twin.break_away(0.0, 5.0 / 60.0)
    assert twin.air_temp_c(600.0) == pytest.approx(75.0, abs=0.1)
    twin.break_away(600.0, None)
    assert twin.air_temp_c(3600.0) == pytest.approx(25.0, abs=0.1)


def test_the_same_seed_is_the_same_accelerometer_and_another_serial_is_another() -> None:
    one, same = emulated_accelerometer("A"), emulated_accelerometer("A")
    assert one.values == same.values
    assert one.values != emulated_accelerometer("B").values


def test_an_unwired_accelerometer_is_refused() -> None:
    with pytest.raises(ValueError, match="no emulated accelerometer for Q1"):
        Twin([WIRED], {})


def test_power_off_and_on_draws_another_drift() -> None:
    drifting = emulated_accelerometer("Q1")
    calm = type(drifting)(model=drifting.model, values=drifting.values, white_ug=0.0, drift_ug=3.0)
    twin = Twin([WIRED], {"Q1": calm}, QUIET)
    before = twin.channel_value(0.0, 101)
    kept = twin.channel_value(1e-3, 101)
    twin.power_cycle(2e-3)
    after = twin.channel_value(3e-3, 101)
    # 1 ms of 3 µg drift over 1 h moves by 3 µg·√(2·1e-3/3600) = 0.002 µg; a new draw by µg
    assert abs(kept - before) / 1.3 < 5e-8
    assert abs(after - kept) / 1.3 > 2e-7
