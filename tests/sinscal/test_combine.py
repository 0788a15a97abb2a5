"""Combined calibrations are judged by the truth, by their covariance, and by what they replace."""

import numpy as np
import pytest
from scipy.stats import chi2

from sinscal.combine import Combination, combine
from sinscal.combined import at_reference
from tests.sinscal.combine_example import CombinedTwin, make_combined_twin

LONG_S = 900.0  # a cycle, in which the SINS warms by some 10 °C: that of the article
Made = list[tuple[CombinedTwin, Combination]]


def campaign(seeds: range, cycle_s: float) -> Made:
    twins = [make_combined_twin(seed, cycle_s=cycle_s) for seed in seeds]
    return [(t, combine(t.run, t.chambers)) for t in twins]


def rms_errors(made: Made, part: str) -> dict[str, float]:
    """Return the rms errors at the reference temperature without, beforehand and combined."""
    names = [f"{part}_{a}" for a in "xyz"]
    found: dict[str, list[float]] = {"no_thermal": [], "before": [], "combined": []}
    for twin, one in made:
        g, b = twin.chambers[0].gravity_m_s2, one.before
        before_names, before, _ = at_reference(b.names, b.values, b.cov, g)
        combined = dict(zip(one.names, one.values, strict=True))
        beforehand = dict(zip(before_names, before, strict=True))
        truth = twin.at_reference()
        for n in names:
            found["no_thermal"].append(one.plain.value(n) - truth[n])
            found["before"].append(beforehand[n] - truth[n])
            found["combined"].append(combined[n] - truth[n])
    return {k: float(np.sqrt(np.mean(np.square(v)))) for k, v in found.items()}


def assert_consistent(made: Made) -> None:
    total, dof = 0.0, 0
    for twin, one in made:
        c = one.calibration
        e = (c.values - np.array([twin.truth[n] for n in c.names])) / c.sigmas
        total += float(e @ np.linalg.solve(c.cov / np.outer(c.sigmas, c.sigmas), e))
        dof += e.size
    assert 0.001 < chi2.sf(total, dof) < 0.999, f"χ² {total:.1f} with {dof}"
    assert all(one.calibration.converged for _, one in made)


def test_combined_agrees_with_its_covariance_and_beats_no_thermal_model() -> None:
    made = campaign(range(2), 120.0)
    assert_consistent(made)
    assert all(not one.test.contradictions for _, one in made)
    for _, one in made:
        assert one.flight_m["combined"] <= one.flight_m["no_thermal"]
        assert max(one.prior_kept.values()) <= 1.0 + 1e-6  # data never widen: rounding alone
    scale = rms_errors(made, "accel_scale")
    assert scale["combined"] < 0.1 * scale["no_thermal"]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_acceptance_over_fifty_seeds() -> None:
    made = campaign(range(100, 150), LONG_S)
    assert_consistent(made)
    # false alarms of one in a thousand each: more than one in fifty happens once in 800 campaigns
    assert sum(bool(one.test.contradictions) for _, one in made) <= 1
    for part in ("accel_bias", "accel_scale"):
        rms = rms_errors(made, part)
        assert rms["combined"] <= 0.1 * rms["no_thermal"], rms
        assert rms["combined"] <= rms["before"], rms
