"""What a plan will give, said before it is run."""

import numpy as np
import pytest

from tests.thermo.examples import TRUTH, runs_of
from thermo.fitting import TermsFile, fit_runs
from thermo.foresight import foresee
from thermo.inputs import channel_of
from thermo.modelfile import reported
from thermo.plan import RunPlan


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
    foresight = foresee(plan_like(0), nominal_scale=1.3, output_unit="mA")
    (one,) = fit_runs(runs_of(0), terms=TermsFile(terms=tuple(TRUTH)))
    found = reported(one.fit, 1.3, "mA")
    assert {e.name for e in foresight.expected} == set(TRUTH)
    for e in foresight.expected:
        # the fit estimates the noise: drift of 3 µg is known to some 30 % from three runs
        assert e.sigma == pytest.approx(found[e.name]["sigma"], rel=0.5)
        assert e.unit == found[e.name]["unit"]


def test_what_four_positions_cannot_show_is_said_by_name() -> None:
    foresight = foresee(plan_like(0, (0.0, 90.0, 180.0, 270.0)))
    assert ("k1", "k3") in foresight.confounded
    assert ("k_io",) in foresight.confounded
    text = "\n".join(foresight.lines())
    assert "k1 ~ k3" in text
    assert "delta_p has no effect in this plan" in text
