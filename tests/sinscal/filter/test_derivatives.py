"""The filter's derivatives are those of what it measures, far below what sigmas compare.

What a run shows worst may be known 10³ to 10⁴ times worse than what it shows best: a derivative
wrong by 1e-3 then makes sigmas too small.
"""

import numpy as np
import pytest

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Steps
from sinscal.calibration.rig import calibrate, noise_of
from sinscal.filter.data import cycle_data
from sinscal.filter.iterate import RigFilter
from sinscal.filter.layout import RigLayout
from sinscal.library import BASIC
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from tests.sinscal.filter.test_exactness import exact_run

# Of a derivative's own size: sums over rows, and of the force the turn during a delay of 1 ms.
RIGHT, BY_DELAY = 1e-4, float(np.deg2rad(10.0)) * 1e-3
SHIFT = 1e-5  # rad, 1, m: twice its square is below RIGHT


def predicted(steps: Steps, layout: RigLayout, shift: FloatArray) -> FloatArray:
    """Return how much less is measured about a nominal shifted by that much, by the derivatives."""
    x, out = shift.copy(), np.zeros_like(steps.z)
    for k in range(len(out)):
        out[k] = steps.h[k] @ x
        x[: layout.moving] = steps.phi[k] @ x
    return out


@pytest.mark.parametrize("more", [(), ("lever_arm", "accel_delay")])
def test_derivatives_are_those_of_what_is_measured(more: tuple[str, ...]) -> None:
    true, run, _ = exact_run(cycle_s=60.0, more=more)
    sensors = sensor_model((*BASIC, *more), gravity_m_s2=true.site.gravity_m_s2)
    found = calibrate(run, sensors=sensors)
    rig = RigFilter(
        facts=run.facts,
        cycles=cycle_data(run, 1.0),
        sensors=sensors,
        prior=make_prior(sensors),
        noise=noise_of(run.facts, "coarse"),
    )
    nominal, layout = found.nominal, found.layout
    steps = rig.steps(nominal, layout)
    wrong: dict[str, float] = {}
    for name in (*sensors.names, "start_1_e", "start_2_n"):
        if name.startswith("gyro_bias"):
            continue  # turns by less than rounding
        shift = np.zeros(layout.size)
        shift[layout.at(name, 1)] = SHIFT
        there, back = (
            rig.steps(nominal.improved(s * shift, layout), layout, steps).z for s in (1.0, -1.0)
        )
        moved, by = 0.5 * (back - there), predicted(steps, layout, shift)
        wrong[name] = float(np.sqrt(np.nanmean((moved - by) ** 2) / np.nanmean(by**2)))
    limit = RIGHT + (BY_DELAY if "accel_delay" in more else 0.0)
    assert {n: w for n, w in wrong.items() if w > limit} == {}
