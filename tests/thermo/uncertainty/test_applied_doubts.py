"""What a fit does not know, carried into its corrected readings and over a hundred campaigns."""

import numpy as np
import pytest
from scipy import stats

from errormodel.errors import InputError
from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign
from tests.thermo.uncertainty.doubted import deviations, error_ug, fitted, worst
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import make_model_file
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import make_runs


def test_a_thermometer_that_may_be_off_widens_what_hangs_on_temperature() -> None:
    frame = campaign(Setup(runs=2), 1).frame()
    frame["temp_c"] += 0.1 + 0.01 * (frame["temp_c"] - 25.0)
    sidecar = {"output_unit": "mA", "gravity_m_s2": 9.80665, "nominal_scale": 1.3}
    (plain,) = fit_runs(make_runs(frame, **sidecar))
    stated = make_runs(frame, **sidecar, temp_sigma_c=0.2, temp_gain_ppm=10_000)
    (wide,) = fit_runs(stated)
    assert worst(plain, Setup()) > 10.0
    assert worst(wide, Setup()) < 3.0
    assert wide.fit.values.tolist() == plain.fit.values.tolist()
    # K1 by 0.2 °C and by 10 000 ppm of 25 °C about 0 °C, times 80 ppm/°C
    sigma_ppm = 1e6 * wide.fit.sigma("k1") / wide.fit.value("k1")
    assert sigma_ppm == pytest.approx(80.0 * np.hypot(0.2, 0.25), rel=0.05)


# ---- applying ----


@pytest.mark.parametrize("seeds", [(1,), pytest.param((1, 2, 3), marks=pytest.mark.slow)])
def test_sigmas_of_compensated_readings_hold_for_runs_that_were_not_fitted(
    seeds: tuple[int, ...],
) -> None:
    setup = Setup(runs=6, offset_ug=15.0, scale_ppm=15.0)
    z: list[float] = []
    for seed in seeds:
        error, sigma = error_ug(setup, fitted(setup, seed), 100 + seed)
        z += (error / sigma).tolist()
    # of 18 runs' own offsets 95 % hold 80 % at least (binomial, 99.9 %)
    assert np.mean(np.abs(z) < 1.96) > 0.80
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_a_model_goes_to_another_site_with_its_gravity() -> None:
    one = fitted(Setup())
    error, sigma = error_ug(Setup(runs=1, gravity=9.8156), one, 9)
    assert np.sqrt(np.mean(error**2)) < 1.3 * np.hypot(4.0, 2.5)
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.9


def test_a_rate_beyond_those_fitted_is_clipped_and_flagged() -> None:
    names = (*TRUE, "temperature_rate_bias")
    (one,) = fit_runs(campaign(Setup(runs=2), 1), terms=TermsFile(terms=names))
    fast = campaign(Setup(runs=1, rates=(5.0,), step_s=5.0), 5)
    done = compensate(fast, make_model_file([one]))
    assert np.mean(done.outside_rate) > 0.9
    slow = campaign(Setup(runs=1), 5)
    assert not np.any(compensate(slow, make_model_file([one])).outside_rate)


def test_positions_beyond_those_fitted_are_flagged() -> None:
    one = fitted(Setup(positions=(0.0, 30.0, 150.0, 180.0, 330.0, 210.0), runs=2))
    runs = campaign(Setup(runs=1), 5)
    done = compensate(runs, make_model_file([one]))
    beyond = np.abs(np.sin(np.deg2rad(runs.position_deg))) > 0.65
    assert np.array_equal(done.outside_input, beyond)


def test_runs_without_temperature_are_refused() -> None:
    frame = campaign(Setup(runs=2), 1).frame().assign(temp_c=np.nan)
    runs = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    with pytest.raises(InputError, match="Q1 run R1: temp_c is not recorded"):
        fit_runs(runs)
    with pytest.raises(InputError, match="temp_c is not recorded"):
        compensate(runs, make_model_file([fitted(Setup(runs=2))]))


# ---- over many seeds ----

MANY = {
    "base": Setup(),
    "offsets, 4": Setup(offset_ug=30.0),
    "offsets, 8": Setup(offset_ug=30.0, runs=8),
    "offsets, 2": Setup(offset_ug=30.0, runs=2),
    "scale, 4": Setup(scale_ppm=30.0),
    "scale, 8": Setup(scale_ppm=30.0, runs=8),
    "thermistor, 4": Setup(thermistor_c=0.1),
    "coarse output": Setup(lsb_ug=50.0, white_ug=1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(MANY))
def test_sigmas_cover_over_a_hundred_campaigns(name: str) -> None:
    """95 % of the coefficients within 1.96 sigma, of all and of each; few runs may hold more."""
    setup, seeds = MANY[name], 100
    z = [deviations(fitted(setup, seed), setup) for seed in range(seeds)]
    for coefficient in TRUE:
        inside = sum(abs(one[coefficient]) < 1.96 for one in z if coefficient in one)
        # ten coefficients of eight set-ups: none too low with 1 % in all
        assert inside >= stats.binom.ppf(0.01 / 80, seeds, 0.95), coefficient
    whole = np.mean([abs(v) < 1.96 for one in z for v in one.values()])
    assert whole > 0.93
