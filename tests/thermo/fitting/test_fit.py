"""The joint fit of recorded runs: recovery over seeds, orders by held-out runs, refusals."""

import numpy as np
import pytest
from scipy import stats

from errormodel.errors import InputError, NotSeparableError
from tests.thermo.examples import TRUTH, recorded, runs_of, simulate_run
from thermo.compensation.model_file import reported
from thermo.fitting.fit import TermsFile, fit_runs, read_terms

WHITE_AND_DRIFT_UG = float(np.hypot(5.0, 3.0))


@pytest.mark.parametrize("seeds", [8, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize("drift_ug", [0.0, 3.0], ids=["white", "drift"])
def test_coefficients_and_held_out_runs_over_many_seeds(drift_ug: float, seeds: int) -> None:
    """True coefficients inside the stated sigmas; a run not fitted is predicted to the noise."""
    terms = TermsFile(terms=tuple(TRUTH))
    total, heldout = 0.0, []
    for seed in range(seeds):
        (one,) = fit_runs(runs_of(seed, drift_ug=drift_ug), terms=terms, holdout=("3",))
        found = reported(one.fit, 1.3, "mA")
        error = np.array([found[n]["value"] - TRUTH[n] for n in one.fit.names])
        sigma = np.array([found[n]["sigma"] for n in one.fit.names])
        correlation = one.fit.cov / np.outer(one.fit.sigmas, one.fit.sigmas)
        z = error / sigma
        total += float(z @ np.linalg.solve(correlation, z))
        heldout.append(one.heldout.rms_ug)
    # never too sure; these runs do not differ at all, which so few cannot prove, so the sigmas are
    # wider than the scatter: by less than 1.5 times
    assert stats.chi2.sf(total, seeds * len(TRUTH)) > 0.001
    assert total / (seeds * len(TRUTH)) > 1.5**-2
    assert np.sqrt(np.mean(np.square(heldout))) <= 1.05 * np.hypot(5.0, drift_ug)


def test_orders_are_those_that_made_the_data() -> None:
    (one,) = fit_runs(runs_of(7))
    assert one.selection is not None
    assert (one.selection.k0_order, one.selection.k1_order) == (3, 2)
    assert one.selection.held_out == "each run in turn"
    assert one.selection.not_separable == ("delta_p", "k_io")
    assert one.summary.rms_ug < 1.05 * WHITE_AND_DRIFT_UG
    assert one.heldout is not None
    assert one.heldout.rms_ug < 1.10 * WHITE_AND_DRIFT_UG  # fitted to two runs only, each time
    assert one.raw.rms_ug > 500.0


def test_a_loop_the_model_lacks_is_reported_with_its_size_and_sign() -> None:
    (one,) = fit_runs(runs_of(3, loop_ug=15.0))
    # ±15 µg open loop, less what the polynomial takes where the loop closes
    assert one.summary.heating_minus_cooling_ug == pytest.approx(30.0, abs=5.0)
    assert one.summary.loop_at(20.0) == pytest.approx(30.0, abs=6.0)
    assert one.summary.loop_at(200.0) is None


def test_two_accelerometers_are_fitted_each_on_its_own() -> None:
    rng = np.random.default_rng(0)
    other = {**TRUTH, "k0": 1234.0}
    both = recorded(simulate_run(rng, serial="A"), simulate_run(rng, serial="B", truth=other))
    fits = fit_runs(both, terms=TermsFile(terms=tuple(TRUTH)))
    assert [f.serial for f in fits] == ["A", "B"]
    for one, expected in zip(fits, (-429.0, 1234.0), strict=True):
        found = reported(one.fit, 1.3, "mA")["k0"]
        assert abs(found["value"] - expected) < 5 * found["sigma"]
        assert one.heldout is None  # one run: nothing to hold out


def test_third_order_is_not_separable_at_four_positions_and_said_so() -> None:
    square = (0.0, 90.0, 180.0, 270.0)
    (one,) = fit_runs(runs_of(1, angles=square))
    assert one.selection is not None
    assert set(one.selection.not_separable) == {"k3", "k_ip", "delta_p", "k_io"}
    with pytest.raises(NotSeparableError, match="k1 ~ k3"):
        fit_runs(runs_of(1, angles=square), terms=TermsFile(terms=("k1", "k0", "k3")))


def test_encoder_noise_does_not_make_an_alias_separable() -> None:
    rng = np.random.default_rng(2)
    frame = simulate_run(rng, angles=(0.0, 90.0, 180.0, 270.0))
    frame["position_deg"] += 0.001 * rng.standard_normal(len(frame))
    (one,) = fit_runs(recorded(frame))
    assert one.selection is not None
    assert "k3" in one.selection.not_separable


def test_one_position_gives_bias_like_terms_only() -> None:
    (one,) = fit_runs(runs_of(1, angles=(90.0,), count=2))
    assert all(n.startswith(("k0", "k1_t")) for n in one.fit.names)
    assert "k1" not in one.fit.names


def test_a_recording_without_input_is_fitted_for_bias_and_refuses_the_rest() -> None:
    frame = simulate_run(np.random.default_rng(0), angles=(90.0,)).drop(columns="position_deg")
    runs = recorded(frame)
    (one,) = fit_runs(runs)
    assert set(one.fit.names) <= {"k0", "k0_t1", "k0_t2", "k0_t3", "k0_t4"}
    with pytest.raises(InputError, match="k1 need a known input"):
        fit_runs(runs, terms=TermsFile(terms=("k1", "k0")))


def test_flagged_readings_are_left_out() -> None:
    frame = simulate_run(np.random.default_rng(0))
    frame["flag"] = ""
    frame.loc[100:110, "flag"] = "moving"
    frame.loc[100:110, "output"] = 5.0
    (one,) = fit_runs(recorded(frame))
    assert one.fit.n == len(frame) - 11
    assert one.summary.rms_ug < 1.1 * WHITE_AND_DRIFT_UG


def test_a_lag_is_fitted_in_seconds() -> None:
    """The inside 90 s behind the thermistor, made by a fine Euler integration of its own."""
    rng = np.random.default_rng(5)
    frame = simulate_run(rng, white_ug=5.0, drift_ug=0.0)
    fine_t = np.arange(0.0, frame["time_s"].iloc[-1] + 1.0, 0.5)
    seen = np.interp(fine_t, frame["time_s"], np.round(frame["temp_c"], 2))
    inside = np.empty_like(seen)
    inside[0] = seen[0]
    for k in range(1, seen.size):
        inside[k] = inside[k - 1] + 0.5 / 90.0 * (seen[k - 1] - inside[k - 1])
    # the simulation used temp_c as the inside; what is recorded is the shell, 90 s ahead
    shell = frame.copy()
    lagged = np.interp(frame["time_s"], fine_t, inside)
    x, xl = frame["temp_c"] - 25.0, lagged - 25.0
    slope = 1e-6 * TRUTH["k1_t1"] * (xl - x) + 1e-6 * TRUTH["k1_t2"] * (xl**2 - x**2)
    bias = sum(1e-6 * TRUTH[f"k0_t{k}"] * (xl**k - x**k) for k in (1, 2, 3))
    a_i = np.sin(np.deg2rad(frame["position_deg"]))
    shell["output"] += TRUTH["k1"] * (slope * a_i + bias)
    names = (*TRUTH, "thermal_lag")
    (one,) = fit_runs(recorded(shell), terms=TermsFile(terms=names))
    tau, sigma = one.fit.value("thermal_lag"), one.fit.sigma("thermal_lag")
    assert abs(tau - 90.0) < 4 * sigma + 1.0  # 1 s: the thermistor's noise is not in the simulation
    assert sigma < 2.0


def test_runs_that_are_not_there_and_too_few_readings_are_refused() -> None:
    runs = runs_of(0, count=2)
    with pytest.raises(InputError, match="no run '9' to hold out; expected 1, 2"):
        fit_runs(runs, holdout=("9",))
    with pytest.raises(InputError, match="no run is left"):
        fit_runs(runs, holdout=("1", "2"))
    with pytest.raises(InputError, match="20 readings"):
        fit_runs(recorded(simulate_run(np.random.default_rng(0), n=20)))


def test_a_terms_file_is_checked(tmp_path) -> None:
    path = tmp_path / "terms.toml"
    path.write_text('terms = ["k0", "k9"]')
    with pytest.raises(InputError, match=r"terms\.toml: terms: no term 'k9'; expected one like k"):
        read_terms(path)
    path.write_text('terms = ["k0", "k0"]')
    with pytest.raises(InputError, match="listed twice"):
        read_terms(path)


@pytest.mark.parametrize("seeds", [2, pytest.param(12, marks=pytest.mark.slow)])
def test_coefficients_are_true_when_the_data_chose_the_model_too(seeds: int) -> None:
    """The whole default fit, orders included: nothing below a reading's noise is left behind."""
    total, unknowns = 0.0, 0
    for seed in range(100, 100 + seeds):
        (one,) = fit_runs(runs_of(seed, drift_ug=0.0))
        found = reported(one.fit, 1.3, "mA")
        z = [(found[n]["value"] - TRUTH.get(n, 0.0)) / found[n]["sigma"] for n in one.fit.names]
        correlation = one.fit.cov / np.outer(one.fit.sigmas, one.fit.sigmas)
        total += float(z @ np.linalg.solve(correlation, z))
        unknowns += len(z)
        assert set(TRUTH) <= set(one.fit.names)
    assert stats.chi2.sf(total, unknowns) > 0.001
    assert total / unknowns > 1.5**-2  # as above, and for orders that might be left out


def flicker(rng: np.random.Generator, n: int) -> np.ndarray:
    """Draw 1/f noise of unit rms by shaping a spectrum four times as long."""
    f = np.fft.rfftfreq(4 * n)[1:]
    shaped = (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)) / np.sqrt(f)
    noise = np.fft.irfft(np.concatenate([[0.0], shaped]))[:n]
    return noise / np.std(noise)


@pytest.mark.parametrize("seeds", [4, pytest.param(20, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["random walk", "flicker"])
def test_sigmas_hold_for_drift_of_another_family_than_assumed(kind: str, seeds: int) -> None:
    """4 µg of random walk over the run, or 2 µg of 1/f noise: neither is Ornstein-Uhlenbeck."""
    terms = TermsFile(terms=tuple(TRUTH))
    total = 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        frames = [simulate_run(rng, run=r, drift_ug=0.0) for r in "123"]
        for frame in frames:
            n = len(frame)
            walk = np.cumsum(rng.standard_normal(n)) * 4.0 / np.sqrt(n)
            drift_ug = walk if kind == "random walk" else 2.0 * flicker(rng, n)
            frame["output"] += TRUTH["k1"] * 1e-6 * drift_ug
        (one,) = fit_runs(recorded(*frames), terms=terms)
        found = reported(one.fit, 1.3, "mA")
        z = [(found[n]["value"] - TRUTH[n]) / found[n]["sigma"] for n in one.fit.names]
        correlation = one.fit.cov / np.outer(one.fit.sigmas, one.fit.sigmas)
        total += float(z @ np.linalg.solve(correlation, z))
    assert 0.001 < stats.chi2.sf(total, seeds * len(TRUTH)) < 0.999


def test_a_run_that_alone_carries_a_coefficient_cannot_be_predicted_and_nothing_breaks() -> None:
    rng = np.random.default_rng(4)
    tumbled = simulate_run(rng, run="1")
    still = simulate_run(rng, run="2", angles=(90.0,))
    (one,) = fit_runs(recorded(tumbled, still))
    assert {"k1", "k0", "k2", "delta_o"} <= set(one.fit.names)
    assert one.heldout is None
    assert one.summary.rms_ug < 1.2 * WHITE_AND_DRIFT_UG


def test_a_loop_that_is_not_there_does_not_hide_behind_its_width() -> None:
    """The width of a loop of nearly nothing is badly known, not 'without effect'."""
    names = (*TRUTH, "bias_hysteresis")
    (one,) = fit_runs(runs_of(6, loop_ug=0.3, drift_ug=0.0), terms=TermsFile(terms=names))
    found = reported(one.fit, 1.3, "mA")
    assert abs(found["bias_hysteresis"]["value"]) < 5.0
