"""How fast a rig calibration is, against its peers on the same job, in one run.

    .venv/bin/python benchmarks/bench_rig.py

The job: 45 minutes (three cycles of 15) at 100 Hz, 51 states. The peers are python-ins's
`run_feedback_filter` (its largest model, 33 states, and velocity of the rest; a slice is timed and
scaled up, since its cost is the same for every sample) and a dense filter in numpy that does the
same in the plain way: at every sample Φ P Φᵀ + Q, at every tenth a row of three in Joseph form, one
pass, nothing integrated and no Φ built. Ours is end to end: north found, iterated to convergence.
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

from sinscal.calibrate import calibrate
from sinscal.covariance import rig_covariance
from sinscal.earth import DEG_PER_H
from sinscal.judged import Options, calibrate_and_judge
from sinscal.motion import rig_motion
from sinscal.priors import make_prior
from sinscal.programme import there_and_back
from sinscal.rigdata import RigNoise
from sinscal.sensors import sensor_model
from sinscal.simulate import SensorNoise, simulate_rig
from sinscal.terms import BASIC

HZ, CYCLE_S = 100.0, 900.0
SAMPLES = round(3 * CYCLE_S * HZ)
GROUPS = ("gyro_g_sensitivity", "lever_arm")
SLICE_S = 20.0
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
    velocity = trajectory[["VN", "VE", "VD"]].iloc[:: round(HZ / 10)]
    model = inertial_sensor.EstimationModel(
        bias_sd=1e-3, noise=1e-4, scale_misal_sd=np.full((3, 3), 1e-3)
    )
    begun = time.perf_counter()
    filters.run_feedback_filter(
        trajectory.iloc[0], 1.0, 0.1, 1.0, 1.0, increments, model, model,
        [measurements.NedVelocity(pd.DataFrame(velocity), 0.01)], time_step=0.1,
    )  # fmt: skip
    return (time.perf_counter() - begun) * SAMPLES / len(increments)


def bench_dense(n: int) -> float:
    """Return seconds a dense numpy filter of n states needs, from a slice: one pass."""
    rng = np.random.default_rng(0)
    phi = np.eye(n)
    phi[:3] += 1e-5 * rng.standard_normal((3, n))
    p, q = np.eye(n), 1e-6 * np.eye(n)
    h, identity = rng.standard_normal((3, n)), np.eye(n)
    steps = 5000

    def slice_of() -> None:
        cov = p
        for k in range(steps):
            cov = phi @ cov @ phi.T + q
            if k % 10 == 0:
                gain = np.linalg.solve(h @ cov @ h.T + np.eye(3), h @ cov).T
                left = identity - gain @ h
                cov = left @ cov @ left.T + gain @ gain.T

    return seconds(slice_of) * SAMPLES / steps


def main() -> None:
    """Time all and print."""
    plain, judged, analysis, states, passes = bench_ours()
    peer, dense = bench_python_ins(), bench_dense(states)
    print(f"calibration of 45 min at {HZ:g} Hz ({SAMPLES} samples), {states} states")
    print(f"  accelbench, to convergence           {plain:9.2f} s")
    print(f"  accelbench, with judgement           {judged:9.2f} s")
    print(
        f"  python-ins, {SLICE_S:g} s timed, scaled up    {peer:9.2f} s"
        f"   it / ours: {peer / plain:.0f}"
    )
    print(f"  dense numpy Joseph filter, one pass  {dense:9.2f} s   it / ours: {dense / plain:.1f}")
    print(
        f"  the same, the {passes} passes of ours     {passes * dense:9.2f} s"
        f"   it / ours: {passes * dense / plain:.1f}"
    )
    print(f"covariance analysis of the programme   {analysis:9.2f} s")


if __name__ == "__main__":
    main()
