"""Are sound positions with dwells passed, with true sigmas? Seeds by noise of the accelerometers.

    python -m tests.sinscal.recording.dwell_study --seeds 30 --out dwells.json

Nineteen positions, a quarter turn apart about one axis of the body after another in one unbroken
recording, as on a rig of two axes. Lever arms of 1 to 6 cm are in the data and in the model. A run
counts when it is neither refused nor warned of.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.frames.attitude import rotation
from sinscal.frames.earth import DEG_PER_H, Site
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.library import BASIC
from sinscal.model.motion import Motion
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.check import checked_rig
from sinscal.recording.run import RigFacts, RigRun
from sinscal.twin.motion import platform_at_zero
from sinscal.twin.programme import Cycle, Segment, angle_law

NOISES = (1e-3, 1e-4, 1e-5)  # m/s²/√Hz
GYRO_NOISE = 0.1 * DEG_PER_H
ARMS_M = (0.01, 0.06)
# Eighteen quarter turns, about body axes; a minus reverses.
TURNS = {
    # the turned axis is level every time
    "level": (*["+y"] * 3, *["+z"] * 3, *["+x"] * 3, *["-x"] * 3, *["-z"] * 3, *["-y"] * 3),
    # z is turned about the vertical, which gravity does not see: its scale is known a thousand
    # times worse, by gyrocompassing
    "vertical": (*["+y"] * 3, *["-y"] * 3, "+z", *["+x"] * 3, *["-x"] * 3, *["+z"] * 3,
                 *["-z"] * 2),
}  # fmt: skip
RATE_DEG_S, ACCELERATION_DEG_S2, DWELL_S, HZ = 10.0, 20.0, 60.0, 50.0
GROUPS = (*BASIC, "lever_arm")


def positions(plan: str = "level") -> tuple[Site, Motion]:
    """Return the true motion, means over steps by Gauss's rule of three points."""
    site = Site(lat_rad=float(np.deg2rad(55.75)), height_m=150.0)
    start = platform_at_zero(0, float(np.deg2rad(35.0)), 0.0)
    ramp_s = RATE_DEG_S / ACCELERATION_DEG_S2
    w, f, dw = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for turn in TURNS[plan]:
        axis, sign = "xyz".index(turn[1]), 1.0 if turn[0] == "+" else -1.0
        rate = sign * RATE_DEG_S
        parts = (
            Segment(rate_deg_s=0.0, duration_s=DWELL_S),
            Segment(rate_deg_s=rate, duration_s=90.0 / RATE_DEG_S),
            Segment(rate_deg_s=0.0, duration_s=ramp_s + 0.5),
        )
        law = angle_law(Cycle(axis=turn[1], segments=parts), ACCELERATION_DEG_S2)  # type: ignore[arg-type]
        edges = np.arange(round(law.duration_s * HZ) + 1) / HZ
        angle, speed, _ = law.at(edges)
        unit = np.eye(3)[axis]
        earth, force = np.zeros((edges.size - 1, 3)), np.zeros((edges.size - 1, 3))
        for point, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
            at = law.at(edges[:-1] + 0.5 * (1.0 + point) / HZ)[0]
            c_nb = start @ rotation(at[:, None] * unit)
            earth += 0.5 * weight * (site.earth_rate @ c_nb)
            force += 0.5 * weight * site.gravity_m_s2 * c_nb[:, 2, :]
        w.append(np.diff(angle)[:, None] * HZ * unit + earth)
        f.append(force)
        dw.append(np.diff(speed)[:, None] * HZ * unit)
        start = start @ rotation(angle[-1] * unit)
    rows = sum(len(part) for part in w)
    return site, Motion(
        time_s=np.arange(1, rows + 1) / HZ, step_s=np.full(rows, 1.0 / HZ),
        w=np.concatenate(w), f=np.concatenate(f), dw=np.concatenate(dw),
    )  # fmt: skip


def recorded(seed: int, accel_noise: float, plan: str = "level") -> tuple[RigRun, dict[str, float]]:
    """Return a sound run and the truth; errors are drawn from the default priors."""
    rng = np.random.default_rng((seed, round(-np.log10(accel_noise))))
    site, motion = positions(plan)
    sensors = sensor_model(GROUPS, gravity_m_s2=site.gravity_m_s2)
    drawn = np.sqrt(np.diag(make_prior(sensors).cov)) * rng.standard_normal(len(sensors.names))
    arms = rng.uniform(*ARMS_M, 9) * rng.choice((-1.0, 1.0), 9)
    drawn[[n.startswith("lever_arm") for n in sensors.names]] = arms
    w, f = sensors.measured(motion, drawn)
    run = RigRun(
        time_s=motion.time_s,
        step_s=motion.step_s,
        cycle=np.zeros(len(motion), dtype=np.intp),
        gyro=w + GYRO_NOISE * np.sqrt(HZ) * rng.standard_normal(w.shape),
        accel=f + accel_noise * np.sqrt(HZ) * rng.standard_normal(f.shape),
        facts=RigFacts(site=site, gyro_noise=GYRO_NOISE, accel_noise=accel_noise),
        source="nineteen positions",
    )
    return run, dict(zip(sensors.names, drawn.tolist(), strict=True))


@dataclass(frozen=True, kw_only=True)
class Dwelt:
    """What one calibration said: `chi2_share` is χ² of all parameters over their number."""

    plan: str
    noise: float
    seed: int
    passed: bool
    failed: tuple[str, ...]
    warnings: tuple[str, ...]
    chi2_share: float


def one_run(seed: int, accel_noise: float, plan: str = "level") -> Dwelt:
    """Check and calibrate one sound run."""
    run, truth = recorded(seed, accel_noise, plan)
    judged = calibrate_and_judge(checked_rig(run), Options(groups=("lever_arm",), hold_out="none"))
    found = judged.found
    error = (found.values - np.array([truth[n] for n in found.names])) / found.sigmas
    correlation = found.cov / np.outer(found.sigmas, found.sigmas)
    return Dwelt(
        plan=plan,
        noise=accel_noise,
        seed=seed,
        passed=judged.passed,
        failed=tuple(n for n, ok in judged.consistency.tests.items() if ok is False),
        warnings=judged.warnings,
        chi2_share=float(error @ np.linalg.solve(correlation, error)) / error.size,
    )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Sound positions with dwells, by seeds.")
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--noise", type=float, action="append", choices=NOISES)
    parser.add_argument("--plan", choices=list(TURNS), default="level")
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, appended to")
    asked = parser.parse_args(argv)
    for seed in range(asked.first, asked.first + asked.seeds):
        for noise in asked.noise or NOISES:
            made = one_run(seed, noise, asked.plan)
            with asked.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(made)) + "\n")


if __name__ == "__main__":
    main()
