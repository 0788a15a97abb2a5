import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.digitisers.thermistor import ohm_from_temp_c, temp_c_from_ohm
from drivers.station import ThermistorConfig

COMMON = ThermistorConfig()


def test_ten_kilohm_thermistor_reads_25_degrees():
    # the curve's published coefficients hold 10 kΩ at 25 °C to 0.01 °C
    assert temp_c_from_ohm(10_000.0, COMMON) == pytest.approx(25.0, abs=0.01)


def test_table_of_the_3977_k_curve():
    # the maker's table of the 10 kΩ, 3977 K curve (J type): R to five figures at −40, 0, 70, 100 °C
    ohm = np.array([336_500.0, 32_650.0, 1_752.0, 680.0])
    # the three-coefficient curve follows the table to a few hundredths of a degree
    np.testing.assert_allclose(temp_c_from_ohm(ohm, COMMON), [-40.0, 0.0, 70.0, 100.0], atol=0.1)


@given(
    temp_c=st.floats(-60.0, 125.0),
    b=st.floats(1.5e-4, 3.5e-4),
    c=st.one_of(st.just(0.0), st.floats(1e-12, 3e-7)),
)
def test_there_and_back(temp_c, b, c):
    curve = ThermistorConfig(a=1.1e-3, b=b, c=c)
    ohm = ohm_from_temp_c(temp_c, curve)
    # 1/T loses about 1e-16 relative, in T: 400 K × 1e-16 × a few
    assert temp_c_from_ohm(ohm, curve) == pytest.approx(temp_c, abs=1e-9)


def test_a_negative_third_coefficient_is_inverted_on_the_branch_through_zero():
    curve = ThermistorConfig(a=1.1e-3, b=2.6e-4, c=-1e-8)
    temps = np.linspace(-60.0, 125.0, 19)
    back = temp_c_from_ohm(ohm_from_temp_c(temps, curve), curve)
    np.testing.assert_allclose(back, temps, atol=1e-9)


def test_resistance_falls_with_temperature():
    ohm = ohm_from_temp_c(np.linspace(-60.0, 125.0, 200), COMMON)
    assert np.all(np.diff(ohm) < 0)


@pytest.mark.parametrize("ohm", [0.0, -5.0, math.nan, math.inf])
def test_what_is_no_resistance_gives_nan(ohm):
    assert math.isnan(temp_c_from_ohm(ohm, COMMON))


def test_shapes_are_kept_and_inputs_untouched():
    ohm = np.full((2, 3), 1e4)
    assert temp_c_from_ohm(ohm, COMMON).shape == (2, 3)
    assert isinstance(temp_c_from_ohm(1e4, COMMON), float)
    assert np.all(ohm == 1e4)
