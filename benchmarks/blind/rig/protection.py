"""Does a calibration's protection level hold when its model lacks an effect? Blind rig runs.

    python -m benchmarks.blind.rig.protection --seeds 10 --sound 50 --out runs.jsonl

What the file holds already is not made again, so that a study can be cut short and gone on with.

Each run hides one effect that `rig calibrate` is not told of, of a size from 0.3 to 3 times what
its tests can see (strength 7 by the yardstick), but no larger than three times what is expected of
such sensors. What counts: is the error of every parameter within the protection level, and do the
tests see the effect. A parameter that drifts or jumps has its mean over the run for a truth.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.blind.rig.motion import AXES, Floats, Motion
from benchmarks.blind.rig.sets import PARTS, PROTOCOLS
from benchmarks.blind.rig.setup import DEG_H, T_REF_C, G, Setup
from benchmarks.blind.rig.truth import Stranger, temperatures, write_rig_run
from benchmarks.blind.rig.yardstick import yardstick_of
from sinscal.judgement.judge import Judged
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.recording.files import read_rig_run

SEEN_D = 7.0
# Three times what sensors of this grade are expected to have.
LARGEST = {
    "lever_arm": 0.3,
    "accel_delay": 0.015,
    "gyro_g_sensitivity": 1.5 * DEG_H / G,
    "rig_angle_harmonic": 1.7e-3,
    "gyro_scale_asymmetry": 3e-4,
    "accel_second_order": 3e-4 / G,
    "accel_temperature_bias": 300e-6 * G,
    "accel_temperature_scale": 6e-4,
    "gyro_temperature_drift": 0.15 * DEG_H,
    "gyro_bias_step": 1.5 * DEG_H,
    "accel_bias_step": 0.06,
    "gyro_walk": 0.75 * DEG_H,
    "accel_walk": 0.015,
}
UNRECORDED = {"gyro_warmth": "gyro_temperature_drift", "accel_warmth": "accel_temperature_bias"}
WALK_STEP_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What is hidden in one run: parameters, a walk, and what it adds to the biases' means."""

    values: Mapping[str, float]
    size: float
    stranger: Stranger | None = None
    mean: Mapping[str, float] | None = None


def measured_times(setup: Setup) -> Floats:
    """Return the times of a run at which it is recorded, one a second."""
    length = sum(s for _, s in setup.programme)
    cycle = np.arange(0.5, length)
    return np.concatenate([k * (length + setup.gap_s) + cycle for k in range(len(setup.axes))])


