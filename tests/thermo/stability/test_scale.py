"""Every µg of stability is over the K1 of the runs themselves, as in `fit`."""

import numpy as np
import pandas as pd
import pytest

from tests.thermo.stability.examples import NOMINAL, SIX, one_run
from thermo.fitting.fit import fit_runs
from thermo.recording.files import RecordedRuns, make_runs
from thermo.stability.judge import AccelerometerStability, Stability, judge_stability


def batch(nominal: float) -> RecordedRuns:
    """Three accelerometers that move together in one run, with holds for the Allan deviation."""
    rng = np.random.default_rng(31)
    frames: list[pd.DataFrame] = []
    for serial in "ABC":
        for k in range(4):
            own = {"k0": 10.0 * rng.standard_normal() + 60.0 * (k == 2)}
            span = (25.0, 25.0, -40.0, 70.0, 25.0)
            frames.append(one_run(rng, serial, f"r{k}", own, n=120, span_c=span))
            frames[-1].loc[:40, "temp_c"] = 25.0
    return make_runs(
        pd.concat(frames), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=nominal,
        run_start_utc={},
    )  # fmt: skip


def figures(result: Stability) -> list[float]:
    """All that is told in µg."""
    found: list[float] = []
    for one in result.accelerometers:
        assert one.shape is not None
        assert one.k0_distance is not None
        k0 = one.coefficient("k0")
        assert k0 is not None
        found += [one.shape.spread_ug, one.shape.bend_ug, one.k0_distance.rms]
        found += [*k0.values, *k0.sigmas, 1e6 * one.runs.noise.white, 1e6 * one.runs.noise.drift]
        found.append(float(np.std(one.runs.residual_ug)))
    assert result.components is not None
    return found + [c.sigma for c in result.components.components]


def test_a_nominal_scale_that_is_wrong_changes_no_figure_in_ug() -> None:
    right = judge_stability(batch(NOMINAL), terms=SIX)
    wrong = judge_stability(batch(NOMINAL / 1.6), terms=SIX)
    assert right.events
    # the same numbers but for the rounding of an iteration and a draw of the curves' errors
    np.testing.assert_allclose(figures(wrong), figures(right), rtol=1e-4, atol=1e-3)
    first: AccelerometerStability = wrong.accelerometers[0]
    assert first.runs.joint.own_scale == pytest.approx(NOMINAL, rel=1e-3)  # K1 is 200 ppm off
    assert first.runs.scale_fitted


def test_noise_is_as_fit_tells_it_and_without_k1_the_scale_is_said_to_be_nominal() -> None:
    runs = batch(NOMINAL / 1.6)
    (one, *_) = judge_stability(runs, terms=SIX).accelerometers
    fitted = fit_runs(runs, terms=SIX)[0]
    # white noise of 480 readings is known to 3 %
    assert one.runs.noise.white == pytest.approx(fitted.noise.white, rel=0.1)
    still = [one_run(np.random.default_rng(k), "A", f"r{k}", n=60) for k in range(2)]
    frame = pd.concat(still).drop(columns="position_deg")
    noise = np.random.default_rng(3).standard_normal(len(frame))
    frame["output"] = NOMINAL * (1.0 + 1e-6 * noise)
    blind = make_runs(
        frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL, run_start_utc={}
    )
    (unscaled,) = judge_stability(blind).accelerometers
    assert not unscaled.runs.scale_fitted
    assert any("use the nominal scale factor" in note for note in unscaled.notes)
