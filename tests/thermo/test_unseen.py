"""Orders that the choice leaves out: sigmas that allow for them, and no wider than that."""

from dataclasses import replace

import numpy as np
import pytest

from tests.thermo.strange_runs import TRUE, Setup, campaign, output_of
from thermo.compensation import compensate
from thermo.fitting import AccelerometerFit, TermsFile, fit_runs
from thermo.modelfile import ModelFile, make_model_file
from thermo.next_order import with_next_orders
from thermo.unseen import EVIDENCE, root_mean_square
from workbench.chamber_models import chamber_model

# an hour's loop of 20 °C: the sigma of the fourth order of K1 is then some 1e-5 ppm/°C⁴
SHORT = Setup(runs=2, corners_c=(20.0, 45.0, 20.0), rates=(0.5,), step_s=20.0, drift_ug=0.0)
HIDDEN = {**TRUE, "k1_t3": 0.004}  # two to three sigma of its own: not chosen in most campaigns


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
    for seed in range(1, 40):
        one = fitted(setup, seed)
        if "k1_t3" in one.fit.names:
            continue
        models = make_model_file([one])
        worst.append(max(abs(z) for z in off(models, HIDDEN).values()))
        terms = TermsFile(terms=tuple(t.name for t in one.fit.model.terms))
        (given,) = fit_runs(campaign(setup, seed), terms=terms)
        bare.append(max(abs(z) for z in off(make_model_file([given]), HIDDEN).values()))
        if len(worst) == 4:
            break
    assert len(worst) == 4
    assert max(worst) < 4.0
    assert max(bare) > 5.0  # the user's terms are taken for the true ones


def test_where_no_order_is_missing_sigmas_are_hardly_wider() -> None:
    terms = TermsFile(terms=tuple(TRUE))
    ratios: list[float] = []
    inside: list[bool] = []
    for seed in range(21, 27):
        runs = campaign(SHORT, seed)
        (chosen,), (given,) = fit_runs(runs), fit_runs(runs, terms=terms)
        if set(chosen.fit.names) != set(given.fit.names):
            continue
        ratios += [chosen.fit.sigma(n) / given.fit.sigma(n) for n in given.fit.names]
        inside += [abs(z) < 1.96 for z in off(make_model_file([chosen]), TRUE).values()]
    assert len(ratios) > 20
    assert min(ratios) > 1.0 - 1e-9
    assert np.median(ratios) < 1.5
    assert np.mean(inside) > 0.8


def test_a_compensated_reading_hardly_knows_of_it() -> None:
    """The moved coefficients are correlated: within the range their errors cancel."""
    setup = replace(SHORT, truth=HIDDEN)
    for seed in range(1, 40):
        one = fitted(setup, seed)
        if "k1_t3" not in one.fit.names:
            break
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


@pytest.mark.parametrize("order", [3, 4])
def test_an_unseen_order_moves_the_fit_as_it_says(order: int) -> None:
    """What the moves say is what a fit of readings with that order does."""
    one = fitted(SHORT, 21)
    unseen = {(u.family, u.order): u for u in one.doubts.unseen}
    mine = unseen["k0", order]
    size = -mine.moves[f"k0_t{order}"]
    assert size != 0.0
    truth = {n: 1e6 * -m for n, m in mine.moves.items() if n.startswith("k0")}
    runs = campaign(replace(SHORT, white_ug=0.0, thermistor_noise_c=0.0), 21)
    added = output_of({"k1": 1.0, **{n: truth.get(n, 0.0) for n in ZERO}, **truth},
                      runs.temp_c, runs.position_deg) - np.sin(np.deg2rad(runs.position_deg))  # fmt: skip
    columns = np.vander(runs.temp_c - 25.0, 3, increasing=True)
    left = added - columns @ np.linalg.lstsq(columns, added)[0]
    # the polynomial of the moves is what the fit does not hold: nothing of it is left to take up
    assert np.linalg.norm(left) > 0.9 * np.linalg.norm(added)


ZERO = ("k0", "k2", "k3", "k_ip", "delta_o")
