"""Simulated rig runs whose errors are drawn from the priors, for tests of the calibration."""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.judgement.judge import Judged
from sinscal.library import BASIC
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigRun
from sinscal.twin.motion import RigFaults, rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig

NOISE = SensorNoise(gyro=0.1 * DEG_PER_H, accel=1e-3, angle=15 * ARCSEC)
EXTRA = ("lever_arm", "gyro_g_sensitivity", "gyro_scale_asymmetry", "accel_second_order")
# The twin's axis is exact: a bound far below the noise of the angle makes sigmas true, not wide.
EXACT_AXIS = 0.3 * ARCSEC
TWO_RATES = (10.0, -10.0)
SIX_RATES = (12.0, -12.0, 6.0, -6.0, 20.0, -20.0)


@dataclass(frozen=True, kw_only=True)
class Twin:
    run: RigRun
    truth: dict[str, float]

    def errors(self, judged: Judged) -> FloatArray:
        """Estimates less truth, in the order of the names."""
        found = judged.found
        return found.values - np.array([self.truth.get(name, 0.0) for name in found.names])

    def chi2(self, judged: Judged) -> float:
        """χ² of all parameters together."""
        found = judged.found
        scale = found.sigmas
        e = self.errors(judged) / scale
        return float(e @ np.linalg.solve(found.cov / np.outer(scale, scale), e))


def make_twin(
    seed: int,
    *,
    rates: tuple[float, ...] = TWO_RATES,
    cycle_s: float = 200.0,
    hz: float = 50.0,
    axes: str = "xyz",
    groups: tuple[str, ...] = (),
    size: float = 1.0,
    angle: bool = False,
    noise: SensorNoise = NOISE,
    remount: float = 0.0,
    mount_deg: float = 1.0,
) -> Twin:
    """Draw errors, mounting, clock offset and azimuth from their priors, `size` times as large."""
    rng = np.random.default_rng(seed)
    sensors = sensor_model((*BASIC, *groups))
    sigma = np.sqrt(np.diag(make_prior(sensors).cov))
    draw = size * sigma * rng.standard_normal(sigma.size)
    values = dict(zip(sensors.names, draw.tolist(), strict=True))
    mount = np.deg2rad(mount_deg) * rng.standard_normal(3)
    offset = 0.05 * rng.standard_normal()
    more = remount * rng.standard_normal((len(axes), 3))
    faults = RigFaults(
        mount_rad=tuple(mount),
        remount_rad=tuple(tuple(m) for m in more),
        clock_offset_s=offset,
        azimuth_error_rad=(np.deg2rad(1.0) * rng.standard_normal(),),
    )
    programme = there_and_back(rates, cycle_s, axes, acceleration_deg_s2=10.0, azimuth_deg=35.0)
    run = simulate_rig(
        rig_motion(programme, hz, faults), sensors, values, noise, rng, faults=faults,
        with_angle=angle,
    )  # fmt: skip
    truth = {**values, "rig_time_offset": offset}
    truth |= {f"rig_mount_{a}": float(m) for a, m in zip("xyz", mount, strict=True)}
    return Twin(run=run, truth=truth)


def shocked(run: RigRun, rows: slice, accel: float) -> RigRun:
    """Return a run with a shock on all accelerometers."""
    force = np.array(run.accel)
    force[rows] += accel
    return replace(run, accel=force)
