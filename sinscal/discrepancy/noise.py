"""The noise of a rig run as its own data show it, whatever is stated beside the run.

The gyros' density is that of their readings across the rotation, where there is no motion. Those of
the accelerometers and of the rig's angle are what the innovations leave beside everything in the
library and every factor: what is missing from the model does not pass for noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.scale import Scales
from errormodel.noise.model import NoiseModel
from sinscal.calibration.noise import Density, gyro_density
from sinscal.discrepancy.source import RigSource
from sinscal.filter.data import RigNoise
from sinscal.recording.run import RigFacts

# What is stated is said to differ beyond so many sigmas, and by more than figures are rounded.
DIFFERS_SIGMAS = 4.0
DIFFERS_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredNoise:
    """A density as measured and as stated (None: it is not).

    Attributes
    ----------
    sensors : {"gyro", "accel", "angle"}
    unit : str
    stated : float, optional
    found : Density
    """

    sensors: str
    unit: str
    stated: float | None
    found: Density

    @property
    def differs(self) -> bool:
        """True where the stated density is not the measured one."""
        if not self.stated:
            return False
        apart = abs(self.found.value - self.stated)
        return apart > max(DIFFERS_SIGMAS * self.found.sigma, DIFFERS_SHARE * self.stated)


def measured_noise(source: RigSource) -> tuple[RigNoise, tuple[MeasuredNoise, ...]]:
    """Measure the noise of a run.

    Parameters
    ----------
    source : RigSource
        Source of the present model, with the noise to begin with.

    Returns
    -------
    noise : RigNoise
        For the filter; the bound of the axis' wobble stays what it was.
    measured : tuple of MeasuredNoise
    """
    before, facts = source.noise, source.run.facts
    problem = source.problem((), NoiseModel())
    scales = Scales(problem)
    accel, *angle = (
        (float(s), float(s / np.sqrt(2.0 * n)))
        for s, n in zip(scales.of(problem.residual[:, None])[:, 0], scales.free, strict=True)
    )
    gyros = gyro_density(source.run)
    found = {"gyro": gyros, "accel": _scaled(before.accel, *accel)}
    noise = replace(before, gyro=gyros.value, accel=found["accel"].value)
    if angle:
        found["angle"] = _scaled(before.angle, *angle[0])
        wobble = before.angle if before.wobble is None else before.wobble
        noise = replace(noise, angle=found["angle"].value, wobble=wobble)
    return noise, tuple(_measured(facts, name, one) for name, one in found.items())


def _scaled(density: float, scale: float, sigma: float) -> Density:
    return Density(value=density * scale, sigma=density * sigma)


def _measured(facts: RigFacts, sensors: str, found: Density) -> MeasuredNoise:
    stated = {"gyro": facts.gyro_noise, "accel": facts.accel_noise, "angle": facts.angle_noise}
    unit = {"gyro": "rad/s/√Hz", "accel": "m/s²/√Hz", "angle": "rad/√Hz"}
    return MeasuredNoise(sensors=sensors, unit=unit[sensors], stated=stated[sensors], found=found)
