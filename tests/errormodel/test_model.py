"""An error model is a tuple of terms: what it computes, and that appending is all it takes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.columns import derivative
from errormodel.record import Record
from tests.errormodel.examples import decay_term, linear_term


def test_the_output_is_the_model_equation(model, record, truth) -> None:
    x, u = record["x"], record["u"]
    expected = 1.02 * (1 + 1e-4 * x) * (u - 4e-3 + 3e-5 * x + 2e-5 * u**2)
    assert_allclose(model.simulate(record, truth), expected, rtol=1e-14)


def test_products_make_the_output_whatever_the_coefficients(model, record, truth) -> None:
    values = np.array([[truth[c.name] for c in model.coefficients]])
    products = model.design(record, truth)[0].products()
    weights, _ = model.product_weights(values)
    assert_allclose(products @ weights[0], model.simulate(record, truth), rtol=1e-13)


def test_analytic_derivative_is_the_difference_quotient(model, record, truth) -> None:
    larger = model.with_terms(decay_term())
    values = {**truth, "decay": 1e-3, "tau": 400.0}
    columns = derivative(larger, record, values)
    for j, name in enumerate(larger.names):
        step = 1e-4 * max(abs(values[name]), 1e-3)  # bilinear: exact but for rounding
        up = larger.simulate(record, {**values, name: values[name] + step})
        down = larger.simulate(record, {**values, name: values[name] - step})
        slope = (up - down) / (2 * step)
        # tau is differenced over 1e-4 of its range (0.5 s of 400 s): curvature of 1e-6 of it
        assert_allclose(columns[:, j], slope, rtol=2e-4, atol=1e-8 * np.abs(slope).max())


def test_appending_a_term_is_all_it_takes(model, record, truth) -> None:
    larger = model.with_terms(decay_term())
    assert larger.names == (*model.names, "decay", "tau")
    extra = larger.simulate(record, {**truth, "decay": 1e-3, "tau": 200.0})
    plain = model.simulate(record, truth)
    assert_allclose(extra[0] - plain[0], 1e-3 * 1.02 * (1 + 1e-4 * record["x"][0]), rtol=1e-9)
    assert larger.without("decay").names == model.names


def test_each_run_starts_a_memory_anew(record) -> None:
    columns, _ = decay_term().columns(record, {"tau": 100.0}, None)
    first = [readings.start for readings in record.run_slices]
    assert_allclose(columns[first, 0], 1.0)


def test_a_name_cannot_stand_twice(model) -> None:
    with pytest.raises(ValueError, match="bias is listed twice"):
        model.with_terms(linear_term("bias", "input", "x"))


def test_a_missing_signal_is_named(model, truth) -> None:
    with pytest.raises(ValueError, match="lacks u"):
        model.simulate(Record(time_s=[0.0], signals={"x": [1.0]}), truth)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_s": [0.0, 0.0, 1.0]}, "increase"),
        ({"run": [0, 1, 0]}, "together"),
        ({"run": [1, 1, 1]}, "together"),
        ({"signals": {"x": [1.0]}}, "shape"),
        ({"output": [1.0]}, "shape"),
    ],
)
def test_a_record_is_checked(change, message) -> None:
    good = {"time_s": [0.0, 1.0, 2.0], "run": [0, 0, 0], "signals": {"x": [1.0, 2.0, 3.0]}}
    with pytest.raises(ValueError, match=message):
        Record(**{**good, **change})


def test_a_record_cannot_be_written_to_and_keeps_no_hold_of_its_input() -> None:
    x = np.arange(3.0)
    record = Record(time_s=[0, 1, 2], signals={"x": x})
    x[0] = 9.0
    assert record["x"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        record["x"][0] = 1.0


def test_taking_readings_numbers_runs_anew(record) -> None:
    second = record.take(record.run == 1)
    assert set(second.run) == {0}
    assert len(second) == np.sum(record.run == 1)