def walk_of(kind: str, setup: Setup, rng: np.random.Generator) -> Stranger:
    """Return a random walk of three biases, zero in the mean over the run."""
    at = WALK_STEP_S * np.arange(2000)
    walk = np.cumsum(rng.standard_normal((at.size, 3)), axis=0) * np.sqrt(WALK_STEP_S / 500.0)
    mean = [np.interp(measured_times(setup), at, w).mean() for w in walk.T]

    def stranger(motion: Motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
        del motion, x
        shape = np.column_stack(
            [np.interp(t, at, w) - m for w, m in zip(walk.T, mean, strict=True)]
        )
        zero = np.zeros_like(shape)
        return (shape, zero) if kind == "gyro" else (zero, shape)

    return stranger


def hide(name: str, setup: Setup, rng: np.random.Generator, times: float) -> Hidden:
    """Draw an effect of so many times the size that the tests can see."""
    yardstick = yardstick_of(setup)
    if name.endswith("_walk"):
        one = walk_of(name.partition("_")[0], setup, rng)
        size = min(times * SEEN_D / yardstick.strength({}, one), LARGEST[name])

        def scaled(motion: Motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
            rate, force = one(motion, t, x)
            return size * rate, size * force

        return Hidden(values={}, size=size, stranger=scaled)
    effect = UNRECORDED.get(name, name)
    names, _ = PARTS[effect]
    direction = rng.standard_normal(len(names))
    direction /= np.linalg.norm(direction)
    mixed = dict(zip(names, direction.tolist(), strict=True))
    if effect.endswith("_step"):
        length = sum(s for _, s in setup.programme)
        cycle = int(rng.integers(len(setup.axes)))
        mixed[f"{effect}_at_s"] = cycle * (length + setup.gap_s) + rng.uniform(0.1, 0.9) * length
    size = times * SEEN_D / yardstick.strength(mixed)
    size = min(size, LARGEST[effect] / np.abs(direction).max())
    values = {n: v if n.endswith("_at_s") else size * v for n, v in mixed.items()}
    return Hidden(values=values, size=size, mean=_means(effect, name, values, setup))


def _means(
    effect: str, name: str, values: Mapping[str, float], setup: Setup
) -> Mapping[str, float] | None:
    t, kind = measured_times(setup), effect.partition("_")[0]
    if effect.endswith("_step"):
        share = float(np.mean(t >= values[f"{effect}_at_s"]))
        return {f"{kind}_bias_{a}": share * values[f"{effect}_{a}"] for a in AXES}
    if name in UNRECORDED:
        warm = (temperatures(setup, t) - T_REF_C).mean(axis=0)
        return {
            f"{kind}_bias_{a}": w * values[f"{effect}_{a}"]
            for a, w in zip(AXES, warm.tolist(), strict=True)
        }
    return None


def one_run(
    name: str, setup: Setup, seed: Sequence[int], folder: Path, options: Options, times: float = 0.0
) -> tuple[Judged, dict[str, float], float]:
    """Write a run, calibrate it; return the judgement, the truth and the size of what is hidden."""
    rng = np.random.default_rng(list(seed))
    times = times or float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
    hidden = hide(name, setup, rng, times) if name != "nothing" else Hidden(values={}, size=0.0)
    path = folder / "run.csv"
    key = write_rig_run(
        path, seed=int(rng.integers(2**31)), setup=setup, values=hidden.values,
        stranger=hidden.stranger,
    )  # fmt: skip
    if name in UNRECORDED:
        frame = pd.read_csv(path)
        frame.drop(columns=[c for c in frame if c.startswith("temp")]).to_csv(path, index=False)
    truth = dict(key["parameters"])  # type: ignore[call-overload]
    for parameter, more in (hidden.mean or {}).items():
        truth[parameter] = truth.get(parameter, 0.0) + more
    return calibrate_and_judge(read_rig_run(path), options), truth, times


def record(judged: Judged, truth: Mapping[str, float]) -> dict[str, object]:
    """Return what one run says: passed, which effect, errors over level and over sigma."""
    found, levels = judged.found, judged.protection
    assert levels is not None
    effects = judged.consistency.effects
    assert effects is not None
    # how far a drift went has no truth of one number
    names = [n for n in found.names if "_bias_drift" not in n]
    error = np.array([found.value(n) - truth.get(n, 0.0) for n in names])
    over = np.abs(error) / np.array([levels[n].total for n in names])
    sigmas = np.abs(error) / np.array([found.sigma(n) for n in names])
    return {
        "passed": judged.passed,
        "failed": [n for n, ok in judged.consistency.tests.items() if ok is False],
        "first": effects.missing[0].name if effects.missing else None,
        "drifts": [f"{d.kind} {d.family}" for d in judged.drifts],
        "parameters": len(names),
        "outside": int(np.sum(over > 1.0)),
        "worst": {names[int(np.argmax(over))]: float(over.max())},
        "sigmas": float(sigmas.max()),
        "warnings": [w.partition(":")[0] for w in judged.warnings],
    }


def cells() -> Iterator[tuple[str, str]]:
    """Yield each effect in the modes in which it can show."""
    for name, mode in product((*LARGEST, *UNRECORDED), ("coarse", "precise")):
        if not (name == "rig_angle_harmonic" and mode == "coarse"):
            yield name, mode


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the runs that a file holds: what was made is not made again."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Hold protection levels to hidden truths.")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sound", type=int, default=0, help="runs with nothing hidden, each mode")
    parser.add_argument("--only", action="append", help="one of the effects")
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, appended to")
    asked = parser.parse_args(argv)
    seeds = range(asked.first, asked.first + asked.seeds)
    wanted = [(n, m, s) for s in seeds for n, m in cells() if not asked.only or n in asked.only]
    wanted += [("nothing", m, s) for s in range(asked.sound) for m in ("coarse", "precise")]
    # evenly over all, so that a study cut short has as many of each
    count = {"nothing": asked.sound}
    wanted.sort(key=lambda w: w[2] / count.get(w[0], asked.seeds))
    made = {(r["hidden"], r["mode"], r["seed"]) for r in rows_of(asked.out)}
    wanted = [w for w in wanted if w not in made]
    for name, mode, seed in wanted:
        protocol = ("multirate", "article")[seed % 2]
        setup = replace(PROTOCOLS[protocol], angles=mode == "precise")
        options = Options(mode="precise" if mode == "precise" else "coarse")
        number = [*LARGEST, *UNRECORDED, "nothing"].index(name)
        with tempfile.TemporaryDirectory() as folder:
            judged, truth, times = one_run(name, setup, (seed, number), Path(folder), options)
        row = {"hidden": name, "mode": mode, "programme": protocol, "seed": seed, "times": times}
        with asked.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row | record(judged, truth)) + "\n")


if __name__ == "__main__":
    main()
