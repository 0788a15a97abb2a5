"""Write one data set: a campaign's recorded run, its sidecar, and (elsewhere) the answer key."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.blind.chamber.effects import (
    UNITS,
    Accelerometer,
    events,
    output_g,
)
from benchmarks.blind.chamber.noise import FAMILIES, HEAD_REPEAT_ARCSEC, Yardstick
from benchmarks.blind.chamber.physics import PROTOCOLS, Floats, Night, Protocol, make_night

THERMISTOR_C, THERMISTOR_STEP_C = 0.002, 0.001
OUTPUT_STEP_MA = 2e-6  # of the meter: 1.5 µg
HEAD_ERROR_ARCSEC = 0.005  # the same in each turn: a tenth of what could be seen, so not hidden
GRAVITY_M_S2 = 9.81562
FIRST_START = datetime(2026, 3, 2, 18, 0, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """What to hide: effects by strength d (or by size), under which noise, in which protocol."""

    group: str
    protocol: str
    noise: str
    strengths: Mapping[str, float]  # NAME: d asked for
    sizes: Mapping[str, float]  # NAME: size in its unit, where the size is what is asked
    tempco: bool = True

    def __post_init__(self) -> None:
        unknown = (set(self.strengths) | set(self.sizes)) - set(UNITS)
        if unknown or self.protocol not in PROTOCOLS or self.noise not in FAMILIES:
            raise ValueError(f"not a recipe: {self}")

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of all that is hidden."""
        return (*self.strengths, *self.sizes)


def write_set(
    folder: Path, key_path: Path, recipe: Recipe, seed: Sequence[int]
) -> dict[str, object]:
    """Write `run.csv` and `run.toml` into a folder and the key to its own place; return the key."""
    rng = np.random.default_rng(seed)
    night = make_night(PROTOCOLS[recipe.protocol], rng)
    device = Accelerometer.drawn(rng, tempco=recipe.tempco)
    once = events(night, rng)
    noise = FAMILIES[recipe.noise]
    yardstick = Yardstick.of(night, noise)
    signs = {name: float(rng.choice([-1.0, 1.0])) for name in recipe.hidden}
    hidden, d = _sized(recipe, night, device, once, yardstick, signs)
    clean = output_g(night, device, hidden, once, head_error(night, rng))
    drawn = noise.draw(night, rng)
    _write(folder / "run.csv", night, device.k1 * (clean + 1e-6 * drawn), rng)
    key: dict[str, object] = {
        "group": recipe.group,
        "protocol": recipe.protocol,
        "noise": recipe.noise,
        "seed": list(seed),
        "accelerometer": asdict(device),
        "hidden": {n: {"size": s, "unit": UNITS[n], "d": d[n]} for n, s in hidden.items()},
        "noise_rms_ug": float(np.std(drawn)),
    }
    key_path.parent.mkdir(parents=True, exist_ok=True)
    key_path.write_text(json.dumps(key, indent=1), encoding="utf-8")
    return key


def write_more(
    path: Path, key: Mapping[str, Any], protocol: Protocol, seed: Sequence[int]
) -> dict[str, float]:
    """Let the same accelerometer be measured by another protocol; return the strengths there.

    Effects that happen once cannot be had again; asking for one is a mistake of the caller.
    """
    rng = np.random.default_rng(seed)
    night = make_night(protocol, rng)
    device = Accelerometer(**key["accelerometer"])
    hidden = {name: float(v["size"]) for name, v in key["hidden"].items()}
    noise = FAMILIES[key["noise"]]
    plain = output_g(night, device, {}, {})
    yardstick = Yardstick.of(night, noise)
    clean = output_g(night, device, hidden, {}, head_error(night, rng))
    reading = device.k1 * (clean + 1e-6 * noise.draw(night, rng))
    _write(path, night, reading, rng, run_prefix="next-", days_later=7)
    return {
        name: yardstick.strength(1e6 * (output_g(night, device, {name: size}, {}) - plain))
        for name, size in hidden.items()
    }


