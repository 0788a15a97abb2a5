"""A simulated rig run of a SINS that warms itself, and its accelerometers' chamber models."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from errormodel.covariance import expected_covariance
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.library import BASIC
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.chamber import (
    ChamberModel,
    at_reference,
    chamber_names,
    combined_prior,
    combined_sensors,
)
from sinscal.model.motion import Motion
from sinscal.recording.run import RigRun
from sinscal.twin.motion import RigFaults, rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, self_heating, simulate_rig
from thermo.recording.runs import head_force_g
from thermo.twin.accelerometer import emulated_accelerometer

NOISE = SensorNoise(gyro=0.05 * DEG_PER_H, accel=1e-4, angle=15 * ARCSEC)
SIGNS = (1.0, -1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class CombinedTwin:
    run: RigRun
    chambers: tuple[ChamberModel, ...]
    truth: dict[str, float]

    def thermal_errors(self) -> dict[str, float]:
        """Return the largest change of bias (m/s²) and scale error over the run, by axis."""
        run, sensors = self.run, combined_sensors(self.chambers, BASIC)
        rows = np.arange(0, len(run), 500)
        assert run.temp_c is not None
        still = np.zeros((rows.size, 3))
        motion = Motion(
            time_s=np.arange(1.0, rows.size + 1.0), step_s=np.ones(rows.size), w=still, f=still,
            dw=still, temp_c=run.temp_c[rows],
        )  # fmt: skip
        values = np.array([self.truth[n] for n in sensors.names])
        at_rest = sensors.errors(motion, values)[:, 3:]
        loaded = sensors.errors(replace(motion, f=still + 1.0), values)[:, 3:] - at_rest
        out: dict[str, float] = {}
        for name, errors in (("accel_bias", at_rest), ("accel_scale", loaded)):
            change = np.max(np.abs(errors - errors[0]), axis=0)
            out |= {f"{name}_{a}": float(c) for a, c in zip("xyz", change, strict=True)}
        return out

    def at_reference(self) -> dict[str, float]:
        """Return the true values at the reference temperature, in the rig's names."""
        names = tuple(self.truth)
        values = np.array([self.truth[n] for n in names])
        cov, g = np.eye(values.size), self.chambers[0].gravity_m_s2
        out, at, _ = at_reference(names, values, cov, g)
        return dict(zip(out, at.tolist(), strict=True))


def chamber_pair(
    serial: str, rng: np.random.Generator, gravity_m_s2: float
) -> tuple[ChamberModel, ChamberModel]:
    """Return an accelerometer's true model, and one that two ramps in a chamber would give."""
    made = emulated_accelerometer(serial)
    t = np.arange(0.0, 8 * 3600.0, 30.0)
    temp_c = np.interp(t, np.arange(5) * 7200.0, [-40.0, 70.0, -40.0, 70.0, -40.0])
    force = head_force_g(np.array([0.0, 90, 180, 270, 45, 225])[(np.arange(t.size) // 4) % 6])
    signals = {"a_i_g": force[:, 0], "a_p_g": force[:, 1], "a_o_g": force[:, 2]}
    record = Record(time_s=t, signals={**signals, "x_c": temp_c - 25.0})
    names = made.model.names
    noise = NoiseModel(white=5e-6, drift=3e-6)
    cov = expected_covariance(made.model, record, {n: made.values[n] for n in names}, noise)
    true = np.array([made.values[n] for n in names])
    size = np.sqrt(np.diag(cov))
    root = np.linalg.cholesky(cov / np.outer(size, size))
    fitted = true + size * (root @ rng.standard_normal(true.size))

    def model(values: np.ndarray) -> ChamberModel:
        return ChamberModel(
            serial=serial, model=made.model, values=values, cov=cov,
            gravity_m_s2=gravity_m_s2, t_ref_c=25.0, valid_c=(-40.0, 70.0),
        )  # fmt: skip

    return model(true), model(fitted)


def make_combined_twin(
    seed: int,
    *,
    cycle_s: float = 120.0,
    hz: float = 50.0,
    angle: bool = False,
    groups: tuple[str, ...] = (),
    turn_on: Mapping[str, float] | None = None,
) -> CombinedTwin:
    """Draw accelerometers, their chamber fits, and the SINS's own errors from their priors.

    `turn_on` is by what k0 and k1 of the accelerometers differ from what they were in the chamber.
    """
    rng = np.random.default_rng(seed)
    programme = there_and_back(
        (10.0, -10.0), cycle_s, "xyz", acceleration_deg_s2=20.0, azimuth_deg=30.0
    )
    motion = rig_motion(programme, hz)
    pairs = [chamber_pair(f"S{seed}-{a}", rng, motion.site.gravity_m_s2) for a in "xyz"]
    true, fitted = tuple(p[0] for p in pairs), tuple(p[1] for p in pairs)
    own_groups = (*BASIC, *groups, *((TIME_OFFSET,) if angle else ()))
    sensors = combined_sensors(true, own_groups)
    prior = combined_prior(sensors, true)
    own = chamber_names(sensors, true)
    drawn = np.sqrt(np.diag(prior.cov)) * rng.standard_normal(prior.values.size)
    truth = {
        n: float(prior.values[i] if n in own else drawn[i]) for i, n in enumerate(sensors.names)
    }
    for stem, by in (turn_on or {}).items():
        truth |= {
            f"{stem}_{a}": truth[f"{stem}_{a}"] + by * s for a, s in zip("xyz", SIGNS, strict=True)
        }
    offset = truth.get(TIME_OFFSET, 0.0)
    if angle:
        faults = RigFaults(clock_offset_s=offset)
        motion = rig_motion(programme, hz, faults)
        truth |= {f"rig_mount_{a}": 0.0 for a in "xyz"}
    run = simulate_rig(
        motion, sensors, {n: truth[n] for n in sensors.names if n != TIME_OFFSET}, NOISE, rng,
        faults=RigFaults(clock_offset_s=offset), warming=self_heating(), with_angle=angle,
    )  # fmt: skip
    return CombinedTwin(run=run, chambers=fitted, truth=truth)
