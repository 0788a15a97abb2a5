"""The sigma of groups of samples, beside what may be missing."""

from dataclasses import replace

import numpy as np

from errormodel.discrepancy.nulls import simulate_nulls
from errormodel.discrepancy.scale import Scales
from errormodel.noise.model import NoiseModel, given_noise
from tests.errormodel.discrepancy.examples import linear_problem, time_base, waves

BASE = time_base()
FIRST = np.arange(len(BASE)) % 3 > 0  # two thirds of all samples
FLOOR = given_noise(NoiseModel())
WAVES = np.column_stack([waves(BASE, k) for k in (1.0, 2.0, 3.0, 5.0)])
PROBLEM = replace(
    linear_problem(np.zeros(len(BASE)), BASE), saturated=WAVES, scaled=(FIRST, ~FIRST)
)


def test_each_group_has_its_own_sigma_whatever_effect_there_is() -> None:
    draws = 400
    noise = np.random.default_rng(3).standard_normal((len(BASE), draws))
    sigma = np.where(FIRST, 2.0, 0.5)
    scales = Scales(PROBLEM)
    found = scales.of(sigma[:, None] * noise + 30.0 * WAVES[:, :1])
    for k, true in enumerate((2.0, 0.5)):
        own = 1.0 / np.sqrt(2.0 * scales.free[k])  # relative sigma of one estimate
        assert abs(np.mean(found[k]) / true - 1.0) < 4.0 * own / np.sqrt(draws) + own**2
        assert abs(np.std(found[k]) / true / own - 1.0) < 4.0 / np.sqrt(2.0 * draws)


def test_a_sigma_found_in_few_samples_widens_the_law() -> None:
    """With n degrees of freedom a gain over the sigma found is F, not χ²: its mean n/(n − 2)."""
    few = replace(PROBLEM, saturated=np.eye(len(BASE))[:, 12:], scaled=(np.ones(len(BASE), bool),))
    assert Scales(few).free == (12,)
    known, found = (
        simulate_nulls(p, FLOOR, draws=2000, rng=np.random.default_rng(4)).gains["wave"].mean
        for p in (replace(few, scaled=()), few)
    )
    # variance of F(1, 12) is 2·12²·11/(10²·8) = 3.96, of χ² 2: the difference of the means to 0.06
    assert abs(found - known - 0.2) < 4.0 * 0.06