def _write(
    path: Path,
    night: Night,
    reading_ma: Floats,
    rng: np.random.Generator,
    *,
    run_prefix: str = "",
    days_later: int = 0,
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    table = data_table(night, reading_ma, rng)
    table["run"] = run_prefix + table["run"].astype(str)
    table.to_csv(path, index=False)
    text = sidecar_text(night, run_prefix, FIRST_START + timedelta(days=days_later))
    path.with_suffix(".toml").write_text(text, encoding="utf-8")


def _sized(
    recipe: Recipe,
    night: Night,
    device: Accelerometer,
    once: Mapping[str, Floats],
    yardstick: Yardstick,
    signs: Mapping[str, float],
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the sizes that give the strengths asked for, and the strengths that came out."""
    plain = output_g(night, device, {}, once)

    def strength(name: str, size: float) -> float:
        change = output_g(night, device, {name: size}, once) - plain
        return yardstick.strength(1e6 * change)

    hidden: dict[str, float] = {}
    d: dict[str, float] = {}
    for name in recipe.hidden:
        sign = 1.0 if name == "thermal_lag" else signs[name]
        size = recipe.sizes.get(name, 1.0)
        d[name] = strength(name, sign * size)
        for _ in range(4 if name == "thermal_lag" else 1):  # a lag is not linear in its size
            if name in recipe.strengths:
                size *= recipe.strengths[name] / d[name]
                d[name] = strength(name, sign * size)
        hidden[name] = sign * size
    return hidden, d


def head_error(night: Night, rng: np.random.Generator) -> Floats:
    """Return how far the head stands from its angle in each reading, degrees."""
    sizes = HEAD_ERROR_ARCSEC * rng.standard_normal(4)
    angle = np.deg2rad(night.angle_deg)
    waves = (np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle))
    same = sizes @ np.array(waves)
    dwell = night.dwell + (int(night.dwell.max()) + 1) * night.run
    moved = HEAD_REPEAT_ARCSEC * rng.standard_normal(int(dwell.max()) + 1)[dwell]
    away = np.where(night.moving, rng.uniform(-40, 40, night.run.size), 0.0)
    return (same + moved) / 3600 + away


def data_table(night: Night, reading_ma: Floats, rng: np.random.Generator) -> pd.DataFrame:
    """Return the readings as they are recorded: quantised, the thermistor with its noise."""
    read = night.case_c.mean(axis=1) + THERMISTOR_C * rng.standard_normal(night.run.size)
    columns: dict[str, Any] = {
        "run": night.run + 1,
        "serial": "A1",
        "time_s": night.time_s,
        "temp_c": (THERMISTOR_STEP_C * np.round(read / THERMISTOR_STEP_C)).round(4),
        "chamber_c": night.chamber_c.round(2),
        "position_deg": night.angle_deg,
        "output": (OUTPUT_STEP_MA * np.round(reading_ma / OUTPUT_STEP_MA)).round(7),
        "flag": np.where(night.moving, "moving", ""),
    }
    if night.mount_deg:
        turned = np.deg2rad(night.angle_deg + night.mount_deg)
        columns |= {"a_i_g": np.sin(turned), "a_p_g": np.cos(turned), "a_o_g": 0.0}
    return pd.DataFrame(columns)


def sidecar_text(night: Night, run_prefix: str = "", first: datetime = FIRST_START) -> str:
    """Return the sidecar of a campaign."""
    lines = [
        'output_unit = "mA"',
        f"gravity_m_s2 = {GRAVITY_M_S2}",
        "nominal_scale = 1.3",
        "",
        "[run_start_utc]",
    ]
    for number in range(int(night.run[-1]) + 1):
        began = float((night.age_s - night.time_s)[night.run == number][0])
        start = first + timedelta(seconds=round(began))
        lines.append(f'"{run_prefix}{number + 1}" = {start:%Y-%m-%dT%H:%M:%SZ}')
    return "\n".join(lines) + "\n"
