"""Does the rig filter converge from sensors far worse than expected? Seeds by grade of sensor.

    python -m tests.sinscal.filter.start_study --seeds 50 --out starts.json

Errors are drawn at ten times the default priors (gyro misalignments of 30′, scale errors of 1 %,
0.2 m/s² of accelerometer bias), the priors are told so, and the noise is that of the grade. A MEMS
gyro's bias is 0.1 °/s. A run counts when the iteration converged and χ² of all parameters is one
that a right calibration exceeds in one of 10⁵ runs.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from sinscal.calibration.rig import Mode, calibrate
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.priors import PriorFile, make_prior
from sinscal.model.sensors import sensor_model
from sinscal.twin.motion import RigFaults, rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig

TIMES = 10.0
RARE = 1e-5
# Densities: of gyros, rad/s/√Hz; of accelerometers, m/s²/√Hz; of the rig's angle, rad/√Hz.
GRADES = {
    "mems": SensorNoise(gyro=18.0 * DEG_PER_H, accel=1e-3, angle=15 * ARCSEC),
    "navigation": SensorNoise(gyro=0.1 * DEG_PER_H, accel=1e-3, angle=15 * ARCSEC),
    "strategic": SensorNoise(gyro=1e-3 * DEG_PER_H, accel=1e-5, angle=1 * ARCSEC),
}
MEMS_BIAS = 360.0 * DEG_PER_H
# Rates, °/s; length of a cycle, s; rows a second. Over half a cycle of the article's 1 % of scale
# is 45° of attitude; over one at 30 °/s it is 30°.
PROGRAMMES = {
    "short": ((10.0, -10.0), 200.0, 50.0),
    "article": ((10.0, -10.0), 900.0, 20.0),
    "fast": ((30.0, -30.0), 400.0, 50.0),
}


@dataclass(frozen=True, kw_only=True)
class Start:
    """How one calibration went: `chi2_share` is χ² over its degrees of freedom."""

    grade: str
    mode: str
    programme: str
    seed: int
    converged: bool
    iterations: int
    chi2_share: float
    agrees: bool


def one_start(grade: str, mode: Mode, seed: int, programme: str = "short") -> Start:
    """Simulate sensors of a grade and calibrate them with matching priors."""
    rng = np.random.default_rng((seed, list(GRADES).index(grade)))
    sensors = sensor_model(BASIC)
    known = rig_library().groups
    basic = {TIME_OFFSET: known[TIME_OFFSET].prior_sigma}
    sigma = basic | {group: TIMES * known[group].prior_sigma for group in BASIC}
    if grade == "mems":
        sigma["gyro_bias"] = MEMS_BIAS
    drawn = np.sqrt(np.diag(make_prior(sensors, PriorFile(sigma=sigma)).cov))
    drawn = drawn * rng.standard_normal(drawn.size)
    truth = dict(zip(sensors.names, drawn.tolist(), strict=True))
    mount, offset = np.deg2rad(1.0) * rng.standard_normal(3), 0.05 * rng.standard_normal()
    faults = RigFaults(
        mount_rad=(mount[0], mount[1], mount[2]),
        clock_offset_s=offset,
        azimuth_error_rad=(float(np.deg2rad(1.0) * rng.standard_normal()),),
    )
    rates, cycle_s, hz = PROGRAMMES[programme]
    turned = there_and_back(rates, cycle_s, "xyz", acceleration_deg_s2=10.0, azimuth_deg=35.0)
    run = simulate_rig(
        rig_motion(turned, hz, faults), sensors, truth, GRADES[grade], rng, faults=faults,
        with_angle=mode == "precise",
    )  # fmt: skip
    own = sensor_model((*BASIC, TIME_OFFSET)) if mode == "precise" else sensors
    given = PriorFile(sigma={g: s for g, s in sigma.items() if g in BASIC or mode == "precise"})
    found = calibrate(run, mode, sensors=own, prior=make_prior(own, given))
    truth |= {"rig_time_offset": offset}
    truth |= {f"rig_mount_{a}": float(m) for a, m in zip("xyz", mount, strict=True)}
    error = (found.values - np.array([truth[n] for n in found.names])) / found.sigmas
    correlation = found.cov / np.outer(found.sigmas, found.sigmas)
    cost = float(error @ np.linalg.solve(correlation, error))
    return Start(
        grade=grade,
        mode=mode,
        programme=programme,
        seed=seed,
        converged=found.converged,
        iterations=found.iterations,
        chi2_share=cost / error.size,
        agrees=bool(cost < chi2.isf(RARE, error.size)),
    )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Start values far from the truth, by seeds.")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--only", action="append", choices=list(GRADES))
    parser.add_argument("--mode", choices=("coarse", "precise"), default="coarse")
    parser.add_argument("--programme", choices=list(PROGRAMMES), default="short")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, appended to")
    asked = parser.parse_args(argv)
    for seed in range(asked.first, asked.first + asked.seeds):
        for grade in asked.only or GRADES:
            made = one_start(grade, asked.mode, seed, asked.programme)
            with asked.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(made)) + "\n")


if __name__ == "__main__":
    main()
