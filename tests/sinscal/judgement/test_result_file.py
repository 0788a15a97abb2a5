"""The result file holds everything to apply a calibration, and applying it is exact."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import InputError
from sinscal.frames.earth import Site
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.judgement.result_file import dump_result, make_result, read_result
from sinscal.library import BASIC
from sinscal.model.compensate import compensate_run
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigFacts, RigRun, rate_derivative
from sinscal.twin.motion import rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import self_heating
from tests.sinscal.twin import EXTRA, make_twin

WARM = ("accel_temperature_bias", "accel_temperature_scale", "gyro_temperature_drift")


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    twin = make_twin(1, angle=True)
    judged = calibrate_and_judge(twin.run, Options(mode="precise", hold_out="none"))
    result = make_result(judged, twin.run)
    path = tmp_path / "r.json"
    path.write_text(dump_result(result), encoding="utf-8")
    again = read_result(path)
    assert again == result
    assert again.names == judged.found.names
    p = len(again.sensors.names)
    np.testing.assert_array_equal(again.values, judged.found.values[:p])
    np.testing.assert_array_equal(np.array(again.covariance), judged.found.cov)
    np.testing.assert_allclose(
        [v.sigma for v in again.parameters.values()], judged.found.sigmas, rtol=1e-15
    )


def test_a_result_changed_by_hand_is_refused(tmp_path: Path) -> None:
    twin = make_twin(1)
    result = make_result(calibrate_and_judge(twin.run, Options(hold_out="none")), twin.run)
    path = tmp_path / "r.json"
    text = dump_result(result)
    path.write_text(text.replace('"t_ref_c": 25.0', '"t_ref_c": 24.0'), encoding="utf-8")
    with pytest.raises(InputError, match="result_id"):
        read_result(path)
    path.write_text(text.replace('"mode"', '"mood"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"r\.json: mo"):
        read_result(path)


def test_compensating_undoes_the_errors_exactly() -> None:
    """What `measured` makes of a motion is taken out again, all groups at three prior sigmas.

    1e-12 of forces up to 10 m/s²: their rounding alone is 2e-15, and as much by each term.
    """
    groups = (*BASIC, *EXTRA, *WARM)
    sensors = sensor_model(groups)
    rng = np.random.default_rng(0)
    sigma = np.sqrt(np.diag(make_prior(sensors).cov))
    values = 3.0 * sigma * rng.standard_normal(sigma.size)
    motion = rig_motion(there_and_back((20.0,), 30.0), 50.0).cycles[0].motion
    n = len(motion)
    temp_c = self_heating()(motion.time_s)
    true = replace(motion, dw=rate_derivative(motion.w, motion.step_s), temp_c=temp_c)
    w, f = sensors.measured(true, values)
    flag = np.arange(n) % 100 == 7
    run = RigRun(
        time_s=motion.time_s, step_s=motion.step_s, cycle=np.zeros(n), gyro=w, accel=f,
        temp_c=temp_c, flag=flag, facts=RigFacts(site=Site(lat_rad=1.0)),
    )  # fmt: skip
    done = compensate_run(run, sensors, values)
    np.testing.assert_allclose(done.accel, motion.f, rtol=0, atol=1e-12)
    np.testing.assert_allclose(done.gyro, motion.w, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(done.flag, flag)
    assert np.abs(f - motion.f).max() > 1e-3


def test_temperature_terms_need_temperatures() -> None:
    sensors = sensor_model((*BASIC, *WARM))
    with pytest.raises(InputError, match="temp_c"):
        compensate_run(make_twin(1, cycle_s=30.0).run, sensors, sensors.start_values())
