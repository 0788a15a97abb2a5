import numpy as np
import pytest
from scipy import stats

from errormodel.errors import InputError, NotSeparableError
from sinscal.triad.intervals import find_intervals
from sinscal.triad.model import TriadModel
from sinscal.triad.triad import TriadFit, errors_of, fit_triad, paule_mandel
from tests.sinscal.jig import fit_jig
from tests.sinscal.triad.example import COUNTS, G, directions, readings, recording

WARM = np.array([0.5, -0.4, 0.3, 1e-4, -2e-4, 1e-4])  # counts/°C and 1/°C


def fitted(
    seed: int, *, k: int = 24, pose: float = 1e-3, gauge: str = "lower", warm: bool = False
) -> tuple[TriadFit, np.ndarray]:
    """Fit a triad of raw counts: 3 counts of noise, 400 rows a position, scatter between them."""
    rng = np.random.default_rng(seed)
    truth = np.concatenate([COUNTS, WARM]) if warm else COUNTS
    temp = rng.uniform(-20, 20, k) if warm else np.zeros(k)
    temp = temp - temp.mean()
    size = G + pose * rng.standard_normal(k)
    means = readings(size[:, None] * directions(k, rng), truth, gauge, temp)
    means += 3.0 / np.sqrt(400) * rng.standard_normal(means.shape)
    fit = fit_triad(
        means,
        np.full(k, 400),
        np.full(3, 3.0),
        G,
        gauge=gauge,  # type: ignore[arg-type]
        temp_c=25.0 + temp if warm else None,
    )
    return fit, truth


