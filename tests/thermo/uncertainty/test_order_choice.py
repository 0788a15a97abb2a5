"""Orders chosen by data: what the next one may do unseen belongs to a model's covariance."""

import numpy as np
from scipy.stats import chi2

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel
from thermo.library import MAX_ORDER, term
from thermo.selection.orders import WORTH_CHI2
from thermo.uncertainty.order_choice import UNSEEN_SIGMAS, with_next_orders

RANGE_X = (-65.0, 45.0)
NAMES = ("k0", "k0_t1", "k0_t2", "k0_t3")
NOISE = 5e-6


def test_a_cubic_fitted_to_a_quartic_is_as_far_off_as_its_covariance_says() -> None:
    """The quartic's part is any that the rule of choice would not have taken."""
    model = ErrorModel(tuple(term(n) for n in NAMES))
    x = np.linspace(*RANGE_X, 400)
    design = x[:, None] ** np.arange(5)
    cubic = design[:, :4]
    scale = np.max(np.abs(cubic), axis=0)
    gram: FloatArray = (cubic / scale).T @ (cubic / scale)
    cov: FloatArray = NOISE**2 * np.linalg.inv(gram) / np.outer(scale, scale)
    left = design[:, 4] - cubic @ np.linalg.lstsq(cubic, design[:, 4])[0]
    sigma = NOISE / np.linalg.norm(left)  # of the quartic's coefficient, had it been fitted
    rng = np.random.default_rng(1)
    with_it, without, count = 0.0, 0.0, 100
    for _ in range(count):
        truth = np.append(1e-6 * rng.standard_normal(4) / scale[:4], 0.0)
        truth[4] = sigma * np.sqrt(WORTH_CHI2) * rng.uniform(-1.0, 1.0)
        output = design @ truth + NOISE * rng.standard_normal(x.size)
        fitted = np.linalg.lstsq(cubic, output)[0]
        larger, values, total = with_next_orders(model, fitted, cov, RANGE_X)
        assert larger.names == (*NAMES, "k0_t4")
        with_it += _chi2(values - truth, total)
        without += _chi2(fitted - truth[:4], cov)
    assert 0.001 < chi2.sf(with_it, 5 * count) < 0.999
    assert chi2.sf(without, 4 * count) < 1e-9


def test_the_scale_factor_is_relative_and_the_highest_order_stays() -> None:
    names = ("k1", "k1_t1", *(f"k0_t{k}" if k else "k0" for k in range(MAX_ORDER + 1)))
    model = ErrorModel(tuple(term(n) for n in names))
    values = np.zeros(len(names))
    values[model.names.index("k1")] = 1.01
    sigmas = np.full(len(names), 1e-9)
    larger, _, cov = with_next_orders(model, values, np.diag(sigmas**2), RANGE_X)
    assert {*larger.names} - {*names} == {"k1_t2", "k1_t3", "k1_t4"}
    half = 0.5 * (RANGE_X[1] - RANGE_X[0])
    # the fourth Legendre polynomial on the range begins with 35/8·u⁴; the first is u
    added = larger.names.index("k1_t4")
    expected = UNSEEN_SIGMAS * 1e-9 * half * 35.0 / 8.0 / half**4
    np.testing.assert_allclose(np.sqrt(cov[added, added]), expected, rtol=1e-12)


def _chi2(error: FloatArray, cov: FloatArray) -> float:
    size = np.sqrt(np.diag(cov))
    u = error / size
    return float(u @ np.linalg.solve(cov / np.outer(size, size), u))
