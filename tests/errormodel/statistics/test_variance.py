"""Variance components: against statsmodels' mixed model, against closed forms, and their limits."""

import warnings
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import optimize, stats
from statsmodels.regression.mixed_linear_model import MixedLM, MixedLMParams, VCSpec

from errormodel.statistics.variance import (
    RandomFactor,
    VarianceFit,
    bartlett_factor,
    fit_components,
)
from errormodel.statistics.variance_design import stratum_degrees_of_freedom

SIGMAS = {
    "accelerometer": 20.0,
    "run": 8.0,
    "direction": 6.0,
    "run_direction": 3.0,
    "position": 4.0,
    "noise": 4.0,
}


def simulated(
    rng: np.random.Generator,
    units: int,
    runs: int,
    positions: int = 4,
    lost: float = 0.0,
) -> tuple[np.ndarray, list[RandomFactor]]:
    """Cells of a batch with all components; a share `lost` of them is missing."""
    grid = np.meshgrid(range(units), range(runs), range(2), range(positions), indexing="ij")
    keep = rng.random(grid[0].size) >= lost
    u, r, d, p = (g.ravel()[keep] for g in grid)
    factors = [
        RandomFactor.nested("accelerometer", u),
        RandomFactor.nested("run", u, r),
        RandomFactor.nested("direction", u, d),
        RandomFactor.nested("run_direction", u, r, d),
        RandomFactor.nested("position", u, p),
    ][0 if units > 1 else 1 :]
    y = SIGMAS["noise"] * rng.standard_normal(u.size)
    for f in factors:
        y += SIGMAS[f.name] * rng.standard_normal(f.codes.max() + 1)[f.codes]
    return y, factors


def of_statsmodels(y: np.ndarray, factors: Sequence[RandomFactor]) -> MixedLM:
    names = [f.name for f in factors]
    blocks = [[np.eye(f.codes.max() + 1)[f.codes]] for f in factors]
    labels = [[[str(k) for k in range(b[0].shape[1])]] for b in blocks]
    spec = VCSpec(names, labels, blocks)
    return MixedLM(y, np.ones((y.size, 1)), groups=np.zeros(y.size), exog_vc=spec)


def drop_at(model: MixedLM, k: int, variance: float, best: VarianceFit) -> float:
    """Return how far statsmodels' profile of variance k has fallen there, −2 ln scale.

    Its likelihood has the noise profiled out; to hold a variance and not a ratio, the noise is put
    back: ln L(σ²) = ln L(best σ²) − (n − p)/2·(ln(σ²/s²) + s²/σ² − 1).
    """
    free = model.endog.size - 1
    count = model.k_vc

    def minus2(at: np.ndarray) -> float:
        # the others may be 0, so they are searched as sigmas; the noise as a logarithm
        noise = variance if k == count else np.exp(at[-1])
        others = np.square(at if k == count else at[:-1]) + 1e-8  # at 0 it divides by it
        ratios = (others if k == count else np.insert(others, k, variance)) / noise
        none = np.zeros((0, 0))
        mean = model.get_fe_params(none, ratios)[0]
        params = MixedLMParams.from_components(fe_params=mean, cov_re=none, vcomp=ratios)
        own = model.get_scale(mean, none, ratios)
        more = free * (np.log(noise / own) + own / noise - 1.0)
        return -2.0 * model.loglike(params, profile_fe=True) + more

    start = [max(c.sigma, 1e-3) for j, c in enumerate(best.components[:-1]) if j != k]
    start += [] if k == count else [2.0 * np.log(best.of("noise").sigma)]
    found = optimize.minimize(minus2, start, method="BFGS", options={"gtol": 1e-4})
    constant = free * np.log(2.0 * np.pi)
    return float(found.fun - constant - best.minus2_log_like)


