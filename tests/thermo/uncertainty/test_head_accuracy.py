"""Sigmas under a head that errs alike at every visit."""

import numpy as np
import pytest
from scipy import stats

from errormodel.errors import InputError
from tests.thermo.examples import ANGLES, TRUTH, recorded, runs_of, simulate_run
from thermo.compensation.model_file import reported
from thermo.fitting.fit import TermsFile, fit_runs

HEAD_ARCSEC = 2.0
FILE = TermsFile(terms=tuple(TRUTH), head_arcsec=HEAD_ARCSEC)


def head_error_deg(rng: np.random.Generator) -> dict[float, float]:
    """Draw the error at each position: the covariance 2″ at every angle, by its own code."""
    apart = np.deg2rad(np.subtract.outer(ANGLES, ANGLES))
    cov = HEAD_ARCSEC**2 / 3.0 * (1.0 + np.cos(apart) + np.cos(2.0 * apart))
    drawn = rng.multivariate_normal(np.zeros(len(ANGLES)), cov, method="svd") / 3600.0
    return dict(zip(ANGLES, drawn.tolist(), strict=True))


def on_that_head(seed: int):
    """Return runs in which the head stands elsewhere than its encoder says."""
    rng = np.random.default_rng(seed)
    error_deg = head_error_deg(rng)
    true_angles = tuple(a + error_deg[a] for a in ANGLES)
    frames = [simulate_run(rng, run=str(k), angles=true_angles, n=500, period_s=30) for k in (1, 2)]
    for frame in frames:
        frame["position_deg"] = frame["position_deg"].round() % 360
    return recorded(*frames)


@pytest.mark.parametrize("seeds", [8, pytest.param(40, marks=pytest.mark.slow)])
def test_errors_lie_within_the_sigmas_that_allow_for_the_head(seeds: int) -> None:
    chi2 = {True: 0.0, False: 0.0}
    for seed in range(seeds):
        runs = on_that_head(seed)
        for aware in chi2:
            terms = FILE if aware else FILE.model_copy(update={"head_arcsec": 0.0})
            (one,) = fit_runs(runs, terms=terms)
            found = reported(one.fit, 1.3, "mA")
            z = np.array(
                [(found[n]["value"] - TRUTH[n]) / found[n]["sigma"] for n in one.fit.names]
            )
            correlation = one.fit.cov / np.outer(one.fit.sigmas, one.fit.sigmas)
            chi2[aware] += float(z @ np.linalg.solve(correlation, z))
    dof = seeds * len(TRUTH)
    assert 0.001 < stats.chi2.sf(chi2[True], dof) < 0.999
    assert stats.chi2.sf(chi2[False], dof) < 1e-9, "else the head would not matter here"


def test_an_offset_alone_is_the_hinge_angle() -> None:
    """Closed form: sin(θ + ε) = sin θ + ε cos θ, so ε is in δ_o; a third of the variance is its."""
    runs = runs_of(1, white_ug=0.01, drift_ug=0.0)
    (one,) = fit_runs(runs, terms=TermsFile(terms=("k1", "k0", "delta_o"), head_arcsec=3.0))
    sigma = one.fit.sigma("delta_o")
    assert sigma > 3.0 / np.sqrt(3.0) * np.pi / 180 / 3600
    assert one.head_arcsec == 3.0


def test_values_stay_as_they_are() -> None:
    runs = runs_of(3)
    (plain,) = fit_runs(runs, terms=TermsFile(terms=tuple(TRUTH)))
    (aware,) = fit_runs(runs, terms=FILE)
    np.testing.assert_array_equal(aware.fit.values, plain.fit.values)
    assert np.linalg.eigvalsh(aware.fit.cov - plain.fit.cov).min() >= -1e-25
    assert aware.fit.sigma("k0_t1") < 1.001 * plain.fit.sigma("k0_t1"), "no head knows temperature"


def test_without_an_angle_it_is_refused() -> None:
    runs = recorded(simulate_run(np.random.default_rng(0)).drop(columns="position_deg"))
    with pytest.raises(InputError, match="head_arcsec needs the head's angle; give position_deg"):
        fit_runs(runs, terms=TermsFile(terms=("k0",), head_arcsec=1.0))
