"""The sigma of heating minus cooling is that of a median over cells that move together."""

import numpy as np

from tests.thermo.fitting.coverage import GIVEN
from tests.thermo.fitting.strange_runs import Setup, campaign
from thermo.fitting.fit import AccelerometerFit, fit_runs


def fitted(seed: int, **differs: float) -> AccelerometerFit:
    rates = (1.6, 2.0, 2.5, 3.2)
    setup = Setup(runs=2, step_s=30.0, rates=rates, **differs)  # type: ignore[arg-type]
    return fit_runs(campaign(setup, seed), terms=GIVEN)[0]


def test_a_scale_factor_that_differs_between_runs_is_in_the_sigma_of_every_campaign() -> None:
    """K1 apart by 300 ppm leaves some 10 µg, more or less as the positions fall."""
    z = []
    for seed in range(8):
        one = fitted(seed, scale_ppm=300.0)
        assert one.doubts.loop_sigma_ug is not None
        assert one.summary.heating_minus_cooling_ug is not None
        z.append(abs(one.summary.heating_minus_cooling_ug) / one.doubts.loop_sigma_ug)
    # one of eight beyond three sigma comes in 2 %; a sigma of the mean has three, up to 18 sigma
    assert max(z) < 3.0
    assert np.median(z) > 0.2  # nor is the sigma without end


def test_white_noise_alone_gives_the_sigma_of_a_median_of_independent_cells() -> None:
    one = fitted(1, drift_ug=0.0)
    loop = one.summary.loop
    scatter = np.std([c.heating_minus_cooling_ug for c in loop], ddof=1)
    independent = float(scatter * np.sqrt(np.pi / 2 / len(loop)))
    assert one.doubts.loop_sigma_ug is not None
    # of 44 cells the scatter itself is known to 11 %; what runs may differ by adds a little
    assert 0.65 * independent < one.doubts.loop_sigma_ug < 1.6 * independent


def test_one_direction_of_temperature_has_no_sigma() -> None:
    setup = Setup(runs=2, corners_c=(-40.0, 70.0), step_s=30.0)
    (one,) = fit_runs(campaign(setup, 1), terms=GIVEN)
    assert one.doubts.loop_sigma_ug is None
