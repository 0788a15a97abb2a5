"""Orders that the choice leaves out: sigmas that allow for them, and no wider than that."""

from dataclasses import replace

import numpy as np

from accelbench.joint.chambers import chamber_model
from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import ModelFile, make_model_file
from thermo.fitting.fit import AccelerometerFit, TermsFile, fit_runs
from thermo.uncertainty.order_choice import with_next_orders
from thermo.uncertainty.unseen_orders import EVIDENCE, root_mean_square

# a loop of 25 °C: the sigma of K0's third order is then 0.00055 µg/°C³
SHORT = Setup(runs=2, corners_c=(20.0, 45.0, 20.0), rates=(0.5,), step_s=20.0, drift_ug=0.0)
HIDDEN = {**TRUE, "k0_t3": 0.0011}  # two sigma of its own: not chosen in most campaigns


def fitted(setup: Setup, seed: int) -> AccelerometerFit:
    (one,) = fit_runs(campaign(setup, seed))
    return one


def off(models: ModelFile, truth: dict[str, float]) -> dict[str, float]:
    """Return the deviations of the polynomials' coefficients in stated sigmas."""
    (one,) = models.accelerometers
    return {
        n: (c.value - truth.get(n, 0.0)) / c.sigma
        for n, c in one.coefficients.items()
        if n.startswith(("k0_t", "k1_t"))
    }


def test_what_readings_leave_to_an_order_goes_from_noise_to_the_whole_estimate() -> None:
    at_none = root_mean_square(0.0, 2.0)
    np.testing.assert_allclose(at_none, 2.0 * np.sqrt(EVIDENCE / (1.0 + EVIDENCE)), rtol=1e-12)
    assert 3.0 < root_mean_square(3.0, 1.0) < np.hypot(3.0, 1.0)
    np.testing.assert_allclose(root_mean_square(60.0, 1.0), np.hypot(60.0, 1.0), rtol=1e-9)
    assert root_mean_square(0.0, float("inf")) == float("inf")


def test_an_order_that_the_choice_left_out_is_within_the_sigmas() -> None:
    setup = replace(SHORT, truth=HIDDEN)
    worst: list[float] = []
    bare: list[float] = []
    for seed in (1, 2, 4):
        one = fitted(setup, seed)
        assert "k0_t3" not in one.fit.names
        worst.append(max(abs(z) for z in off(make_model_file([one]), HIDDEN).values()))
        terms = TermsFile(terms=tuple(t.name for t in one.fit.model.terms))
        (given,) = fit_runs(campaign(setup, seed), terms=terms)
        bare.append(max(abs(z) for z in off(make_model_file([given]), HIDDEN).values()))
    assert max(worst) < 4.0
    assert max(bare) > 5.0  # the user's terms are taken for the true ones


def test_where_no_order_is_missing_sigmas_are_hardly_wider() -> None:
    terms = TermsFile(terms=tuple(TRUE))
    ratios: list[float] = []
    inside: list[bool] = []
    for seed in (21, 22, 23):
        runs = campaign(SHORT, seed)
        (chosen,), (given,) = fit_runs(runs), fit_runs(runs, terms=terms)
        if set(chosen.fit.names) != set(given.fit.names):
            continue
        ratios += [chosen.fit.sigma(n) / given.fit.sigma(n) for n in given.fit.names]
        inside += [abs(z) < 1.96 for z in off(make_model_file([chosen]), TRUE).values()]
    assert len(ratios) >= 20
    assert min(ratios) > 1.0 - 1e-9
    assert np.median(ratios) < 1.5
    assert np.mean(inside) > 0.8


def test_a_compensated_reading_hardly_knows_of_it() -> None:
    """The moved coefficients are correlated: within the range their errors cancel."""
    setup = replace(SHORT, truth=HIDDEN)
    one = fitted(setup, 1)
    runs = campaign(replace(setup, runs=1, white_ug=0.0, thermistor_noise_c=0.0), 77)
    models = make_model_file([one])
    done = compensate(runs, models)
    truth = np.sin(np.deg2rad(runs.position_deg))
    covered = ~done.outside_range
    error = 1e6 * (done.accel_compensated_g - truth)[covered]
    model_sigma = 1e6 * done.accel_sigma_g[covered]
    assert np.abs(error / model_sigma).max() < 3.0
    assert model_sigma.max() < 2.0 * SHORT.white_ug  # the white noise of a reading is in it


def test_the_rig_counts_an_order_once() -> None:
    one = fitted(SHORT, 21)
    (entry,) = make_model_file([one]).accelerometers
    chamber = chamber_model(entry)
    at = [chamber.model.names.index(n) for n in entry.names]
    np.testing.assert_allclose(
        np.sqrt(np.diag(chamber.cov)[at]), np.sqrt(np.diag(entry.own_covariance())), rtol=1e-9
    )
    moves = entry.own_moves()
    for (family, order), by in moves.items():
        own = chamber.model.names.index(f"{family}_t{order}")
        least = abs(by[f"{family}_t{order}"])
        assert np.sqrt(chamber.cov[own, own]) >= least * (1.0 - 1e-9) > 0.0
    values = np.array([entry.values()[n] for n in entry.names])
    again = with_next_orders(
        entry.error_model(), values, entry.own_covariance(), (-5.0, 20.0), moves
    )[2]
    assert np.linalg.eigvalsh(again / np.outer(*[np.sqrt(np.diag(again))] * 2)).min() > -1e-9


def test_an_order_moves_the_fit_by_what_its_moves_say() -> None:
    """Readings that have the order of the moves: the fit errs as they say."""
    one = fitted(SHORT, 21)
    (mine,) = [u for u in one.doubts.unseen if (u.family, u.order) == ("k0", 3)]
    quiet = replace(SHORT, white_ug=0.0, thermistor_noise_c=0.0)
    added = {**TRUE, **{n: TRUE.get(n, 0.0) - 1e6 * m for n, m in mine.moves.items()
                        if n.startswith("k0_t")}}  # fmt: skip
    terms = TermsFile(terms=tuple(t.name for t in one.fit.model.terms))
    (without,) = fit_runs(campaign(quiet, 21), terms=terms)
    (with_it,) = fit_runs(campaign(replace(quiet, truth=added), 21), terms=terms)
    for name in ("k0_t1", "k0_t2"):
        true_change = -mine.moves[name]
        found_change = with_it.fit.value(name) - without.fit.value(name)
        # moves that are orthogonal to what the fit holds: it takes up nothing of them
        assert abs(found_change) < 0.02 * abs(true_change)
