"""The noise of a rig run, estimated from its data instead of the stated values.

The gyro density is computed from the readings across the rotation axis, where there is no motion.
The densities of the accelerometers and of the rig angle are computed from the innovations after
projecting out everything in the library and every factor, so a missing effect is not taken for
noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.scale import Scales
from errormodel.noise.model import NoiseModel
from sinscal.calibration.noise import Density, gyro_density
from sinscal.discrepancy.source import RigSource
from sinscal.filter.data import RigNoise
from sinscal.recording.run import RigFacts

# The stated value is reported as different beyond this many sigmas and beyond rounding.
DIFFERS_SIGMAS = 4.0
DIFFERS_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredNoise:
    """A measured density and its stated value (None if not stated).

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
        """True if the stated density differs from the measured one."""
        if not self.stated:
            return False
        apart = abs(self.found.value - self.stated)
        return apart > max(DIFFERS_SIGMAS * self.found.sigma, DIFFERS_SHARE * self.stated)


def measured_noise(source: RigSource) -> tuple[RigNoise, tuple[MeasuredNoise, ...]]:
    """Measure the noise of a run.

    Parameters
    ----------
    source : RigSource
        Source of the present model, with the initial noise.

    Returns
    -------
    noise : RigNoise
        Noise for the filter; the bound of the wobble of the axis is unchanged.
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
