"""Campaigns of many runs against `accelbench stability`, and of cycles against `runin`."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.strangers.chamber.judge import Verdict, call, write
from tests.strangers.chamber.physics import Accelerometer, Array, Faults, Run, record
from tests.strangers.chamber.setups import SetUp, draw

PATTERNS = ["none", "none", "trend", "step", "odd", "loop in some", "noisy run", "tails", "drift"]
LAWS = ["none", "exponential", "double", "log creep", "walk", "daily", "step", "done", "slow"]
LIMIT = 15.0


@dataclass(frozen=True)
class Series:
    """True K0 (µg) and K1 (ppm from nominal) of each run, and what else was planted."""

    kind: str
    how: SetUp
    faults: list[Faults]
    k0: Array
    k1: Array
    sigma: tuple[float, float] = (0.0, 0.0)
    to_come: tuple[float, float] = (0.0, 0.0)


def _series(
    kind: str, number: int, seed: int, k0: Array, k1: Array, faults: list[Faults]
) -> Series:
    how = replace(
        draw(seed, number), head="six", programme="loop", range_c=(0.0, 60.0), hours=3.0,
        rows=150, dwell=1, t_ref_c=25.0, sampling="even", unit="mA", nominal=1.3,
    )  # fmt: skip
    how = replace(how, sensor=Accelerometer(1.3, (0.0, 12.0, 0.05), (90.0, 0.2), {"k2": 12.0}))
    return Series(kind, how, faults, k0, k1)


def repeated(seed: int, number: int) -> Series:
    """Draw a campaign of 2 to 10 runs whose K0 and K1 scatter, and perhaps move."""
    rng = np.random.default_rng([seed, number, 1])
    kind = PATTERNS[number % len(PATTERNS)]
    count = int(rng.choice([2, 3, 3, 4, 6]))
    sigma = tuple(map(float, rng.choice([0.0, 3.0, 30.0, 100.0], 2)))
    k0: Array = sigma[0] * rng.standard_normal(count)
    k1: Array = sigma[1] * rng.standard_normal(count)
    size = 10.0 ** rng.uniform(1.0, 2.5)
    moved = {"trend": np.arange(count), "step": np.arange(count) >= count / 2}
    k0 = k0 + size * moved.get(kind, np.arange(count) == 1 if kind == "odd" else np.zeros(count))
    faults = [Faults(drift_ug=2.0 + 8.0 * (kind == "drift"), tails=3.0 * (kind == "tails"))] * count
    if kind == "loop in some":
        faults[0] = Faults(faults[0] | {"loop_ug": size / 3.0})
    if kind == "noisy run":
        faults[0] = Faults(faults[0] | {"white_ug": 5.0 + size})
    return replace(_series(kind, number, seed, k0, k1, faults), sigma=sigma)


def run_in(seed: int, number: int) -> Series:
    """Draw the cycles of a run-in; `to_come` is the largest change in 60 cycles more."""
    rng = np.random.default_rng([seed, number, 2])
    kind, count = LAWS[number % len(LAWS)], int(rng.choice([6, 10, 16, 24]))
    at = np.arange(count + 60, dtype=float)
    kappa, size = rng.uniform(1.0, 6.0), rng.uniform(100.0, 600.0)
    shapes = {
        "exponential": np.exp(-at / kappa),
        "done": 0.01 * np.exp(-at / kappa),
        "double": 0.7 * np.exp(-at / kappa) + 0.3 * np.exp(-at / (6.0 * kappa)),
        "log creep": np.exp(-at / kappa) - 0.2 * np.log1p(at),
        "slow": 1.0 / (1.0 + at / kappa),
        "walk": np.exp(-at / kappa) + np.cumsum(rng.standard_normal(len(at))) * 4.0 / size,
        "daily": np.exp(-at / kappa) + 0.1 * np.sin(2.0 * np.pi * at * 5.0 / 24.0),
        "step": np.exp(-at / kappa) + 0.3 * (at >= count // 2),
    }
    whole = size * shapes.get(kind, np.zeros(len(at)))
    ratio = float(rng.uniform(0.2, 1.0))
    done = whole[count - 1]
    to_come = float(np.abs(whole[count:] - done).max()) if kind != "daily" else 0.0
    faults = [Faults(drift_ug=float(rng.choice([0.5, 3.0])))] * count
    made = _series(kind, number, seed, whole[:count], ratio * whole[:count], faults)
    return replace(made, to_come=(to_come, ratio * to_come))


def record_series(series: Series, path: Path) -> None:
    """Record all runs of a series, five hours from start to start."""
    rng = np.random.default_rng([*series.how.seed, 3])
    runs: list[Run] = []
    for k, faults in enumerate(series.faults):
        sensor = series.how.sensor.shifted(float(series.k0[k]), float(series.k1[k]))
        runs.append(record(sensor, faults, series.how.plan(rng), rng, 18000.0 * k))
    write(runs, path, series.how, 9.80665)


def judge_stability(series: Series, folder: Path, limit: float = 20.0) -> Verdict:
    """Compare each run's K0 and K1, their scatter and the verdict with the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    path, limits = folder / "runs.csv", folder / "limits.toml"
    record_series(series, path)
    limits.write_text(f"[limits.k0]\nsigma_run = {limit}\n[limits.k1]\nsigma_run = {limit}\n")
    code, text = call("stability", path, "--limits", limits, "--json")
    (folder / "text.txt").write_text(text, encoding="utf-8")
    found = Verdict(code, text=text)
    if code not in (0, 1):
        return found
    told = json.JSONDecoder().raw_decode(text, text.index("{"))[0]["accelerometers"][0]
    for k, name in enumerate(("k0", "k1")):
        got, true = told["coefficients"][name], (series.k0, series.k1)[k]
        for at, run in enumerate(got["by_run"]):
            found.z[f"{name} of {run['run']}"] = (run["value"] - true[at]) / run["sigma"]
        sizes = (series.sigma[k], float(np.std(true, ddof=1)))
        found.z[f"{name} sigma_run"] = min(
            (_beyond(s, got["sigma_run"], got["ci95"]) for s in sizes), key=abs
        )
        span = float(np.ptp(true))
        found.z[f"{name} max-min"] = _beyond(span, got["max_minus_min"], got["max_minus_min_ci95"])
        if told["verdict"] == "pass" and min(sizes) > 1.5 * limit:
            found.z[f"{name} passed"] = 99.0
    return found


def _beyond(true: float, value: float, limits: list[float]) -> float:
    side = abs(limits[1 if true > value else 0] - value)
    return 0.0 if true == value else (value - true) / max(side / 1.96, 1e-9)


def judge_run_in(series: Series, folder: Path) -> Verdict:
    """Compare a run-in's verdict, cycles and remaining change with the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "cycles.csv"
    record_series(series, path)
    code, text = call("runin", path, "--json")
    (folder / "text.txt").write_text(text, encoding="utf-8")
    found = Verdict(code, text=text)
    if code not in (0, 1):
        return found
    told = json.JSONDecoder().raw_decode(text, text.index("{"))[0]["accelerometers"][0]
    for k, name in enumerate(("k0", "k1")):
        got, true = told["coefficients"][name], (series.k0, series.k1)[k]
        z = (np.array(got["by_cycle"]) - true) / np.array(got["by_cycle_sigma"])
        worst = int(np.argmax(np.abs(z)))
        found.z[f"{name} of cycle {worst}"] = float(z[worst])
        if told["settled"] and series.to_come[k] > LIMIT:
            found.z[f"{name} settled, {series.to_come[k]:.0f} to come"] = 99.0
    return found
