"""A rig run's file: the programme, and whatever else of the run is stated beside it.

`[noise]`, `[faults]`, `[temperature]`, `[errors]` and `[recording]` may each be left out; the
covariance analysis takes the noise and the temperature, the simulator all of them.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from errormodel.io.toml import read_toml
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.twin.motion import Harmonic, RigFaults, Wobble
from sinscal.twin.programme import Finite, Positive, Programme
from sinscal.twin.simulate import SensorNoise, Warming, self_heating

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
SmallDeg = Annotated[float, Field(ge=-10, le=10)]
Vector = tuple[SmallDeg, SmallDeg, SmallDeg]
Metres = Annotated[float, Field(ge=-10, le=10)]
Order = Annotated[int, Field(ge=1, le=1000)]
Arcsec = Annotated[float, Field(ge=-36000, le=36000)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class NoiseTable(_Table):
    """Noise of sensors and encoder; the densities not given are the article's."""

    gyro_deg_h_rthz: Positive = 0.1
    accel_m_s2_rthz: Positive = 0.001
    angle_arcsec_rthz: Positive = 15.0
    wobble_arcsec_rthz: Positive | None = None
    gyro_instability_deg_h: NotNegative = 0.0
    accel_instability_m_s2: NotNegative = 0.0
    instability_tau_s: Positive = 3600.0
    gyro_quantum_arcsec: NotNegative = 0.0
    accel_quantum_m_s: NotNegative = 0.0

    @property
    def simulated(self) -> SensorNoise:
        """Return it in the form of the simulator."""
        return SensorNoise(
            gyro=self.gyro_deg_h_rthz * DEG_PER_H,
            accel=self.accel_m_s2_rthz,
            angle=self.angle_arcsec_rthz * ARCSEC,
            gyro_instability=self.gyro_instability_deg_h * DEG_PER_H,
            accel_instability=self.accel_instability_m_s2,
            instability_tau_s=self.instability_tau_s,
            gyro_quantum=self.gyro_quantum_arcsec * ARCSEC,
            accel_quantum=self.accel_quantum_m_s,
        )

    @property
    def filtered(self) -> RigNoise:
        """Return it in the form of the filter, without quantisation, which is not white."""
        made, wobble = self.simulated, self.wobble_arcsec_rthz
        return RigNoise(
            gyro=made.gyro,
            accel=made.accel,
            angle=made.angle,
            wobble=None if wobble is None else wobble * ARCSEC,
            gyro_instability=made.gyro_instability,
            accel_instability=made.accel_instability,
            instability_tau_s=made.instability_tau_s,
        )


class HarmonicTable(_Table):
    """An error of the encoder with so many periods in a turn."""

    order: Order
    sin_arcsec: Arcsec = 0.0
    cos_arcsec: Arcsec = 0.0


class WobbleTable(_Table):
    """The rotation axis runs round a cone, so many times in a turn of the platform."""

    order: Order
    arcsec: Arcsec
    phase_deg: Finite = 0.0


class FaultTable(_Table):
    """Faults of the rig; a list by cycle holds its last entry for the rest."""

    axis_tilt_deg: Annotated[tuple[SmallDeg, ...], Field(min_length=1)] = (0.0,)
    azimuth_error_deg: Annotated[tuple[SmallDeg, ...], Field(min_length=1)] = (0.0,)
    mount_deg: Vector = (0.0, 0.0, 0.0)
    remount_deg: Annotated[tuple[Vector, ...], Field(min_length=1)] = ((0.0, 0.0, 0.0),)
    eccentric_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
    clock_offset_s: Annotated[float, Field(ge=-10, le=10)] = 0.0
    harmonics: tuple[HarmonicTable, ...] = ()
    wobble: tuple[WobbleTable, ...] = ()

    @property
    def faults(self) -> RigFaults:
        """In SI units."""

        def rad(values: Vector) -> tuple[float, float, float]:
            x, y, z = np.deg2rad(values).tolist()
            return x, y, z

        return RigFaults(
            axis_tilt_rad=tuple(np.deg2rad(self.axis_tilt_deg).tolist()),
            azimuth_error_rad=tuple(np.deg2rad(self.azimuth_error_deg).tolist()),
            mount_rad=rad(self.mount_deg),
            remount_rad=tuple(rad(one) for one in self.remount_deg),
            eccentric_m=self.eccentric_m,
            clock_offset_s=self.clock_offset_s,
            harmonics=tuple(
                Harmonic(order=h.order, sine=h.sin_arcsec * ARCSEC, cosine=h.cos_arcsec * ARCSEC)
                for h in self.harmonics
            ),
            wobble=tuple(
                Wobble(
                    order=w.order,
                    size=w.arcsec * ARCSEC,
                    phase=float(np.deg2rad(w.phase_deg)),
                )
                for w in self.wobble
            ),
        )


class TemperatureTable(_Table):
    """The SINS warms itself: T = start + rise·(1 − exp(−t/τ)), through all cycles."""

    start_c: Annotated[float, Field(ge=-100, le=200)] = 25.0
    rise_c: tuple[Finite, Finite, Finite] = (30.0, 28.0, 33.0)
    tau_s: Positive = 1500.0

    @property
    def warming(self) -> Warming:
        """Return it in the form of the simulator."""
        return self_heating(self.start_c, self.rise_c, self.tau_s)


class RecordingTable(_Table):
    """Settings of the recording."""

    rate_hz: Annotated[float, Field(ge=1, le=1000)] = 100.0
    increments: bool = False
    angle: bool = False


class RigFile(Programme):
    """A rig programme with what else is stated of the run.

    With `azimuth_sigma_deg` the azimuth of the rotation axis is known to the filter, that well;
    without, it is not.
    """

    azimuth_sigma_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    recording: RecordingTable = RecordingTable()
    noise: NoiseTable = NoiseTable()
    faults: FaultTable = FaultTable()
    temperature: TemperatureTable | None = None
    errors: dict[str, Finite] = Field(default_factory=dict)

    @property
    def warming(self) -> Warming | None:
        """Temperatures over time; None when none are stated."""
        return None if self.temperature is None else self.temperature.warming

    @property
    def azimuth_sigma_rad(self) -> float | None:
        """Sigma of the azimuth."""
        known = self.azimuth_sigma_deg
        return None if known is None else float(np.deg2rad(known))


def read_rig_file(path: Path | str) -> RigFile:
    """Read a rig run's file.

    Raises
    ------
    InputError
        If it cannot be read or a key is not what it should be.
    """
    return read_toml(path, RigFile)
