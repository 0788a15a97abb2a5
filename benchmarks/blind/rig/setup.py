"""What a SINS has by way of errors, what can be hidden in it, and how the rig is made to move."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from benchmarks.blind.rig.motion import AXES, Rig

DEG_H = np.deg2rad(1) / 3600
ARCMIN = np.deg2rad(1 / 60)
ARCSEC = ARCMIN / 60
G = 9.80665
T_REF_C = 25.0

# Published a priori sigmas of the source article (DESIGN.md, section 2)
PRIOR = {
    "gyro_bias": 0.5 * DEG_H,
    "gyro_scale": 1e-3,
    "gyro_misalignment": 3 * ARCMIN,
    "accel_bias": 0.02,
    "accel_scale": 1e-3,
    "accel_misalignment": 3 * ARCMIN,
}
# A middling size of each hidden effect: what one part of a real instrument would have.
EFFECTS: dict[str, dict[str, float]] = {
    "lever_arm": {"lever_arm_x_x": 0.04, "lever_arm_y_y": -0.05, "lever_arm_z_x": 0.06},
    "accel_delay": {f"accel_delay_{a}": 0.001 for a in AXES},
    "gyro_g_sensitivity": {"gyro_g_sensitivity_xy": 1 * DEG_H / G},
    "rig_time_offset": {"rig_time_offset": 0.02},
    "rig_mount": {"rig_mount_x": 0.004, "rig_mount_y": -0.006, "rig_mount_z": 0.003},
    "rig_angle_harmonic": {"rig_angle_harmonic_sin1": 60 * ARCSEC},
    "gyro_scale_asymmetry": {"gyro_scale_asymmetry_y": 5e-5},
    "accel_second_order": {"accel_second_order_z": 50e-6 / G},
    "accel_temperature_bias": {"accel_temperature_bias_x": 30e-6 * G},
    "accel_temperature_scale": {"accel_temperature_scale_y": 100e-6},
    "gyro_temperature_drift": {"gyro_temperature_drift_z": 0.01 * DEG_H},
    "gyro_bias_step": {"gyro_bias_step_x": 0.3 * DEG_H, "gyro_bias_step_at_s": 1200.0},
    "accel_bias_step": {"accel_bias_step_y": 500e-6 * G, "accel_bias_step_at_s": 1200.0},
}


def article(minutes: float = 15.0, rate: float = 10.0) -> list[tuple[float, float]]:
    """Return the article's cycle: one half each way."""
    return [(rate, 30 * minutes), (-rate, 30 * minutes)]


def multirate(minutes: float = 15.0) -> list[tuple[float, float]]:
    """Return a cycle of four speeds both ways and a rest: shows what is even or quadratic."""
    rates = (0.0, 12.0, -12.0, 6.0, -6.0, 3.0, -3.0, 20.0, -20.0)
    return [(rate, 60 * minutes / len(rates)) for rate in rates]


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """The rig, what it is made to do, how the SINS warms and how it is recorded."""

    rig: Rig = field(default_factory=Rig)
    programme: Sequence[tuple[float, float]] = tuple(article())
    axes: str = "xyz"
    gap_s: float = 120.0
    period_s: float = 0.02
    increments: bool = False
    angles: bool = False
    warm_up_c: float = 0.0  # how far the SINS heats itself
    warm_up_s: float = 900.0
    temp_per_axis: bool = False
    azimuth_error_deg: float = 0.5  # true less stated
    gyro_noise_deg_h: float = 0.1  # at 1 Hz, as the other noises
    accel_noise: float = 0.001
    angle_noise_arcsec: float = 15.0
    gyro_quantum: float = 2e-8  # rad and m/s, of the increments
    accel_quantum: float = 1e-5
    # what the sidecar states over what is true: noise of gyros, accelerometers, angle
    stated: tuple[float, float, float] = (1.0, 1.0, 1.0)
    scale_of_priors: float = 1.0


def draw_baseline(rng: np.random.Generator, size: float = 1.0) -> dict[str, float]:
    """Draw the errors every calibration expects, by the article's a priori sigmas."""
    names = [
        f"{kind}_{a}"
        for kind in ("gyro_bias", "gyro_scale", "accel_bias", "accel_scale")
        for a in AXES
    ]
    names += [f"gyro_misalignment_{a}{b}" for a, b in product(AXES, AXES) if a != b]
    names += [f"accel_misalignment_{ab}" for ab in ("yx", "zx", "zy")]
    return {n: size * PRIOR[n.rpartition("_")[0]] * rng.standard_normal() for n in names}
