"""How fast a rig calibration is, against its peers on the same job, in one run.

    .venv/bin/python benchmarks/bench_rig.py

The job: 45 minutes (three cycles of 15) at 100 Hz, 51 states. What each does:

- Ours, end to end: north found, data integrated at 100 Hz, filter at 1 Hz (what unknowns do within
  a second is summed at 100 Hz), iterated to convergence.
- python-ins's `run_feedback_filter`: its largest model, 33 states, velocity of the rest at 10 Hz,
  one pass. A slice is timed and scaled up: its cost is the same for every sample.
- A dense numpy filter of 51 states, one pass, nothing integrated and no Φ built: Φ P Φᵀ + Q, and at
  10 Hz a row of three in Joseph form. Once with P moved at every sample, as is usual, and once with
  P moved at 10 Hz only, as one would who is pressed for time and collects Φ between.

Also one covariance analysis of the same programme.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: ratios, not the core count

import statistics
import time
from collections.abc import Callable

import numpy as np
import pandas as pd
from pyins import filters, inertial_sensor, measurements, sim, strapdown

from sinscal.calibration.rig import calibrate
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import DEG_PER_H
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.library import BASIC
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.planning.covariance import rig_covariance
from sinscal.twin.motion import rig_motion
from sinscal.twin.programme import there_and_back
from sinscal.twin.simulate import SensorNoise, simulate_rig

HZ, CYCLE_S = 100.0, 900.0
SAMPLES = round(3 * CYCLE_S * HZ)
GROUPS = ("gyro_g_sensitivity", "lever_arm")
SLICE_S = 20.0
UPDATE_HZ = 10.0  # of the peers
NOISE = SensorNoise(gyro=0.1 * DEG_PER_H, accel=1e-3)


def seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Return the median time of some repeats after one to warm up."""
    work()
    times: list[float] = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def bench_ours() -> tuple[float, float, float, int, int]:
    """Return seconds of a calibration, with its judgement, of an analysis; states and passes."""
    programme = there_and_back((10.0, -10.0, 5.0, -5.0), CYCLE_S, acceleration_deg_s2=10.0)
    sensors = sensor_model((*BASIC, *GROUPS))
    prior = make_prior(sensors)
    rng = np.random.default_rng(1)
    draw = np.sqrt(np.diag(prior.cov)) * rng.standard_normal(len(sensors.names))
    values = dict(zip(sensors.names, draw.tolist(), strict=True))
    run = simulate_rig(rig_motion(programme, HZ), sensors, values, NOISE, rng)
    assert len(run) == SAMPLES
    found = calibrate(run, sensors=sensors)
    states, passes = found.layout.size, found.iterations + 1
    options = Options(groups=GROUPS)
    plain = seconds(lambda: calibrate(run, sensors=sensors))
    judged = seconds(lambda: calibrate_and_judge(run, options), 1)
    noise = RigNoise(gyro=NOISE.gyro, accel=NOISE.accel)
    analysis = seconds(lambda: rig_covariance(programme, sensors, prior, noise, angle=False))
    return plain, judged, analysis, states, passes


def bench_python_ins() -> float:
    """Return seconds python-ins needs for as many samples, from a slice."""
    n = round(SLICE_S * HZ) + 1
    time_s = np.arange(n) / HZ
    attitude = np.column_stack([np.rad2deg(0.17) * time_s, np.full((n, 2), 5.0)])
    still = np.tile([55.75, 37.0, 0.0], (n, 1))
    trajectory, imu = sim.generate_imu(time_s, still, attitude, np.zeros((n, 3)), "increment")
    increments = strapdown.compute_increments_from_imu(imu, "increment")
    velocity = trajectory[["VN", "VE", "VD"]].iloc[:: round(HZ / UPDATE_HZ)]
    model = inertial_sensor.EstimationModel(
        bias_sd=1e-3, noise=1e-4, scale_misal_sd=np.full((3, 3), 1e-3)
    )
    begun = time.perf_counter()
    filters.run_feedback_filter(
        trajectory.iloc[0], 1.0, 0.1, 1.0, 1.0, increments, model, model,
        [measurements.NedVelocity(pd.DataFrame(velocity), 0.01)], time_step=1.0 / UPDATE_HZ,
    )  # fmt: skip
    return (time.perf_counter() - begun) * SAMPLES / len(increments)


def bench_dense(n: int, moved_hz: float) -> float:
    """Return seconds a dense numpy filter of n states needs, from a slice: one pass."""
    rng = np.random.default_rng(0)
    phi = np.eye(n)
    phi[:3] += 1e-5 * rng.standard_normal((3, n))
    p, q = np.eye(n), 1e-6 * np.eye(n)
    h, identity = rng.standard_normal((3, n)), np.eye(n)
    steps = 5000
    every = round(moved_hz / UPDATE_HZ)

    def slice_of() -> None:
        cov = p
        for k in range(steps):
            cov = phi @ cov @ phi.T + q
            if k % every == 0:
                gain = np.linalg.solve(h @ cov @ h.T + np.eye(3), h @ cov).T
                left = identity - gain @ h
                cov = left @ cov @ left.T + gain @ gain.T

    return seconds(slice_of) * SAMPLES * moved_hz / HZ / steps


def main() -> None:
    """Time all and print."""
    plain, judged, analysis, states, passes = bench_ours()
    peers = [
        (f"python-ins, {SLICE_S:g} s timed, scaled up", bench_python_ins()),
        (f"dense Joseph, P moved at {HZ:g} Hz", bench_dense(states, HZ)),
        (f"dense Joseph, P moved at {UPDATE_HZ:g} Hz", bench_dense(states, UPDATE_HZ)),
    ]
    print(f"calibration of 45 min at {HZ:g} Hz ({SAMPLES} samples), {states} states")
    print(f"  {'accelbench, ' + str(passes) + ' passes to convergence':36}{plain:9.2f} s")
    print(f"  {'accelbench, with judgement':36}{judged:9.2f} s")
    for name, took in peers:
        print(f"  {name:36}{took:9.2f} s   it / ours: {took / plain:.1f}")
    print(f"covariance analysis of the programme   {analysis:9.2f} s")


if __name__ == "__main__":
    main()
