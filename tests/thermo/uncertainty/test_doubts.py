"""What a fit does not know is in its sigmas or in a sentence: runs that differ, gaps, left-outs."""

import numpy as np
import pytest

from accelbench.commands.fit.doubts import doubt_sentences, run_to_run_sentence
from accelbench.commands.fit.text import fit_sentences
from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign
from tests.thermo.uncertainty.doubted import HEATING, STAGES, error_ug, fitted, said, worst
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import make_model_file
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import make_runs

# ---- one scale ----


@pytest.mark.parametrize(
    "share", [0.55, *(pytest.param(s, marks=pytest.mark.slow) for s in (0.9, 1.9))]
)
def test_every_figure_is_over_the_k1_found_whatever_the_nominal_scale(share: float) -> None:
    right, off = Setup(runs=2), Setup(runs=2, nominal=1.3 * share)
    one, other = fitted(right), fitted(off)
    assert other.own_scale == pytest.approx(one.own_scale, rel=1e-9)
    for of in ("raw", "summary", "heldout"):
        assert getattr(other, of).rms_ug == pytest.approx(getattr(one, of).rms_ug, rel=1e-4)
    assert other.noise.white == pytest.approx(one.noise.white, rel=1e-3)
    assert other.doubts.loop_sigma_ug == pytest.approx(one.doubts.loop_sigma_ug, rel=0.05)
    assert other.selection
    assert one.selection
    mine, its = (s.trial(2, 2) for s in (other.selection, one.selection))
    assert mine
    assert its
    assert mine.heldout_ug == pytest.approx(its.heldout_ug, rel=1e-4)
    # what is left is what compensate leaves of the same rows
    done = compensate(campaign(off, 1), make_model_file([other])).accel_compensated_g
    left = 1e6 * (done - np.sin(np.deg2rad(campaign(off, 1).position_deg)))
    assert np.sqrt(np.mean(left**2)) == pytest.approx(other.summary.rms_ug, rel=0.01)


# ---- runs that differ ----


@pytest.mark.parametrize(
    ("differs", "unit"),
    [({"offset_ug": 30.0}, "µg in K0"), ({"scale_ppm": 30.0}, "ppm in K1"),
     ({"thermistor_c": 0.1}, "°C in the thermistor")],
)  # fmt: skip
@pytest.mark.parametrize("runs", [4, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 8))])
def test_runs_that_differ_are_told_and_carried(runs: int, differs, unit: str) -> None:
    setup = Setup(runs=runs, **differs)
    one = fitted(setup, seed=4)
    assert worst(one, setup) < 5.0
    assert runs == 2 or unit in run_to_run_sentence(one)
    assert one.selection
    assert (one.selection.k0_order, one.selection.k1_order) == (2, 2)


def test_a_single_run_says_that_it_knows_nothing_of_others() -> None:
    one = fitted(Setup(runs=1))
    assert "the differences between runs are not known" in said(one)
    assert make_model_file([one]).accelerometers[0].run_to_run is None
    assert worst(one, Setup()) < 5.0


@pytest.mark.slow  # of four runs below
def test_an_odd_run_is_named() -> None:
    assert "run R2 lies apart from the others" in said(fitted(Setup(runs=8, odd_run_ug=100.0)))
    assert "lies apart" not in said(fitted(Setup(runs=8)))


@pytest.mark.parametrize("seed", [3, *(pytest.param(s, marks=pytest.mark.slow) for s in (4, 5))])
def test_an_odd_run_of_four_is_named(seed: int) -> None:
    odd = fitted(Setup(odd_run_ug=100.0), seed).doubts.odd_run
    assert odd is not None
    assert (odd.run_id, odd.name) == ("R2", "k0")
    assert abs(1e6 * odd.off - 100.0) < 5.0 * 1e6 * odd.sigma


def test_noise_of_the_thermistor_within_a_soak_is_no_difference_between_runs() -> None:
    """Within a soak the output follows no temperature; taken for a slope, runs would differ."""
    one = fitted(Setup(soaks_c=HEATING, thermistor_noise_c=0.02))
    by_name = {e.name: e for e in one.run_effects}
    assert by_name["temp_c"].next_sigma < 0.1
    assert 1e6 * by_name["k1"].next_sigma < 10.0


