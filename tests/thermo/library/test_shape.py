"""The term of an effect without a name: its curves between knots, and what they are times."""

import numpy as np
from numpy.testing import assert_allclose

from errormodel.record import Record
from thermo.library.shape import shape_effect, shape_term

RECORD = Record(
    time_s=np.arange(4.0),
    signals={
        "x_slow_c": np.array([-20.0, 0.0, 5.0, 40.0]),
        "head_deg": np.zeros(4),
        "supply_v": np.array([14.0, 15.0, 15.5, 16.0]),
    },
)
KNOTS, CURVES = [-10.0, 0.0, 10.0], [[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]]


def test_curves_are_straight_between_knots_and_level_beyond_them():
    term = shape_term("mine", "temperature", KNOTS, CURVES)
    assert [c.name for c in term.coefficients] == ["mine_1", "mine_2"]
    made, _ = term.columns(RECORD, {}, None)
    assert_allclose(made, [[1.0, 0.0], [0.0, 1.0], [1.0, 0.5], [2.0, 0.0]])


def test_a_curve_may_be_of_a_recorded_column_and_in_proportion_to_the_temperature():
    term = shape_term("mine", "supply_v", [14.0, 16.0], [[0.0, 2.0]], times="temperature")
    assert term.needs == {"supply_v", "x_slow_c"}
    made, _ = term.columns(RECORD, {}, None)
    assert_allclose(made[:, 0], np.array([0.0, 1.0, 1.5, 2.0]) * np.array([-0.4, 0.0, 0.1, 0.8]))


def test_in_proportion_to_the_input_it_changes_the_scale_factor():
    assert shape_term("mine", "temperature", KNOTS, CURVES, times="input").place == "scale"


def test_its_effect_has_the_sizes_found_as_an_example():
    effect = shape_effect("mine", "Mine.", [3.0, -4.0])
    assert effect.example is not None
    assert effect.example.values == {"mine_1": 3e-6, "mine_2": -4e-6}
