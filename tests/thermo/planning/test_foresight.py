"""What a plan will give, said before it is run."""

import numpy as np
import pytest

from tests.thermo.examples import TRUTH, runs_of
from thermo.compensation.model_file import reported
from thermo.discrepancy.foresee import foresee_effects
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.planning.foresight import foresee_coefficients
from thermo.planning.plan import RunPlan
from thermo.recording.channel import channel_of


def plan_like(seed: int, angles: tuple[float, ...] | None = None) -> list[RunPlan]:
    kw = {} if angles is None else {"angles": angles}
    runs = runs_of(seed, **kw)
    plans = []
    for k, run in enumerate(runs.run_ids):
        part = channel_of(runs.select(runs=[run]), "A")
        plans.append(
            RunPlan(
                number=k + 1,
                time_s=part.record.time_s,
                segment=np.zeros(len(part.record), dtype=np.intp),
                position_deg=part.position_deg,
                commanded_c=part.temp_c,
                temp_c=part.temp_c,
            )
        )
    return plans


def test_foretold_sigmas_are_those_of_the_fit() -> None:
    foresight = foresee_coefficients(plan_like(0), nominal_scale=1.3, output_unit="mA")
    (one,) = fit_runs(runs_of(0), terms=TermsFile(terms=tuple(TRUTH)))
    found = reported(one.fit, 1.3, "mA")
    assert {e.name for e in foresight.expected} == set(TRUTH)
    for e in foresight.expected:
        # the fit estimates the noise: drift of 3 µg is known to some 30 % from three runs
        assert e.sigma == pytest.approx(found[e.name]["sigma"], rel=0.5)
        assert e.unit == found[e.name]["unit"]


def test_what_four_positions_cannot_show_is_said_by_name() -> None:
    foresight = foresee_coefficients(plan_like(0, (0.0, 90.0, 180.0, 270.0)))
    assert ("k1", "k3") in foresight.confounded
    assert ("k_io",) in foresight.confounded
    text = "\n".join(foresight.lines())
    assert "k1 ~ k3" in text
    assert "delta_p has no effect in this plan" in text


def test_what_a_turned_mounting_cannot_show_is_said() -> None:
    # 45° past the quarter turns sin²θ is ½ at each of them: a squared term is a bias
    turned = foresee_coefficients(plan_like(0, (0.0, 90.0, 180.0, 270.0)), mount_deg=45.0)
    assert ("k0", "k2") in turned.confounded
    assert "mounted turned by 45°" in turned.lines()[0]
    effects = foresee_effects(plan_like(0, (0.0, 90.0, 180.0, 270.0)), mount_deg=45.0)
    assert "second_order" in effects.invisible
    assert "second_order" in effects.lines()[0]


def test_more_runs_show_more() -> None:
    plans = plan_like(0)
    one, all_of_them = foresee_coefficients(plans[:1]), foresee_coefficients(plans)
    assert [f.lines()[0].split(",")[0] for f in (one, all_of_them)] == [
        "Sigmas to expect of the one run",
        f"Sigmas to expect of {len(plans)} runs together",
    ]
    sigma = [next(e.sigma for e in f.expected if e.name == "k0") for f in (one, all_of_them)]
    # runs alike with drifts of their own: as the root of their number
    assert sigma[1] == pytest.approx(sigma[0] / len(plans) ** 0.5, rel=0.2)
    assert "turn_on_offset" in foresee_effects(plans[:1]).invisible
    assert "turn_on_offset" not in foresee_effects(plans).invisible


def test_of_effects_what_positions_every_45_degrees_leave_open_is_said() -> None:
    every_45 = tuple(45.0 * k for k in range(8))
    plain = foresee_effects(plan_like(0, every_45))
    assert plain.invisible == ("daily_period",)  # of runs that take half a day
    # −2 sin θ cos² θ is sin 2θ · cos θ: the head's harmonic, unless mounted turned
    assert plain.alike == (("third_order", "indexer_harmonic"),)
    assert foresee_effects(plan_like(0, every_45), mount_deg=45.0).alike == ()
