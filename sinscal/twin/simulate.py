"""Simulated recording of six sensors and a rig's encoder: the twin of a rig calibration."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import cast

import numpy as np
from scipy.signal import lfilter

from errormodel.arrays import FloatArray
from errormodel.noise.model import NoiseModel
from sinscal.model.motion import Motion
from sinscal.model.noise import SensorNoise
from sinscal.model.sensors import SensorModel, as_vector
from sinscal.recording.run import Quantum, RigFacts, RigRun
from sinscal.twin.motion import CycleMotion, RigFaults, RigMotion

Warming = Callable[[FloatArray], FloatArray]


def self_heating(
    start_c: float = 25.0, rise_c: tuple[float, float, float] = (30.0, 28.0, 33.0),
    tau_s: float = 1500.0,
) -> Warming:  # fmt: skip
    """Return the temperatures (n, 3) of accelerometers in a SINS that warms itself."""

    def warm(time_s: FloatArray) -> FloatArray:
        grown = 1.0 - np.exp(-np.asarray(time_s) / tau_s)
        return start_c + grown[:, None] * np.array(rise_c)

    return warm


def simulate_rig(
    true: RigMotion,
    sensors: SensorModel,
    values: Mapping[str, float],
    noise: SensorNoise,
    rng: np.random.Generator,
    *,
    faults: RigFaults | None = None,
    warming: Warming | None = None,
    with_angle: bool = False,
) -> RigRun:
    """Simulate a recorded rig run.

    Parameters
    ----------
    true : RigMotion
        Made with the same `faults`.
    sensors : SensorModel
    values : mapping of str to float
        The sensors' true errors by name, SI; what is not named is 0.
    noise : SensorNoise
    rng : numpy.random.Generator
    faults : RigFaults, optional
        Clock offset and harmonics of the angle.
    warming : callable, optional
        Temperatures (n, 3) over time, °C.
    with_angle : bool
        Record the rig's angle.

    Returns
    -------
    RigRun
    """
    vector = as_vector(sensors, values)
    faults = faults or RigFaults()
    drifts = {kind: _start(rng) for kind in ("gyro", "accel")}
    gyro: list[FloatArray] = []
    accel: list[FloatArray] = []
    temp: list[FloatArray] = []
    angle: list[FloatArray] = []
    for k, cycle in enumerate(true.cycles):
        motion = cycle.motion
        if warming is not None:
            temp.append(warming(motion.time_s + true.start_s[k]))
            motion = replace(motion, temp_c=temp[-1])
        w, f = sensors.measured(motion, vector)
        w = w + _noise(motion, noise.of_gyro, drifts["gyro"], rng)
        f = f + _noise(motion, noise.of_accel, drifts["accel"], rng)
        gyro.append(_quantised(w, motion.step_s, noise.gyro_quantum))
        accel.append(_quantised(f, motion.step_s, noise.accel_quantum))
        angle.append(_angle(cycle, sensors, vector, noise, faults, rng))
    steps = np.concatenate([c.motion.step_s for c in true.cycles])
    start = true.start_s[true.cycle_numbers]
    return RigRun(
        time_s=np.concatenate([c.motion.time_s for c in true.cycles]) + start,
        step_s=steps,
        cycle=true.cycle_numbers,
        gyro=np.concatenate(gyro),
        accel=np.concatenate(accel),
        temp_c=np.concatenate(temp) if temp else None,
        rig_angle_rad=np.concatenate(angle) if with_angle else None,
        facts=RigFacts(
            site=true.site,
            axis_of_cycle=true.axes,
            azimuth_rad=true.azimuth_rad,
            gyro_noise=noise.gyro or None,
            accel_noise=noise.accel or None,
            angle_noise=(noise.angle or None) if with_angle else None,
            quantum=Quantum(gyro_rad=noise.gyro_quantum, accel_m_s=noise.accel_quantum),
        ),
        source="the simulated run",
    )


def _start(rng: np.random.Generator) -> FloatArray:
    return rng.standard_normal(3)


def _noise(
    motion: Motion, noise: NoiseModel, drift: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return white noise and drift, (n, 3); `drift` (unit sigma) goes on where it stood."""
    n = len(motion)
    out = noise.white / np.sqrt(motion.step_s)[:, None] * rng.standard_normal((n, 3))
    if noise.drift == 0.0:
        return out
    keep, sigma = noise.drift_step(float(motion.step_s[0]))
    kicks = sigma * rng.standard_normal((n, 3))
    start = keep * noise.drift * drift[None, :]
    walk = cast(FloatArray, lfilter([1.0], [1.0, -keep], kicks, axis=0, zi=start)[0])
    drift[:] = walk[-1] / noise.drift
    return out + walk


def _quantised(values: FloatArray, step_s: FloatArray, quantum: float) -> FloatArray:
    """Return means over steps whose sums are whole quanta: what is cut off is carried on."""
    if quantum == 0.0:
        return values
    total = np.cumsum(values * step_s[:, None], axis=0)
    counted = quantum * np.floor(total / quantum)
    return np.diff(counted, axis=0, prepend=0.0) / step_s[:, None]


def _angle(
    cycle: CycleMotion,
    sensors: SensorModel,
    vector: FloatArray,
    noise: SensorNoise,
    faults: RigFaults,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the encoder's readings of one cycle, shape (n,)."""
    motion = cycle.motion
    late, turn, _ = cycle.law.at(motion.time_s + faults.clock_offset_s)
    read = late + sensors.angle_error(late, turn, vector)
    for one in faults.harmonics:
        read = read + one.sine * np.sin(one.order * late) + one.cosine * np.cos(one.order * late)
    return read + noise.angle / np.sqrt(motion.step_s) * rng.standard_normal(late.size)