@pytest.mark.parametrize("gauge", ["lower", "upper"])
@pytest.mark.parametrize("warm", [False, True])
def test_without_noise_the_triad_comes_out_exactly(gauge, warm):
    rng = np.random.default_rng(1)
    truth = np.concatenate([COUNTS, WARM]) if warm else COUNTS
    temp = rng.uniform(-20, 20, 30) if warm else np.zeros(30)
    temp = temp - temp.mean()
    force = G * directions(30, rng)
    means = readings(force, truth, gauge, temp)
    fit = fit_triad(
        means, np.full(30, 100), np.full(3, 1.0), G, gauge=gauge,
        temp_c=20.0 + temp if warm else None,
    )  # fmt: skip
    # counts of 3e4 are rounded at 4e-12: a share of 1e-15 of the scales, times the condition
    np.testing.assert_allclose(fit.values, truth, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(fit.model.apply(means, temp), force, atol=1e-8)


def test_the_derivatives_are_right():
    rng = np.random.default_rng(2)
    at = np.concatenate([COUNTS, WARM])
    warm = rng.uniform(-20, 20, 12)
    means = readings(G * directions(12, rng), at, "lower", warm)
    _, jacobian = TriadModel.of(at, "lower").magnitude(means, warm)
    step = 1e-6 * np.maximum(np.abs(at), 1e-3)
    for j, h in enumerate(step):
        move = h * np.eye(15)[j]
        up = TriadModel.of(at + move, "lower").magnitude(means, warm)[0]
        down = TriadModel.of(at - move, "lower").magnitude(means, warm)[0]
        scale = np.max(np.abs(jacobian[:, j]))
        np.testing.assert_allclose((up - down) / (2 * h) / scale, jacobian[:, j] / scale, atol=1e-5)


@pytest.mark.parametrize(("pose", "warm"), [(0.0, False), (1e-3, False), (1e-2, True)])
def test_estimates_are_consistent_with_their_covariance(pose, warm):
    """χ² of all unknowns over 150 seeds. Where the scatter between positions is estimated from ν
    degrees of freedom its mean is not p but p·ν/(ν − 2), and its distribution p times F(p, ν).
    """
    seeds, k = 150, 30
    p = 15 if warm else 9
    found = []
    left_out = 0
    for seed in range(seeds):
        fit, truth = fitted(1000 + seed, k=k, pose=pose, warm=warm)
        e = fit.values - truth
        found.append(float(e @ np.linalg.solve(fit.cov, e)) / p)
        left_out += bool(fit.left_out)
    dof = k - p
    law = stats.f(p, dof) if pose > 0 else stats.chi2(p, scale=1 / p)
    # where there is no scatter to find it is estimated as zero half the time, else a little above:
    # the sigmas are then too large by some per cent, never too small
    p_value = stats.kstest(found, law.cdf).pvalue if pose > 0 else 1.0
    assert p_value > 1e-3
    mean, spread = float(law.mean()), float(law.std()) / np.sqrt(seeds)
    assert float(np.mean(found)) < mean + 4 * spread
    assert float(np.mean(found)) > (0.6 if pose == 0 else 0.8) * mean
    # a sound position is left out in one set of a hundred: binomial, p = 0.001
    assert left_out <= stats.binom.isf(1e-3, seeds, 0.01)


def test_a_position_that_does_not_fit_is_left_out_and_logged():
    rng = np.random.default_rng(5)
    means = readings(G * directions(24, rng), COUNTS, "lower", np.zeros(24))
    means += 0.15 * rng.standard_normal(means.shape)
    means[9] += 40.0  # a tenth of m/s²
    fit = fit_triad(means, np.full(24, 400), np.full(3, 3.0), G)
    (one,) = fit.left_out
    assert one.position == 9
    assert abs(one.residual_m_s2) > 0.01
    assert 9 not in fit.used
    e = fit.values - COUNTS
    assert e @ np.linalg.solve(fit.cov, e) < 27.9  # χ², 9 dof, p = 0.001


def test_rows_that_explain_the_scatter_give_chi_squared_of_its_freedom():
    chi2 = [fitted(seed, pose=0.0)[0].chi2 for seed in range(60)]
    # mean of 60 χ² with 15 dof: 4 sigma
    assert abs(np.mean(chi2) - 15) < 4 * np.sqrt(30 / 60)


def test_the_two_gauges_are_one_triad():
    """|f| of any reading is the same, whichever triangle the misalignments stand in."""
    rng = np.random.default_rng(6)
    means = readings(G * directions(24, rng), COUNTS, "lower", np.zeros(24))
    lower, upper = (
        fit_triad(means, np.full(24, 400), np.full(3, 3.0), G, gauge=gauge).model
        for gauge in ("lower", "upper")
    )
    np.testing.assert_allclose(
        lower.matrix.T @ lower.matrix, upper.matrix.T @ upper.matrix, rtol=1e-9
    )


def test_errors_in_the_contract_s_form():
    """f′ = (I + Γ)f + Δf⁰ with Γ lower triangular, its covariance by the seeds' own scatter."""
    gamma = np.array([[3e-3, 0, 0], [1e-3, -2e-3, 0], [4e-4, -6e-4, 1e-3]])
    bias = np.array([0.1, -0.05, 0.02])
    truth = np.concatenate([bias, np.diag(gamma), gamma[[1, 2, 2], [0, 0, 1]]])
    total = 0.0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        means = G * directions(24, rng) @ (np.eye(3) + gamma).T + bias
        means += 1e-3 * rng.standard_normal(means.shape)
        fit = fit_triad(means, np.full(24, 1), np.full(3, 1e-3), G)
        names, values, cov = errors_of(fit)
        e = values - truth
        total += float(e @ np.linalg.solve(cov, e))
    assert names[3:] == (
        "accel_scale_x", "accel_scale_y", "accel_scale_z",
        "accel_misalignment_yx", "accel_misalignment_zx", "accel_misalignment_zy",
    )  # fmt: skip
    lo, hi = stats.chi2.ppf([1e-3, 0.999], 40 * 9)
    assert 0.8 * lo < total < hi  # the scatter between positions, where found, makes it smaller
    with pytest.raises(ValueError, match="lower form"):
        errors_of(fit_triad(means, np.full(24, 1), np.full(3, 1e-3), G, gauge="upper"))


def test_positions_that_cannot_tell_are_named():
    rng = np.random.default_rng(7)
    force = G * directions(24, rng)
    few = readings(force[:8], COUNTS, "lower", np.zeros(8))
    with pytest.raises(InputError, match="8 positions at rest, expected 9 at least"):
        fit_triad(few, np.full(8, 400), np.full(3, 3.0), G)
    turned = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    flat = G * np.column_stack([np.cos(turned), np.sin(turned), 0 * turned])
    means = readings(flat, COUNTS, "lower", np.zeros(20))
    with pytest.raises((NotSeparableError, InputError), match=r"ellipsoid|_z"):
        fit_triad(means, np.full(20, 400), np.full(3, 3.0), G)


def test_paule_and_mandel_make_chi_squared_its_freedom():
    rng = np.random.default_rng(8)
    within2 = rng.uniform(1, 4, 50)
    residual = rng.standard_normal(50) * np.sqrt(within2 + 9.0)
    extra = paule_mandel(residual, within2, 41)
    assert np.sum(residual**2 / (within2 + extra)) == pytest.approx(41, rel=1e-9)
    assert paule_mandel(1e-3 * residual, within2, 41) == 0.0


def test_from_a_raw_recording():
    """Rests found, triad fitted, over 10 seeds: the whole way is consistent with its covariance."""
    total = 0.0
    for seed in range(10):
        raw, _ = recording(seed=seed, positions=24)
        found = find_intervals(raw, 0.01)
        fit = fit_triad(found.means, found.rows, found.noise, G)
        e = fit.values - COUNTS
        total += float(e @ np.linalg.solve(fit.cov, e))
    # F(9, 15) sums wider than χ²: its variance is 2.6 times; 4 sigma
    assert total / 10 < 9 * 15 / 13 + 4 * np.sqrt(2.6 * 18 / 10)
    assert total / 10 > 9 - 4 * np.sqrt(18 / 10)


def test_a_jig_s_harmonic_is_consistent_with_its_covariance():
    truth = np.array([0.02, 0.6, -0.8])
    angle = np.deg2rad(np.arange(36) * 10.0125)
    total = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        design = np.column_stack([np.ones(36), np.cos(angle), np.sin(angle)])
        means = (design @ truth)[:, None] + 1e-3 * rng.standard_normal((36, 1))
        fit = fit_jig(angle, means)
        e = fit.values[0] - truth
        total.append(float(e @ np.linalg.solve(fit.cov[0], e)) / 3)
        assert fit.amplitude[0] == pytest.approx(1.0, abs=5 * fit.amplitude_sigma[0])
        assert fit.phase_rad[0] == pytest.approx(np.arctan2(-0.8, 0.6), abs=2e-3)
    assert stats.kstest(total, stats.f(3, 33).cdf).pvalue > 1e-3
    with pytest.raises(InputError, match="3 angles, expected 4"):
        fit_jig(angle[:3], np.ones((3, 1)))
    with pytest.raises(NotSeparableError):
        fit_jig(1e-4 * angle, np.ones((36, 1)))
