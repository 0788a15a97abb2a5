"""Set-ups of a stranger's simulator that were wrong without a word: each has its sentence."""

import numpy as np
import pytest
from scipy import signal

from accelbench.commands.fit.text import fit_sentences
from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign
from tests.thermo.recording.readings_examples import recorded
from thermo.compensation.model_file import reported
from thermo.fitting.fit import AccelerometerFit, TermsFile, fit_runs

HEATING = (-40.0, 70.0)
GIVEN = TermsFile(terms=tuple(TRUE))
TWO = {"runs": 2, "rates": (1.6, 2.0)}


def fitted(setup: Setup, terms: TermsFile | None = None) -> AccelerometerFit:
    (one,) = fit_runs(campaign(setup, 1), terms=terms)
    return one


def off(one: AccelerometerFit, name: str) -> tuple[float, float]:
    """Return by how much a coefficient is wrong, and its sigma."""
    found = reported(one.fit, 1.3, "mA")[name]
    return float(found["value"]) - TRUE[name], float(found["sigma"])


@pytest.mark.parametrize(
    ("fault", "words"),
    [({"lag_s": 120.0}, "a thermal lag of 120 s"), ({"loop_ug": 20.0}, "a loop of ±20 µg"),
     ({"line_ug_h": 10.0}, "a drift of 10 µg/h")],
)  # fmt: skip
def test_heating_alone_says_what_it_costs_and_the_size_is_right(fault, words) -> None:
    setup = Setup(corners_c=HEATING, runs=4, drift_ug=0.0, **fault)
    one = fitted(setup, GIVEN)
    assert "the sigmas do not include them: here" in "\n".join(fit_sentences(one))
    ((k0_ug, k1_ppm),) = [(k0, k1) for told, k0, k1 in one.doubts.one_way if told == words]
    found, sigma = off(one, "k0")
    # the lag is taken to first order: 120 s of 1.6 °C/min are 3 °C, 5 % of its length of scale
    assert abs(found) == pytest.approx(k0_ug, abs=4.0 * sigma + 0.1 * k0_ug)
    found, sigma = (1e6 * v / TRUE["k1"] for v in off(one, "k1"))
    assert abs(found) == pytest.approx(k1_ppm, abs=4.0 * sigma + 0.1 * k1_ppm)


@pytest.mark.parametrize(("lsb_ug", "white_ug"), [(50.0, 1.0), (47.0, 4.0), (200.0, 4.0)])
def test_sigmas_hold_for_an_output_coarser_than_its_noise(lsb_ug: float, white_ug: float) -> None:
    one = fitted(Setup(**TWO, lsb_ug=lsb_ug, white_ug=white_ug), GIVEN)
    error = np.array([off(one, n)[0] / off(one, n)[1] for n in one.fit.names])
    # ten coefficients, none beyond 4 sigma but once in 1 600; it was 7, and χ²/n 7 to 9
    assert np.abs(error).max() < 4.0
    assert np.mean(error**2) < 3.0  # χ² of 10 above 30: once in 1 000
    assert f"the output goes in steps of {lsb_ug:g} µg" in "\n".join(fit_sentences(one))


@pytest.mark.parametrize("lag_s", [30.0, -60.0], ids=["inside", "of the thermistor"])
def test_a_short_lag_of_either_side_is_told_with_its_size(lag_s: float) -> None:
    setup = Setup(**TWO, lag_s=max(lag_s, 0.0))
    frame = campaign(setup, 1).frame()
    if lag_s < 0:  # the thermistor shows late what the accelerometer has
        keep = np.exp(setup.step_s / lag_s)
        frame["temp_c"] = frame.groupby("run")["temp_c"].transform(
            lambda t: signal.lfilter([1 - keep], [1, -keep], t, zi=[keep * t.iloc[0]])[0]
        )
    (one,) = fit_runs(recorded(frame), terms=GIVEN)
    text = "\n".join(fit_sentences(one))
    assert "the residual still follows" in text
    found = float(text.partition("(a lag of ")[2].partition(" s)")[0].replace("−", "-"))
    # a filter's steps of 10 s shorten the lag by half a step
    assert found == pytest.approx(lag_s, abs=6.0)
    assert "this is not drift" in text


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        ((90.0, 270.0), "k2 in k0; k3 in k1"),
        ((0.0, 90.0, 270.0), "delta_o in k0, k2"),
        ((0.0, 180.0), "k1, taken as nominal"),
    ],
    ids=["up and down", "three", "level"],
)
def test_few_positions_say_which_coefficient_holds_what_they_cannot_give(positions, words) -> None:
    assert words in "\n".join(fit_sentences(fitted(Setup(**TWO, positions=positions))))


@pytest.mark.parametrize("loop_ug", [10.0, 100.0])
def test_a_loop_left_in_both_directions_is_told_with_its_size(loop_ug: float) -> None:
    one = fitted(Setup(**TWO, loop_ug=loop_ug), GIVEN)
    text = "\n".join(fit_sentences(one))
    assert "a thermal-history effect is left" in text
    size = float(text.partition("heating lies ")[2].partition(" µg")[0])
    sigma = one.doubts.loop_sigma_ug
    assert sigma is not None
    assert size == pytest.approx(2.0 * loop_ug, abs=4.0 * sigma + 0.02 * loop_ug)
