"""A rig run by python-ins, an inertial simulator of others: its errors are found again.

Its attitudes are roll, pitch and heading of body axes forward-right-down in north-east-down; a
triad is a triad, so the same readings stand for our body axes, and the azimuth of the rotation axis
is the same in both. It has the earth of WGS 84 and gravity of its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from pyins import sim
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from sinscal.calibration.rig import RigCalibration
from sinscal.discrepancy.find import find_rig_discrepancy
from sinscal.frames.earth import DEG_PER_H, Site
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigFacts, RigRun

LAT_DEG, HZ, CYCLE_S = 55.75, 50.0, 300.0
GYRO_NOISE, ACCEL_NOISE = 0.1 * DEG_PER_H, 1e-3


def angle_of(time_s: np.ndarray) -> np.ndarray:
    """Smoothly to +10 °/s, to −10 °/s in the middle: its spline is then exact to 1e-9 rad."""
    rate = np.deg2rad(10.0) * np.tanh((CYCLE_S / 2 - time_s) / 3.0) * np.tanh(time_s / 3.0)
    step = 1.0 / HZ
    # from 0.3 rad: three angles do not tell the attitude where the body's x is upright
    return 0.3 + np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])


def cycle_of(axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return increments of angle and velocity of ideal sensors turned about a body axis."""
    time_s = np.arange(round(CYCLE_S * HZ) + 1) / HZ
    azimuth = np.deg2rad(35.0)
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])  # north-east-down
    level = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    zero = np.empty((3, 3))
    zero[:, axis], zero[:, (axis + 1) % 3] = along, level
    zero[:, (axis + 2) % 3] = np.cross(along, level)
    turned = Rotation.from_matrix(zero) * Rotation.from_rotvec(
        angle_of(time_s)[:, None] * np.eye(3)[axis]
    )
    heading_pitch_roll = turned.as_euler("ZYX", degrees=True)
    still = np.tile([LAT_DEG, 37.0, 0.0], (time_s.size, 1))
    _, imu = sim.generate_imu(
        time_s, still, heading_pitch_roll[:, ::-1], np.zeros((time_s.size, 3)), "increment"
    )
    readings = imu.to_numpy()[1:]
    return readings[:, :3], readings[:, 3:]


Force = Callable[[np.ndarray, np.ndarray], np.ndarray]


def recorded(
    rng: np.random.Generator, truth: Mapping[str, float], more: Force | None = None
) -> RigRun:
    """Return a run of three cycles by sensors with errors; `more` adds a force of rates, forces."""
    theta, gamma = np.eye(3), np.eye(3)
    for i, a in enumerate("xyz"):
        theta[i, i] += truth[f"gyro_scale_{a}"]
        gamma[i, i] += truth[f"accel_scale_{a}"]
        for j, b in enumerate("xyz"):
            theta[i, j] += truth.get(f"gyro_misalignment_{a}{b}", 0.0)
            gamma[i, j] += truth.get(f"accel_misalignment_{a}{b}", 0.0)
    drift = np.array([truth[f"gyro_bias_{a}"] for a in "xyz"])
    bias = np.array([truth[f"accel_bias_{a}"] for a in "xyz"])
    gyro, accel = [], []
    for axis in range(3):
        dtheta, dv = cycle_of(axis)
        w, f = HZ * dtheta, HZ * dv
        extra = np.zeros_like(f) if more is None else more(w, f)
        w, f = w @ theta.T + drift, f @ gamma.T + bias + extra
        gyro.append(w + GYRO_NOISE * np.sqrt(HZ) * rng.standard_normal(w.shape))
        accel.append(f + ACCEL_NOISE * np.sqrt(HZ) * rng.standard_normal(f.shape))
    n = len(gyro[0])
    return RigRun(
        time_s=np.tile(np.arange(1, n + 1) / HZ, 3),
        step_s=np.full(3 * n, 1.0 / HZ),
        cycle=np.repeat(np.arange(3), n),
        gyro=np.concatenate(gyro),
        accel=np.concatenate(accel),
        facts=RigFacts(
            site=Site(lat_rad=np.deg2rad(LAT_DEG)),
            axis_of_cycle=("x", "y", "z"),
            gyro_noise=GYRO_NOISE,
            accel_noise=ACCEL_NOISE,
        ),
    )


def drawn(rng: np.random.Generator) -> dict[str, float]:
    """Return errors as every calibration expects them."""
    sensors = sensor_model()
    sigma = np.sqrt(np.diag(make_prior(sensors).cov))
    return dict(zip(sensors.names, sigma * rng.standard_normal(sigma.size), strict=True))


def test_coarse_calibration_finds_the_errors_put_into_python_ins() -> None:
    rng = np.random.default_rng(7)
    truth = drawn(rng)
    judged = calibrate_and_judge(recorded(rng, truth), Options())
    found = judged.found
    assert isinstance(found, RigCalibration)
    errors = (found.values - np.array([truth[k] for k in found.names])) / found.sigmas
    correlation = found.cov / np.outer(found.sigmas, found.sigmas)
    assert errors @ np.linalg.solve(correlation, errors) < chi2.isf(0.001, errors.size)
    apart = (found.north_azimuth_rad - np.deg2rad(35.0)) / found.north_sigma_rad
    assert np.abs(apart).max() < 4.0
    assert judged.passed, judged.warnings


ARMS = np.array([[0.05, -0.2, 0.1], [0.1, 0.1, 0.0], [0.0, 0.15, -0.1]])  # rows: masses, m
BENT = 2e-5  # of x, s²/m: 200 µg/g²


def arms_and_bent(w: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return what masses off the centre feel, and a second order of x."""
    turned = np.gradient(w, 1.0 / HZ, axis=0)
    felt = [np.cross(turned, r) + np.cross(w, np.cross(w, r)) for r in ARMS]
    out = np.column_stack([one[:, k] for k, one in enumerate(felt)])
    out[:, 0] += BENT * f[:, 0] ** 2
    return out


def test_two_effects_hidden_in_python_ins_are_named_and_sized() -> None:
    rng = np.random.default_rng(8)
    run = recorded(rng, drawn(rng), arms_and_bent)
    # stated too small, the noise would make effects; it is measured
    run = replace(run, facts=replace(run.facts, accel_noise=0.7 * ACCEL_NOISE))
    found = find_rig_discrepancy(run, draws=200)
    assert found.verdict == "named"
    assert {e.effect.name for e in found.effects} == {"lever_arm", "accel_second_order"}
    parameters = {n: p for e in found.effects for n, p in e.parameters.items()}
    true = {
        f"lever_arm_{a}_{b}": ARMS[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")
    }
    true |= {f"accel_second_order_{a}": BENT * (a == "x") for a in "xyz"}
    for name, value in true.items():
        # of twelve values one in 1300 runs lies beyond four sigma
        assert abs(parameters[name].value - value) < 4.0 * parameters[name].sigma, name
    stated = {n.sensors: n.differs for n in found.noise}
    assert stated == {"gyro": False, "accel": True}
    # a cycle held out: the choice of the others is the same, each time
    assert all(set(g.names) == {"lever_arm", "accel_second_order"} for g in found.held_out_parts)


def test_python_ins_alone_hides_nothing() -> None:
    rng = np.random.default_rng(9)
    assert find_rig_discrepancy(recorded(rng, drawn(rng)), draws=200).verdict == "nothing"