@pytest.mark.parametrize("seed", range(20))
def test_components_are_those_of_statsmodels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    y, factors = simulated(rng, 3, 3 + seed % 2, lost=0.2 * (seed % 2))
    found = fit_components(y, factors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it complains of estimates on the boundary
        # one optimiser alone may stop short of the top
        model, methods = of_statsmodels(y, factors), ("bfgs", "powell", "nm")
        theirs = max((model.fit(reml=True, method=[m]) for m in methods), key=lambda r: r.llf)
    constant = (y.size - 1) * np.log(2.0 * np.pi)
    # statsmodels stops at a gradient of some 1e-5: it must not do better, and hardly worse
    assert found.minus2_log_like + constant <= -2.0 * theirs.llf + 1e-5
    assert found.minus2_log_like + constant == pytest.approx(-2.0 * theirs.llf, abs=1e-2)
    for k, f in enumerate(factors):
        mine, other = found.of(f.name), float(np.sqrt(theirs.vcomp[k]))
        # a thousandth of the width of the limits, near the boundary where the top is flat a tenth
        near = 1e-3 if mine.sigma > 0.2 * mine.ci95[1] else 0.1
        assert mine.sigma == pytest.approx(other, abs=near * (mine.ci95[1] - mine.ci95[0]))
    assert found.of("noise").sigma == pytest.approx(np.sqrt(theirs.scale), rel=1e-3)


def check_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    y, factors = simulated(rng, 3, 3 + seed % 2, lost=0.2 * (seed % 2))
    found = fit_components(y, factors)
    model = of_statsmodels(y, factors)
    model.reml, model.cov_pen, model.fe_pen, model._cov_sing = True, None, None, 0  # as `fit` does
    for k, c in enumerate(found.components):
        for limit in c.ci95:
            if limit > 0.0:
                # the limit is found to 1e-4 in ln σ², where the profile falls by some 5 a unit
                assert drop_at(model, k, limit**2, found) == pytest.approx(c.drop, abs=0.01)


def test_limits_are_where_statsmodels_likelihood_has_fallen_as_stated() -> None:
    check_limits(1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_limits_agree_with_statsmodels_on_twenty_sets(seed: int) -> None:
    check_limits(seed)


def test_balanced_one_way_is_the_analysis_of_variance() -> None:
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(6), 4)
    y = 5.0 * rng.standard_normal(6)[group] + rng.standard_normal(24)
    found = fit_components(y, [RandomFactor(name="run", codes=group)])
    means = y.reshape(6, 4).mean(axis=1)
    within = float(np.sum((y.reshape(6, 4) - means[:, None]) ** 2)) / 18
    between = 4.0 * float(np.var(means, ddof=1))
    assert found.of("noise").sigma == pytest.approx(np.sqrt(within), rel=1e-5)
    assert found.of("run").sigma == pytest.approx(np.sqrt((between - within) / 4), rel=1e-5)
    assert (found.of("run").dof, found.of("noise").dof) == (5, 18)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_unit_of_the_observations_does_not_matter(scale: float) -> None:
    y, factors = simulated(np.random.default_rng(4), 3, 3)
    plain, scaled = fit_components(y, factors), fit_components(scale * y + 5 * scale, factors)
    for a, b in zip(plain.components, scaled.components, strict=True):
        assert b.sigma == pytest.approx(scale * a.sigma, rel=1e-4, abs=1e-5 * scale)
        assert_allclose(b.ci95, scale * np.array(a.ci95), rtol=1e-3)


def test_very_different_components_are_found() -> None:
    # biases of milli-g beside a noise of micro-g
    rng = np.random.default_rng(8)
    unit, run = np.repeat(np.arange(5), 12), np.repeat(np.arange(20), 3)
    y = 1e3 * rng.standard_normal(5)[unit] + rng.standard_normal(20)[run]
    y += 0.5 * rng.standard_normal(60)
    factors = [RandomFactor.nested("accelerometer", unit), RandomFactor.nested("run", unit, run)]
    found = fit_components(y, factors)
    means = y.reshape(20, 3).mean(axis=1)
    units = means.reshape(5, 4).mean(axis=1)
    noise2 = float(np.sum((y.reshape(20, 3) - means[:, None]) ** 2)) / 40
    run2 = 3.0 * float(np.sum((means.reshape(5, 4) - units[:, None]) ** 2)) / 15
    unit2 = 12.0 * float(np.var(units, ddof=1))
    expected = {"noise": noise2, "run": (run2 - noise2) / 3, "accelerometer": (unit2 - run2) / 12}
    for name, variance in expected.items():
        assert found.of(name).sigma == pytest.approx(np.sqrt(variance), rel=1e-4)


def test_degrees_of_freedom_are_those_of_the_strata() -> None:
    _, factors = simulated(np.random.default_rng(0), 3, 5)
    assert stratum_degrees_of_freedom(factors, 120) == (2, 12, 3, 12, 9, 81)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ([RandomFactor(name="run", codes=np.zeros(6))], "run cannot be told"),
        ([RandomFactor(name="run", codes=np.arange(6))], "noise cannot be told"),
        ([RandomFactor(name="run", codes=np.arange(5) % 2)], "expected 6 rows"),
        ([RandomFactor(name="run", codes=np.arange(6) % k) for k in (2, 3)], "twice"),
    ],
)
def test_designs_that_tell_nothing_are_refused(factors: list[RandomFactor], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        fit_components(np.arange(6.0), factors)


def test_corrected_limits_of_one_mean_square_hold_what_they_state() -> None:
    # −2 ln LR of a variance with ν degrees of freedom is ν(u − 1 − ln u), u ~ χ²(ν)/ν
    for dof in (1, 2, 5, 20):
        drop = stats.chi2.ppf(0.95, 1) * bartlett_factor(dof) / dof
        lo = optimize.brentq(lambda u, d=drop: u - 1 - np.log(u) - d, 1e-12, 1.0)
        hi = optimize.brentq(lambda u, d=drop: u - 1 - np.log(u) - d, 1.0, 50.0)
        share = stats.chi2.cdf(hi * dof, dof) - stats.chi2.cdf(lo * dof, dof)
        assert share == pytest.approx(0.95, abs=0.004)


def coverage(runs: int, sets: int, first: int = 0) -> dict[str, float]:
    """Return the share of simulated sets in which the limits hold each true component."""
    held: dict[str, list[bool]] = {}
    for seed in range(first, first + sets):
        y, factors = simulated(np.random.default_rng([runs, seed]), 3, runs)
        for c in fit_components(y, factors).components:
            held.setdefault(c.name, []).append(c.ci95[0] <= SIGMAS[c.name] <= c.ci95[1])
    return {name: float(np.mean(h)) for name, h in held.items()}


@pytest.mark.parametrize("runs", [3, 5, 10])
def test_limits_hold_the_truth_a_few_sets(runs: int) -> None:
    # 20 sets of 6 components: 120 at 95 % have 114 ± 2.4 inside; 4 sigma below is 104
    found = coverage(runs, 20)
    assert sum(20 * share for share in found.values()) >= 104


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("runs", [3, 5, 10])
def test_limits_hold_the_truth_in_95_percent_of_many_sets(runs: int) -> None:
    found = coverage(runs, 1000)
    assert all(0.92 <= share <= 0.98 for share in found.values()), found
