"""Terms of time, run, head and readout against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.model import ErrorModel
from errormodel.record import Record
from errormodel.terms import InputChange, Term
from thermo.library import term

TIME_S = np.tile(np.arange(0.0, 7200.0, 60.0), 2)
RUN = np.repeat([0, 1], 120)
X = np.concatenate([np.linspace(-60, 40, 120), np.linspace(40, -60, 120)])
ANGLE = np.deg2rad(np.tile(np.arange(8) * 45.0, 30))


def record() -> Record:
    return Record(
        time_s=TIME_S,
        run=RUN,
        signals={
            "x_c": X,
            "x_slow_c": X,
            "rate_c_per_min": np.gradient(X),
            "a_i_g": np.sin(ANGLE),
            "a_p_g": np.cos(ANGLE),
            "a_o_g": 0.0 * ANGLE,
            "elapsed_h": TIME_S / 3600.0 + 3.0 * RUN,
        },
    )


def column(name: str, **values: float) -> np.ndarray:
    one = term(name)
    assert isinstance(one, Term)
    return one.columns(record(), values, None)[0]


def test_terms_of_time_and_run_are_what_they_say() -> None:
    hours = record()["elapsed_h"]
    assert_allclose(column("run_in", run_in_tau_h=5.0)[:, 0], np.exp(-hours / 5.0))
    assert_allclose(column("warm_up", warm_up_tau_s=900.0)[:, 0], np.exp(-TIME_S / 900.0))
    assert_allclose(column("bias_step", bias_step_at_h=3.5)[:, 0], hours >= 3.5)
    assert_allclose(column("bias_drift")[:, 0], hours)
    assert_allclose(column("turn_on_offset_1")[:, 0], RUN)


@pytest.mark.parametrize("name", ["run_in", "bias_step", "bias_drift", "turn_on_offset_1"])
def test_what_a_new_run_will_not_repeat_says_so(name: str) -> None:
    assert not term(name).predictive


def test_the_head_s_second_harmonic_is_the_third_order_and_more() -> None:
    # sin 2θ · cos θ = 2 (sin θ − sin³ θ): a scale factor and a third order, exactly
    a = np.sin(ANGLE)
    assert_allclose(column("indexer_harmonic")[:, 0], 2.0 * (a - a**3), atol=1e-12)


def test_plays_close_their_loops_and_saturate_at_their_radius() -> None:
    plays = column("bias_hysteresis_plays")
    assert np.all(np.abs(plays[60:119, 0] + 1.5) < 1e-9)  # follows 1.5 °C behind, heating
    assert np.all(np.abs(plays[200:, 0] - 1.5) < 1e-9)


def test_two_poles_are_one_lag_behind_another() -> None:
    values = {"thermal_lag": 300.0, "thermal_lag_second": 120.0}
    two, one = term("thermal_lag_two_poles"), term("thermal_lag")
    assert isinstance(two, InputChange)
    assert isinstance(one, InputChange)
    first, _ = one.change(record(), {"thermal_lag": 300.0}, None)
    expected, _ = one.change(first, {"thermal_lag": 120.0}, None)
    changed, _ = two.change(record(), values, None)
    assert_allclose(changed["x_c"], expected["x_c"], atol=1e-12)


def test_memories_go_on_where_a_record_was_cut() -> None:
    loop = ("bias_hysteresis", "bias_hysteresis_start", "bias_hysteresis_plays")
    model = ErrorModel(tuple(term(n) for n in ("k0", *loop, "thermal_lag_two_poles")))
    values = {n: 1.0 for n in model.start_values()} | {
        "bias_hysteresis_width": 9.0,
        "thermal_lag": 200.0,
        "thermal_lag_second": 50.0,
    }
    whole = record().take(np.arange(120))
    first, memory = model.continue_simulation(whole.take(np.arange(50)), values, None)
    rest, _ = model.continue_simulation(whole.take(np.arange(50, 120)), values, memory)
    assert_allclose(np.concatenate([first, rest]), model.simulate(whole, values), atol=1e-9)
