import numpy as np
import pandas as pd
import pytest

from thermo.fitting.findings import find_loop, find_order
from thermo.fitting.fit import AccelerometerFit, TermsFile, fit_runs
from thermo.recording.files import make_runs

LINEAR = TermsFile(terms=("k0", "k0_t1"))


def fitted(
    loops_ug: tuple[float, ...],
    *,
    noise_ug: float = 5.0,
    terms: TermsFile | None = LINEAR,
    square_ug: float = 0.0,
) -> AccelerometerFit:
    """A static accelerometer over one run up and down for each loop given."""
    rng = np.random.default_rng(7)
    n = 400
    tables: list[pd.DataFrame] = []
    for k, loop in enumerate(loops_ug):
        temp_c = 60.0 - 80.0 * np.abs(2.0 * np.arange(n) / n - 1.0)
        x = temp_c - 25.0
        branch = np.where(np.arange(n) < n // 2, 0.5, -0.5)
        error = 4.0 * x + square_ug * x**2 + loop * branch + noise_ug * rng.standard_normal(n)
        tables.append(
            pd.DataFrame(
                {
                    "run": f"r{k}",
                    "serial": "A",
                    "time_s": 20.0 * np.arange(n),
                    "temp_c": temp_c,
                    "output": 1e-6 * error,
                }
            )
        )
    runs = make_runs(pd.concat(tables), output_unit="g", gravity_m_s2=9.81, nominal_scale=1.0)
    return fit_runs(runs, terms=terms)[0]


def test_a_loop_of_one_sign_in_every_run_is_thermal_history():
    loop = find_loop(fitted((40.0, 44.0)))
    # the mean of 6 readings in a cell has 2 µg, the median of 32 cells less than 1
    assert loop.median_ug == pytest.approx(42.0, abs=3.0)
    assert loop.at_40c_ug == pytest.approx(42.0, abs=8.0)
    assert [m for _, m in loop.by_run_ug] == pytest.approx([40.0, 44.0], abs=4.0)
    assert (loop.stands_out, loop.repeats) == (True, True)
    assert "thermal-history effect is left" in loop.sentence
    assert "above cooling" in loop.sentence


def test_the_sign_is_told():
    loop = find_loop(fitted((-40.0, -44.0)))
    assert loop.median_ug == pytest.approx(-42.0, abs=3.0)
    assert "below cooling" in loop.sentence


def test_one_run_cannot_tell_history_from_drift():
    loop = find_loop(fitted((40.0,)))
    assert (loop.stands_out, loop.repeats) == (True, None)
    assert "a single run cannot separate" in loop.sentence


def test_loops_of_different_sign_are_no_thermal_history():
    loop = find_loop(fitted((70.0, 70.0, -10.0)))
    assert loop.repeats is False
    assert "drift rather than thermal history" in loop.sentence


@pytest.mark.parametrize("noise_ug", [5.0, 50.0])
def test_noise_alone_is_no_loop(noise_ug):
    loop = find_loop(fitted((0.0, 0.0), noise_ug=noise_ug))
    assert not loop.stands_out
    assert loop.sentence == ""


def test_a_higher_order_is_tried_and_does_not_help():
    order = find_order(fitted((0.0, 0.0), terms=None))
    assert order.helps is False
    assert order.chosen is not None
    assert order.chosen.k0_order == 1
    assert [t.k0_order for t in order.higher] == [2]
    assert f"{order.higher[0].heldout_ug:.4g} µg held out" in order.sentence


def test_given_terms_leave_the_question_open():
    order = find_order(fitted((0.0, 0.0)))
    assert (order.helps, order.chosen) == (None, None)
    assert "were given" in order.sentence


def test_the_order_is_followed_where_it_helps():
    order = find_order(fitted((0.0, 0.0), terms=None, square_ug=0.1))
    assert order.chosen is not None
    assert order.chosen.k0_order == 2


def test_one_direction_only_has_no_loop():
    runs = make_runs(
        pd.DataFrame(
            {
                "run": "r",
                "serial": "A",
                "time_s": np.arange(100.0),
                "temp_c": np.linspace(0.0, 50.0, 100),
                "output": 1e-6 * np.sin(np.arange(100.0)),
            }
        ),
        output_unit="g",
        gravity_m_s2=9.81,
        nominal_scale=1.0,
    )
    loop = find_loop(fit_runs(runs, terms=LINEAR)[0])
    assert (loop.median_ug, loop.by_run_ug, loop.stands_out) == (None, (), False)
