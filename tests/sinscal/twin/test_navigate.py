"""Navigation outputs on a rig, from its raw sensors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sinscal.frames.attitude import rotvec_of
from sinscal.frames.earth import A_M, DEG_PER_H
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import NavRun, RigRun
from sinscal.twin.motion import rig_motion
from sinscal.twin.navigate import navigate_rig
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig

TRUE = rig_motion(there_and_back((5.0, -5.0), 240.0, acceleration_deg_s2=10.0), 100.0)
STARTS = [cycle.c_start for cycle in TRUE.cycles]


def rig_run(values: dict[str, float]) -> RigRun:
    noise, rng = SensorNoise(), np.random.default_rng(0)
    return simulate_rig(TRUE, sensor_model(), values, noise, rng)


def position_error_m(nav: NavRun) -> np.ndarray:
    site = nav.facts.site
    east = nav.lon_rad * np.cos(site.lat_rad)
    return A_M * np.hypot(nav.lat_rad - site.lat_rad, east)


def test_perfect_sensors_keep_the_place_and_the_attitude() -> None:
    nav = navigate_rig(rig_run({}), STARTS, output_step_s=1.0)
    assert len(nav) == 3 * 241
    # the reversal bends the rate within a step: half of 10 °/s² · (10 ms)² at worst, each time
    assert position_error_m(nav).max() < 0.05
    for k, rows in enumerate(nav.cycles):
        ends = TRUE.cycles[k].c_nb[-1]
        assert np.abs(rotvec_of(nav.c_nb[rows][-1] @ ends.T)).max() < 1e-6


def test_each_cycle_starts_anew_at_the_true_place() -> None:
    nav = navigate_rig(rig_run({"accel_bias_x": 0.01}), STARTS, output_step_s=0.5)
    starts = [rows.start for rows in nav.cycles]
    assert_allclose(position_error_m(nav)[starts], 0.0, atol=1e-6)
    assert_allclose(nav.velocity[starts], 0.0)
    assert np.array_equal(nav.cycle[starts], [0, 1, 2])
    assert position_error_m(nav).max() > 10.0
    for rows in nav.cycles:
        assert_allclose(np.diff(nav.time_s[rows]), 0.5, rtol=1e-6)


def test_errors_are_the_sensors_and_grow_in_proportion() -> None:
    drift = {"gyro_bias_x": 0.5 * DEG_PER_H, "accel_scale_y": 5e-4}
    once = position_error_m(navigate_rig(rig_run(drift), STARTS, output_step_s=1.0))
    twice = position_error_m(
        navigate_rig(rig_run({k: 2 * v for k, v in drift.items()}), STARTS, output_step_s=1.0)
    )
    assert_allclose(twice, 2 * once, atol=0.01 * twice.max())


def test_what_does_not_fit_is_refused() -> None:
    run = rig_run({})
    with pytest.raises(ValueError, match="attitudes"):
        navigate_rig(run, STARTS[:2], output_step_s=1.0)
    with pytest.raises(ValueError, match="whole number"):
        navigate_rig(run, STARTS, output_step_s=0.015)
