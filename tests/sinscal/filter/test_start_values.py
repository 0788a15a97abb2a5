"""The iteration comes to rest from sensors ten times as bad as expected, whatever their grade."""

import numpy as np
import pytest

from sinscal.filter.alignment import level_nominal
from sinscal.filter.data import RigNoise, cycle_data
from sinscal.filter.iterate import RigFilter
from sinscal.filter.layout import RigLayout
from sinscal.filter.reach import KNOWN_RAD, attitude_sigmas, intervals_within_reach
from sinscal.model.priors import PriorFile, make_prior
from sinscal.model.sensors import sensor_model
from sinscal.twin.motion import rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig
from tests.sinscal.filter.start_study import GRADES, one_start


@pytest.mark.parametrize(("grade", "seed"), [("mems", 0), ("navigation", 0), ("strategic", 2)])
def test_sensors_ten_times_as_bad_as_expected_are_calibrated(grade: str, seed: int) -> None:
    """Each of these diverged when all data were taken in at once: the attitude is 45° off."""
    made = one_start(grade, "coarse", seed, "article")
    assert made.converged
    assert made.agrees, made


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("programme", ["article", "fast"])
@pytest.mark.parametrize("grade", list(GRADES))
def test_fifty_of_fifty_converge(grade: str, programme: str) -> None:
    made = [one_start(grade, "coarse", seed, programme) for seed in range(50)]
    assert all(one.converged and one.agrees for one in made)


def test_the_attitude_is_known_as_far_as_the_scale_of_the_gyros_is() -> None:
    """10 °/s with 1 % of scale alone: 0.15 rad are passed after 86 s, in the 87th interval."""
    sensors = sensor_model(("gyro_scale",))
    run = simulate_rig(
        rig_motion(there_and_back((10.0,), 200.0, "x"), 20.0), sensors, {},
        SensorNoise(gyro=1e-7, accel=1e-3), np.random.default_rng(1),
    )  # fmt: skip
    prior = make_prior(sensors, PriorFile(sigma={"gyro_scale": 0.01}))
    rig = RigFilter(
        facts=run.facts, cycles=cycle_data(run, 1.0), sensors=sensors, prior=prior,
        noise=RigNoise(gyro=1e-7, accel=1e-3),
    )  # fmt: skip
    layout: RigLayout = rig.layout()
    nominal = level_nominal(rig.cycles, sensors, prior.values, run.facts.site)
    steps, cov = rig.steps(nominal, layout), rig.start(nominal, nominal, layout).cov
    sigmas = attitude_sigmas(steps, layout, cov)
    np.testing.assert_allclose(sigmas, 0.01 * np.deg2rad(10.0) * np.arange(201.0), rtol=1e-3)
    lost = int(np.ceil(KNOWN_RAD / (0.01 * np.deg2rad(10.0))))
    assert intervals_within_reach(steps, layout, cov, 0) == lost - 1
    assert intervals_within_reach(steps, layout, cov, 150) == 180  # a part grows by a fifth
    assert intervals_within_reach(steps, layout, 1e-4 * cov, 0) == 200
