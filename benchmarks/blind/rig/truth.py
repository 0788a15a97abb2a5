"""Recorded rig runs with known errors, from a simulator that shares no code with the package.

    python benchmarks/blind/rig/truth.py OUT.csv --seed 1 --effect lever_arm --angles

writes OUT.csv, OUT.toml beside it and, away from both, the answer key. Errors by the contract's
conventions: ω′ = (I + Θ)ω + ν⁰ + …, f′ = (I + Γ)f + Δf⁰ + …, Γ lower triangular; x = T − 25 °C.
All parameters are one flat table, NAME: value, in SI units.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.blind.rig.motion import AXES, STEP_S, Floats, Motion, Rig, move
from benchmarks.blind.rig.setup import (
    ARCSEC,
    DEG_H,
    EFFECTS,
    T_REF_C,
    Setup,
    article,
    draw_baseline,
    multirate,
)

MOTION_ARRAYS = ("omega_ib", "omega_eb", "alpha_eb", "gravity_b")
# What no table of parameters holds: adds to rates and forces, each (n, 3), of a motion at times t
# with the sensors' temperatures x from the reference.
Stranger = Callable[[Motion, Floats, Floats], tuple[Floats, Floats]]


class Truth:
    """A flat table of parameters, looked up as vectors and matrices; what is absent is zero."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values = dict(values)

    def one(self, name: str) -> float:
        return self.values.get(name, 0.0)

    def vec(self, name: str) -> Floats:
        return np.array([self.one(f"{name}_{a}") for a in AXES])

    def mat(self, name: str, between: str = "") -> Floats:
        return np.array([[self.one(f"{name}_{a}{between}{b}") for b in AXES] for a in AXES])


def lever_force(motion: Motion, arms: Floats) -> Floats:
    """Return what each accelerometer feels beside gravity for sitting off the axis (rows: x…)."""
    out = np.empty_like(motion.omega_eb)
    for k, r in enumerate(arms):
        w = motion.omega_eb
        pull = w @ r
        out[:, k] = (
            np.cross(motion.alpha_eb, r)[:, k] + w[:, k] * pull - r[k] * np.sum(w**2, axis=1)
        )
    return out