def test_the_held_out_figure_of_two_runs_is_hardly_known() -> None:
    """Two runs differ by one number: from it a sigma is known to a factor (Student's t)."""
    few, many = (fitted(Setup(runs=n, offset_ug=30.0), seed=4) for n in (2, 8))
    for one in (few, many):
        assert one.heldout
        assert one.heldout_sigma_ug
    assert few.heldout_sigma_ug > 2.0 * few.heldout.rms_ug  # type: ignore[operator, union-attr]
    assert many.heldout_sigma_ug < 0.5 * many.heldout.rms_ug  # type: ignore[operator, union-attr]


def test_runs_at_one_temperature_each_with_offsets_keep_order_two() -> None:
    setup = Setup(runs=7, soaks_c=STAGES, offset_ug=30.0)
    one = fitted(setup, seed=3)
    assert worst(one, setup) < 5.0
    assert "µg in K0" in run_to_run_sentence(one)


# ---- where nothing was measured ----


def test_two_soaks_carry_what_may_be_between_them() -> None:
    setup = Setup(runs=4, soaks_c=HEATING)
    one = fitted(setup)
    assert worst(one, setup) < 3.0
    assert len(one.support.gaps_c) == 1
    assert "no reading from −40 to 70 °C" in said(one)
    assert set(one.selection.not_separable) >= {"k0_t2", "k1_t2"}  # type: ignore[union-attr]
    ramp = Setup(runs=2)
    error, sigma = error_ug(ramp, one, 7)
    runs = campaign(ramp, 7)
    between = (runs.temp_c > -39.0) & (runs.temp_c < 69.0)
    done = compensate(runs, make_model_file([one]))
    assert done.outside_range[between].all()
    assert np.sqrt(np.mean(error**2)) > 100.0  # it is as bad as ever, and known
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.95


@pytest.mark.parametrize(
    "setup",
    [Setup(runs=2, soaks_c=(70.0,)), Setup(corners_c=(48.0, 53.0, 48.0, 53.0, 48.0))],
    ids=["one temperature", "a narrow range"],
)
def test_a_reference_temperature_outside_is_said_and_carried(setup: Setup) -> None:
    one = fitted(setup)
    assert worst(one, setup) < 3.0
    assert "°C outside the readings" in said(one)
    entry = make_model_file([one]).accelerometers[0]
    assert entry.inside is not None
    x = entry.inside.t_ref_c - 25.0
    bias = TRUE["k0"] + TRUE["k0_t1"] * x + TRUE["k0_t2"] * x**2
    k0 = entry.inside.coefficients["k0"]
    assert abs(k0.value - bias) < 4.0 * k0.sigma + 1.0
    assert k0.sigma < 20.0


def test_within_the_range_only_orders_left_out_are_counted() -> None:
    one = fitted(Setup())
    assert one.doubts.inside is None
    orders = [(u.family, u.order) for u in one.doubts.unseen]
    assert orders == [("k0", 3), ("k1", 3), ("k0", 4), ("k1", 4)]  # what the choice left out
    (given,) = fit_runs(campaign(Setup(), 1), terms=TermsFile(terms=tuple(TRUE)))
    assert given.doubts.unseen == ()
    assert list(doubt_sentences(one)) == [
        "these runs cannot determine: delta_p, k_io, each taken as 0"
    ]


def test_what_cannot_be_given_is_named_with_what_holds_it() -> None:
    one = fitted(Setup(positions=(0.0, 90.0, 180.0, 270.0), runs=2))
    assert "k3 in k1" in said(one)


def test_one_position_says_which_coefficient_holds_the_scale_factor() -> None:
    """At +1 g the output is K1·(1 + K0): all that K1 does is K0's."""
    text = said(fitted(Setup(positions=(90.0,), runs=2)))
    assert "k1, taken as nominal" in text
    for held in ("k1 in k0;", "k1_t1 in k0_t1", "k1_t2 in k0_t2", "k2 in k0", "k3 in k0"):
        assert held in text


def test_three_soaks_carry_the_third_order_that_they_cannot_show() -> None:
    cubic = Setup(runs=3, soaks_c=(-40.0, 25.0, 70.0), truth={**TRUE, "k0_t3": 5e-4})
    one = fitted(cubic)
    assert "no reading from" in said(one)
    error, sigma = error_ug(Setup(runs=2, truth=cubic.truth), one, 7)
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.95


