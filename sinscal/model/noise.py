"""Noise of the gyros and accelerometers of a SINS: on the rig, in navigation, simulated, in flight.

Each sensor's noise is a `NoiseModel`; a density of white noise is the sigma of a mean over one
second. What a filter, a simulator or a flight adds of its own stands in a subclass.
"""

from dataclasses import dataclass

from errormodel.noise.model import NoiseModel


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialNoise:
    """White noise of three gyros and three accelerometers.

    Attributes
    ----------
    gyro, accel : float
        Densities, rad/s/√Hz and m/s²/√Hz.
    """

    gyro: float
    accel: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftingNoise(InertialNoise):
    """Noise of the sensors and of the rig's angle, with slow drift and counted increments.

    Attributes
    ----------
    angle : float
        Density, rad/√Hz.
    gyro_instability, accel_instability : float
        Sigma of slow drift (first-order Gauss-Markov), rad/s and m/s²; 0: none.
    instability_tau_s : float
        Its correlation time, s.
    gyro_quantum, accel_quantum : float
        Steps of counters of increments, rad and m/s; 0: not counted. Rounding of each reading by
        itself is white and part of the densities.
    """

    angle: float = 0.0
    gyro_instability: float = 0.0
    accel_instability: float = 0.0
    instability_tau_s: float = 3600.0
    gyro_quantum: float = 0.0
    accel_quantum: float = 0.0

    @property
    def of_gyro(self) -> NoiseModel:
        """Noise of one gyro, rad/s."""
        return self._model(self.gyro, self.gyro_instability)

    @property
    def of_accel(self) -> NoiseModel:
        """Noise of one accelerometer, m/s²."""
        return self._model(self.accel, self.accel_instability)

    def _model(self, density: float, instability: float) -> NoiseModel:
        return NoiseModel(white=density, drift=instability, drift_tau_s=self.instability_tau_s)

    @property
    def drifts(self) -> bool:
        """True where there is slow drift."""
        return self.gyro_instability > 0.0 or self.accel_instability > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise(DriftingNoise):
    """Noise as a simulator makes it; none unless given."""

    gyro: float = 0.0
    accel: float = 0.0