def measured(truth: Truth, motion: Motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return what noiseless sensors give at 1 kHz: ω′ and f′; x (n, 3) is T − T_ref of each."""
    w = motion.omega_ib
    f = motion.gravity_b + lever_force(motion, truth.mat("lever_arm", "_"))
    theta = truth.mat("gyro_misalignment") + np.diag(truth.vec("gyro_scale"))
    gamma = truth.mat("accel_misalignment") + np.diag(truth.vec("accel_scale"))
    gyro = (
        w
        + w @ theta.T
        + truth.vec("gyro_bias")
        + f @ truth.mat("gyro_g_sensitivity").T
        + np.abs(w) * truth.vec("gyro_scale_asymmetry")
        + x * truth.vec("gyro_temperature_drift")
        + np.where(t >= truth.one("gyro_bias_step_at_s"), 1.0, 0.0)[:, None]
        * truth.vec("gyro_bias_step")
    )
    accel = (
        f
        + f @ gamma.T
        + truth.vec("accel_bias")
        + f**2 * truth.vec("accel_second_order")
        + x * truth.vec("accel_temperature_bias")
        + x * f * truth.vec("accel_temperature_scale")
        + np.where(t >= truth.one("accel_bias_step_at_s"), 1.0, 0.0)[:, None]
        * truth.vec("accel_bias_step")
    )
    return gyro, delayed(accel, t, truth.vec("accel_delay"))


def delayed(values: Floats, t: Floats, by_s: Floats) -> Floats:
    """Return columns each of which is late by its own time."""
    if not by_s.any():
        return values
    late = [np.interp(t - s, t, column) for s, column in zip(by_s, values.T, strict=True)]
    return np.column_stack(late)


def temperatures(setup: Setup, t: Floats) -> Floats:
    """Return the three sensors' temperatures: each warms by its own amount and time constant."""
    amount = setup.warm_up_c * np.array([1.0, 0.85, 1.1])
    tau = setup.warm_up_s * np.array([1.0, 1.3, 0.8])
    return T_REF_C + amount * (1 - np.exp(-t[:, None] / tau))


def counted(increments: Floats, quantum: float) -> Floats:
    """Return increments as a counter gives them: what one step loses the next one has."""
    return np.diff(quantum * np.round(np.cumsum(increments, axis=0) / quantum), axis=0, prepend=0.0)


@lru_cache(maxsize=6)
def _moved(
    rig: Rig, axis: int, programme: tuple[tuple[float, float], ...], mount: tuple[float, ...]
) -> Motion:
    """Return a cycle's motion, which most sets of a benchmark share; nobody may change it."""
    motion = move(rig, axis, programme, np.array(mount))
    for name in MOTION_ARRAYS:
        getattr(motion, name).flags.writeable = False
    return motion


def record_cycle(
    setup: Setup,
    truth: Truth,
    number: int,
    start_s: float,
    rng: np.random.Generator,
    stranger: Stranger | None = None,
) -> tuple[pd.DataFrame, Motion]:
    """Move through one cycle and record it."""
    axis = AXES.index(setup.axes[number])
    mount = tuple(truth.vec("rig_mount").tolist())
    motion = _moved(setup.rig, axis, tuple(setup.programme), mount)
    every = round(setup.period_s / STEP_S)
    n = len(motion.omega_ib) // every
    t = start_s + STEP_S * (np.arange(n * every) + 0.5)
    temp = temperatures(setup, t)
    moved = cut(motion, n * every)
    gyro, accel = measured(truth, moved, t, temp - T_REF_C)
    if stranger is not None:
        more_gyro, more_accel = stranger(moved, t, temp - T_REF_C)
        gyro, accel = gyro + more_gyro, accel + more_accel
    dt = setup.period_s
    dtheta = dt * gyro.reshape(n, every, 3).mean(axis=1)
    dv = dt * accel.reshape(n, every, 3).mean(axis=1)
    root = np.sqrt(dt)
    dtheta += setup.gyro_noise_deg_h * DEG_H * root * rng.standard_normal((n, 3))
    dv += setup.accel_noise * root * rng.standard_normal((n, 3))
    dtheta, dv = counted(dtheta, setup.gyro_quantum), counted(dv, setup.accel_quantum)
    columns: dict[str, Floats] = {"time_s": start_s + dt * np.arange(1, n + 1)}
    frame = pd.DataFrame(columns).assign(cycle=number + 1)
    for k, a in enumerate(AXES):
        frame[f"dtheta_{a}" if setup.increments else f"gyro_{a}"] = (
            dtheta[:, k] if setup.increments else dtheta[:, k] / dt
        )
    for k, a in enumerate(AXES):
        frame[f"dv_{a}" if setup.increments else f"accel_{a}"] = (
            dv[:, k] if setup.increments else dv[:, k] / dt
        )
    read = temp[every - 1 :: every] + 0.005 * rng.standard_normal((n, 3))
    if setup.temp_per_axis:
        for k, a in enumerate(AXES):
            frame[f"temp_{a}_c"] = read[:, k].round(3)
    elif setup.warm_up_c:
        frame["temp_c"] = read[:, 0].round(3)
    if setup.angles:
        frame["rig_angle_rad"] = encoder(setup, truth, motion, dt * np.arange(1, n + 1), rng)
    return frame, motion


def encoder(
    setup: Setup, truth: Truth, motion: Motion, t: Floats, rng: np.random.Generator
) -> Floats:
    """Return the platform's angle in the rows of times t: at t + τ, with harmonics and noise."""
    grid = STEP_S * np.arange(len(motion.angle))
    shifted = t + truth.one("rig_time_offset")
    last_rate = (motion.angle[-1] - motion.angle[-2]) / STEP_S
    angle = np.interp(shifted, grid, motion.angle) + last_rate * np.maximum(0, shifted - grid[-1])
    wrong = sum(
        truth.one(f"rig_angle_harmonic_{name}{k}") * wave(k * angle)
        for name, wave in (("sin", np.sin), ("cos", np.cos))
        for k in (1, 2)
    )
    noise = setup.angle_noise_arcsec * ARCSEC / np.sqrt(setup.period_s)
    return angle + wrong + noise * rng.standard_normal(len(t))


def cut(motion: Motion, n: int, every: int = 1) -> Motion:
    """Return the first n steps, or of these one in so many."""
    taken = {name: getattr(motion, name)[:n:every] for name in MOTION_ARRAYS}
    return replace(motion, angle=motion.angle[: n + 1 : every], **taken)


def write_rig_run(
    path: Path,
    *,
    seed: int,
    setup: Setup | None = None,
    effects: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
    key_path: Path | None = None,
    stranger: Stranger | None = None,
) -> dict[str, object]:
    """Write a recorded rig run and its sidecar; return its answer key.

    Parameters
    ----------
    path : Path
        CSV; the sidecar has the same name with `.toml`.
    seed : int
    setup : Setup, optional
        Default: the article's three cycles at 50 Hz, without angles.
    effects : sequence of str
        Hidden effects at their middling size, names of `EFFECTS`.
    values : mapping, optional
        Parameters (SI) that override those drawn and those of the effects.
    key_path : Path, optional
        Where to write the key, never beside the data.
    stranger : callable, optional
        Adds what is none of the parameters.

    Returns
    -------
    dict
        `seed`, `effects`, `parameters` (NAME: value, SI), `azimuth_deg` (the true one),
        `attitude_at_start` (c_nb per cycle).

    Raises
    ------
    ValueError
        If the set-up cannot show an effect at all (no warming, no angles).
    """
    setup = setup or Setup()
    _check_shown(setup, effects)
    rng = np.random.default_rng(seed)
    drawn = draw_baseline(rng, setup.scale_of_priors)
    hidden = {name: value for effect in effects for name, value in EFFECTS[effect].items()}
    truth = Truth({**drawn, **hidden, **(values or {})})
    frames: list[pd.DataFrame] = []
    attitudes: list[object] = []
    start_s = 0.0
    for number in range(len(setup.axes)):
        frame, motion = record_cycle(setup, truth, number, start_s, rng, stranger)
        frames.append(frame)
        attitudes.append(motion.c_nb_start.tolist())
        start_s = float(frame["time_s"].iloc[-1]) + setup.gap_s
    frame = pd.concat(frames)
    frame["time_s"] = frame["time_s"].round(6)
    frame.to_csv(path, index=False, float_format="%.10g")
    path.with_suffix(".toml").write_text(sidecar(setup), encoding="utf-8")
    key: dict[str, object] = {
        "seed": seed,
        "effects": list(effects),
        "parameters": truth.values,
        "azimuth_deg": setup.rig.azimuth_deg,
        "attitude_at_start": attitudes,
    }
    if key_path is not None:
        key_path.write_text(json.dumps(key, indent=1), encoding="utf-8")
    return key


def _check_shown(setup: Setup, effects: Sequence[str]) -> None:
    """Refuse an effect that this set-up could not possibly show: a generator's mistake."""
    for name in effects:
        if "temperature" in name and not setup.warm_up_c:
            raise ValueError(f"{name} needs warm_up_c")
        if name in ("rig_time_offset", "rig_angle_harmonic") and not setup.angles:
            raise ValueError(f"{name} needs angles")


def sidecar(setup: Setup) -> str:
    """Return the sidecar's text: what the laboratory knows."""
    names = ", ".join(f'"{a}"' for a in setup.axes)
    gyro, accel, angle = setup.stated
    lines = [
        f"latitude_deg = {setup.rig.latitude_deg}",
        f"height_m = {setup.rig.height_m}",
        f"axis_of_cycle = [{names}]",
        f"azimuth_deg = {setup.rig.azimuth_deg - setup.azimuth_error_deg}",
        "azimuth_sigma_deg = 1.0",
        f"gyro_noise_deg_h_rthz = {gyro * setup.gyro_noise_deg_h}",
        f"accel_noise_m_s2_rthz = {accel * setup.accel_noise}",
    ]
    if setup.angles:
        lines.append(f"angle_noise_arcsec_rthz = {angle * setup.angle_noise_arcsec}")
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Write a rig run whose errors are known.")
    parser.add_argument("path", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--effect", action="append", default=[], choices=list(EFFECTS))
    parser.add_argument("--key", type=Path, help="where the answer goes; not beside the data")
    parser.add_argument("--multirate", action="store_true", help="several speeds and a rest")
    parser.add_argument("--minutes", type=float, default=15.0, help="of one cycle")
    parser.add_argument("--hz", type=float, default=50.0)
    parser.add_argument("--angles", action="store_true", help="with the platform's angle")
    parser.add_argument("--increments", action="store_true")
    parser.add_argument("--warm-up-c", type=float, default=0.0)
    parser.add_argument("--per-axis", action="store_true", help="a thermistor per accelerometer")
    asked = parser.parse_args(argv)
    programme = multirate(asked.minutes) if asked.multirate else article(asked.minutes)
    setup = Setup(
        programme=tuple(programme),
        period_s=1 / asked.hz,
        angles=asked.angles,
        increments=asked.increments,
        warm_up_c=asked.warm_up_c,
        temp_per_axis=asked.per_axis,
    )
    write_rig_run(
        asked.path, seed=asked.seed, setup=setup, effects=asked.effect, key_path=asked.key
    )


if __name__ == "__main__":
    main()