def test_runs_none_of_which_can_be_held_out_say_why() -> None:
    one = fitted(Setup(runs=3, soaks_c=(-40.0, 25.0, 70.0)))
    assert one.heldout is None
    assert "no run can be held out: the other runs alone do not determine every" in said(one)


@pytest.mark.parametrize("noise_c", [0.1, pytest.param(0.3, marks=pytest.mark.slow)])
def test_a_noisy_thermistor_in_a_narrow_range_is_in_the_sigmas(noise_c: float) -> None:
    setup = Setup(corners_c=(22.0, 27.0, 22.0, 27.0), rates=(0.1,), thermistor_noise_c=noise_c)
    assert worst(fitted(setup), setup) < 5.0


# ---- what the residual still follows ----


@pytest.mark.parametrize(
    ("setup", "words"),
    [
        (Setup(lag_s=120.0), "slope over temperature (a lag of 11"),
        (Setup(lag_s=120.0), "this is not drift"),
        (Setup(loop_ug=20.0), "thermal-history effect"),
        pytest.param(
            Setup(line_ug_h=10.0), "bias drift is longer than a run", marks=pytest.mark.slow
        ),
        pytest.param(
            Setup(truth={**TRUE, "k0_t5": 4e-7}), "to the power 5", marks=pytest.mark.slow
        ),
        pytest.param(
            Setup(lag_s=120.0, corners_c=HEATING),
            "the sigmas do not include them: here a thermal",
            marks=pytest.mark.slow,
        ),
        (Setup(lsb_ug=50.0, white_ug=1.0), "the output goes in steps of 50 µg"),
        (Setup(corners_c=(24.0, 26.0, 24.0, 26.0), rates=(0.05,), thermistor_noise_c=0.1),
         "the thermistor's noise of 0.09"),
    ],
    ids=["lag", "lag, its noise", "loop", "line", "fifth order", "one way", "steps", "noise in T"],
)  # fmt: skip
def test_what_a_model_lacks_gets_its_sentence(setup: Setup, words: str) -> None:
    assert words in said(fitted(setup))


@pytest.mark.parametrize("lacks", ["k2", "k1_t2"])
def test_a_term_that_was_not_given_is_missed(lacks: str) -> None:
    names = tuple(n for n in TRUE if n != lacks)
    (one,) = fit_runs(campaign(Setup(), 1), terms=TermsFile(terms=names))
    assert lacks in [f.name for f in one.doubts.left_out]
    assert "the residual still follows" in said(one)


def test_two_runs_that_agree_may_do_so_by_chance_and_it_is_said() -> None:
    one = fitted(Setup(runs=2, offset_ug=30.0), seed=2)  # 30 µg of offset, alike in both
    assert worst(one, Setup()) < 5.0  # the sigma carries what so few do not show
    sentence = (
        "the 2 runs do not differ by more than noise and drift, which may be by chance with so few "
        "runs"
    )
    assert sentence in said(one)


def test_a_sound_fit_says_nothing_of_the_kind() -> None:
    for seed in (11, 12):
        one = fitted(Setup(), seed)
        assert not one.doubts.left_out
        assert not one.doubts.noise_sentences


def test_positions_that_are_not_what_is_recorded_are_told() -> None:
    """A sixth of the readings are still those of the position before."""
    frame = campaign(Setup(runs=2), 1).frame()
    late = frame["time_s"] % 60.0 == 0.0
    frame["position_deg"] = frame["position_deg"].where(
        ~late, frame.groupby("run")["position_deg"].shift(-1, fill_value=0.0).to_numpy()[::-1]
    )
    runs = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)
    (one,) = fit_runs(runs)
    assert "check for wrong positions, a head that moves during the readings" in said(one)


def test_what_repeats_and_was_not_stated_is_told() -> None:
    (line,) = [t for t in fit_sentences(fitted(Setup(runs=2))) if t.startswith("noise")]
    for key in ("head_arcsec", "temp_sigma_c", "temp_gain_ppm"):
        assert key in line
    stated = TermsFile(head_arcsec=1.0)
    frame = campaign(Setup(runs=2), 1).frame()
    runs = make_runs(
        frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3,
        temp_sigma_c=0.1, temp_gain_ppm=100.0,
    )  # fmt: skip
    (one,) = fit_runs(runs, terms=stated)
    assert "not stated" not in said(one)
