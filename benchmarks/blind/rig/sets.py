"""Write one rig run with something hidden in it, and (elsewhere) the answer key."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.rig.motion import Floats
from benchmarks.blind.rig.setup import EFFECTS, Setup, article, multirate
from benchmarks.blind.rig.strangers import STRANGERS
from benchmarks.blind.rig.truth import Stranger, write_rig_run
from benchmarks.blind.rig.yardstick import RigYardstick, yardstick_of

MINUTES = 3.0  # of a cycle: what is asked for in d is as visible as in a long one
PROTOCOLS: dict[str, Setup] = {
    "multirate": Setup(
        programme=tuple(multirate(MINUTES)), period_s=0.05, warm_up_c=15.0, temp_per_axis=True
    ),
    "article": Setup(
        programme=tuple(article(MINUTES)), period_s=0.05, warm_up_c=15.0, temp_per_axis=True
    ),
}
MODES = ("precise", "coarse")
# effect: its parameters, all of one unit, of which a random mixture is hidden
AXES_PAIRS = [f"{a}{b}" for a in "xyz" for b in "xyz"]
PARTS: dict[str, tuple[list[str], str]] = {
    "lever_arm": ([f"lever_arm_{p[0]}_{p[1]}" for p in AXES_PAIRS], "m"),
    "accel_delay": ([f"accel_delay_{a}" for a in "xyz"], "s"),
    "gyro_g_sensitivity": ([f"gyro_g_sensitivity_{p}" for p in AXES_PAIRS], "rad/s/(m/s²)"),
    "rig_time_offset": (["rig_time_offset"], "s"),
    "rig_mount": ([f"rig_mount_{a}" for a in "xyz"], "rad"),
    "rig_angle_harmonic": (["rig_angle_harmonic_sin1", "rig_angle_harmonic_cos1"], "rad"),
    "gyro_scale_asymmetry": ([f"gyro_scale_asymmetry_{a}" for a in "xyz"], "1"),
    "accel_second_order": ([f"accel_second_order_{a}" for a in "xyz"], "1/(m/s²)"),
    "accel_temperature_bias": ([f"accel_temperature_bias_{a}" for a in "xyz"], "m/s²/°C"),
    "accel_temperature_scale": ([f"accel_temperature_scale_{a}" for a in "xyz"], "1/°C"),
    "gyro_temperature_drift": ([f"gyro_temperature_drift_{a}" for a in "xyz"], "rad/s/°C"),
    "gyro_bias_step": ([f"gyro_bias_step_{a}" for a in "xyz"], "rad/s"),
    "accel_bias_step": ([f"accel_bias_step_{a}" for a in "xyz"], "m/s²"),
}
NEED_ANGLE = ("rig_time_offset", "rig_mount", "rig_angle_harmonic")


@dataclass(frozen=True, slots=True, kw_only=True)
class RigRecipe:
    """What to hide, by strength d, in which programme, with the rig's angle or without.

    `stated` are the densities that the sidecar states over the true ones (gyros, accelerometers,
    angle).
    """

    group: str
    protocol: str
    mode: str
    strengths: Mapping[str, float]
    stated: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        unknown = set(self.strengths) - set(PARTS) - set(STRANGERS)
        needs = set(self.strengths) & set(NEED_ANGLE) if self.mode == "coarse" else set()
        if unknown or needs or self.protocol not in PROTOCOLS or self.mode not in MODES:
            raise ValueError(f"not a recipe: {self}")

    @property
    def setup(self) -> Setup:
        """The rig's set-up."""
        return replace(PROTOCOLS[self.protocol], angles=self.mode == "precise")


def write_rig_set(
    folder: Path, key_path: Path, recipe: RigRecipe, seed: Sequence[int]
) -> dict[str, object]:
    """Write `run.csv` and `run.toml` into a folder and the key to its own place; return the key."""
    rng = np.random.default_rng(list(seed))
    yardstick = yardstick_of(recipe.setup)
    values: dict[str, float] = {}
    hidden: dict[str, dict[str, object]] = {}
    strangers: list[Stranger] = []
    for name, d in recipe.strengths.items():
        if name in STRANGERS:
            stranger, size = _sized_stranger(name, d, yardstick, rng)
            strangers.append(stranger)
            unit = "m/s²"
        else:
            chosen, size = _sized(name, d, yardstick, rng, recipe.setup)
            values |= chosen
            unit = PARTS[name][1]
        hidden[name] = {"size": size, "unit": unit, "d": d}
    folder.mkdir(parents=True, exist_ok=True)
    write_rig_run(
        folder / "run.csv",
        seed=int(rng.integers(2**31)),
        setup=replace(recipe.setup, stated=recipe.stated),
        values=values,
        stranger=_all(strangers) if strangers else None,
    )
    key: dict[str, object] = {
        "group": recipe.group,
        "protocol": recipe.protocol,
        "noise": recipe.mode,
        "seed": list(seed),
        "hidden": hidden,
        "values": values,
    }
    key_path.parent.mkdir(parents=True, exist_ok=True)
    key_path.write_text(json.dumps(key, indent=1), encoding="utf-8")
    return key


def _sized(
    name: str, d: float, yardstick: RigYardstick, rng: np.random.Generator, setup: Setup
) -> tuple[dict[str, float], float]:
    """Draw a mixture of an effect's parameters and give it the strength asked for."""
    assert set(PARTS) == set(EFFECTS)
    names, _ = PARTS[name]
    direction = rng.standard_normal(len(names))
    direction /= np.linalg.norm(direction)
    mixed = dict(zip(names, direction.tolist(), strict=True))
    if name.endswith("_step"):  # inside a cycle, not where the SINS is re-mounted
        length = sum(s for _, s in setup.programme)
        cycle = int(rng.integers(len(setup.axes)))
        within = float(rng.uniform(0.25, 0.75)) * length
        mixed[f"{name}_at_s"] = cycle * (length + setup.gap_s) + within
    size = d / yardstick.strength(mixed)
    return {n: v if n.endswith("_at_s") else size * v for n, v in mixed.items()}, size


def _sized_stranger(
    name: str, d: float, yardstick: RigYardstick, rng: np.random.Generator
) -> tuple[Stranger, float]:
    one = STRANGERS[name](rng)
    size = d / yardstick.strength({}, one)

    def scaled(motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
        rate, force = one(motion, t, x)
        return size * rate, size * force

    return scaled, size


def _all(strangers: Sequence[Stranger]) -> Stranger:
    def together(motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
        made = [s(motion, t, x) for s in strangers]
        return np.sum([r for r, _ in made], axis=0), np.sum([f for _, f in made], axis=0)

    return together
