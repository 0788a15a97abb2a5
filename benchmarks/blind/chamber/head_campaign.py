"""Blind campaigns of three accelerometers on one head, each with a whole equation and one effect.

    python -m benchmarks.blind.chamber.head_campaign --work build/head --campaigns 40

Every accelerometer has a misalignment, squared and cubed terms, a bias and a scale factor of third
order over temperature, and one hidden effect of its own; in every third campaign the head errs
twice a turn. The command sees the recorded run and its sidecar alone and is asked for all three at
once. As in `benchmark.py` nothing of the package is used, and the keys are opened last.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.blind.chamber.answering import ask_workflow
from benchmarks.blind.chamber.effects import Accelerometer, events, output_g
from benchmarks.blind.chamber.noise import FAMILIES, Yardstick
from benchmarks.blind.chamber.physics import (
    EIGHT,
    Floats,
    Night,
    Protocol,
    make_night,
    there_and_back,
)
from benchmarks.blind.chamber.truth import data_table, head_error, sidecar_text

ROOT = Path(__file__).parents[3]
SERIALS = ("A1", "A2", "A3")
# what an accelerometer may have of its own; the head's and the digitiser's error are not among them
OWN = (
    "thermal_lag",
    "temperature_rate_bias",
    "temperature_rate_scale",
    "bias_hysteresis",
    "scale_hysteresis",
    "run_in",
    "warm_up",
    "turn_on_offset",
    "bias_step",
    "bias_drift",
)
# every accelerometer has all of them; largest size
EQUATION = {
    "cross_axis": 400.0,
    "second_order": 20.0,
    "third_order": 20.0,
    "bias_temperature_order": 60.0,
    "scale_temperature_order": 60.0,
}
HEAD = "indexer_harmonic"
HEAD_ARCSEC = (0.5, 3.0)
STRENGTH = (20.0, 60.0)
PROTOCOL = Protocol(
    name="head",
    runs=tuple(there_and_back(rate) for rate in (1.0, 2.0, 1.0)),
    angles_deg=EIGHT,
    random_order=True,
    dwell_s=120.0,
)


def write_campaign(
    folder: Path, key_path: Path, number: int, *, seed: int, protocol: Protocol = PROTOCOL
) -> dict[str, Any]:
    """Write `run.csv` and `run.toml` of a campaign and its key; return the key."""
    rng = np.random.default_rng([seed, number])
    night = make_night(protocol, rng)
    noise = FAMILIES[("white+OU", "white")[number % 2]]
    yardstick = Yardstick.of(night, noise)
    once = events(night, rng)
    same = {HEAD: float(rng.uniform(*HEAD_ARCSEC))} if number % 3 == 0 else {}
    moved = head_error(night, rng)
    tables: list[pd.DataFrame] = []
    key: dict[str, Any] = {"head": same, "accelerometers": {}}
    for place, serial in enumerate(SERIALS):
        device = Accelerometer.drawn(rng)
        usual = {
            name: float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * most)
            for name, most in EQUATION.items()
        }
        own = OWN[(number * len(SERIALS) + place) % len(OWN)]
        size, d = _sized(own, float(rng.uniform(*STRENGTH)), night, device, once, yardstick)
        hidden = {**usual, **same, own: size}
        clean = output_g(night, device, hidden, once, moved)
        reading_ma = device.k1 * (clean + 1e-6 * noise.draw(night, rng))
        tables.append(data_table(night, reading_ma, rng).assign(serial=serial))
        key["accelerometers"][serial] = {
            "own": own, "size": size, "d": d, "equation": usual, "device": asdict(device),
        }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    pd.concat(tables).sort_values(["run", "time_s"], kind="stable").to_csv(
        folder / "run.csv", index=False
    )
    (folder / "run.toml").write_text(sidecar_text(night), encoding="utf-8")
    key_path.parent.mkdir(parents=True, exist_ok=True)
    key_path.write_text(json.dumps(key), encoding="utf-8")
    return key


def _sized(
    name: str,
    wanted: float,
    night: Night,
    device: Accelerometer,
    once: Mapping[str, Floats],
    yardstick: Yardstick,
) -> tuple[float, float]:
    """Return the size that has a strength, and the strength that came out."""
    plain = output_g(night, device, {}, once)
    size, d = 1.0, 0.0
    for _ in range(4):  # a lag is not linear in its size
        d = yardstick.strength(1e6 * (output_g(night, device, {name: size}, once) - plain))
        size *= wanted / d
    return size, d


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """One accelerometer of a campaign: what is true and what was said."""

    campaign: int
    serial: str
    own: str
    d: float
    head: bool
    verdict: str
    bare: tuple[str, ...]
    aliases: tuple[tuple[str, ...], ...]
    shared: tuple[tuple[str, str], ...]  # effect, owner

    @property
    def hidden(self) -> frozenset[str]:
        return frozenset([self.own, *([HEAD] if self.head else [])])

    @property
    def wrong_bare(self) -> tuple[str, ...]:
        """Names given without an alternative that are not true of it."""
        return tuple(n for n in self.bare if n not in self.hidden | set(EQUATION))

    @property
    def right(self) -> bool:
        """Whether all that is hidden was found, nothing else, and the head's told as shared."""
        found = set(self.bare) | {n for names in self.aliases for n in names}
        astray = [a for a in self.aliases if not set(a) & (self.hidden | set(EQUATION))]
        told = {e for e, owner in self.shared if owner == "head"} == ({HEAD} & self.hidden)
        return self.hidden <= found and not self.wrong_bare and not astray and told


def answers_to(number: int, key: Mapping[str, Any], answer: Mapping[str, Any]) -> list[Answered]:
    """Hold the command's document against the key."""
    document: dict[str, Any] = answer["json"] or {"accelerometers": [], "shared": []}
    said: dict[str, dict[str, Any]] = {a["serial"]: a for a in document["accelerometers"]}
    failed: dict[str, Any] = {"verdict": "failed", "effects": [], "alias_sets": []}
    made: list[Answered] = []
    for serial, true in key["accelerometers"].items():
        one = said.get(serial, failed)
        aliases = tuple(tuple(map(str, names)) for names in one["alias_sets"])
        aliased = {n for names in aliases for n in names}
        made.append(
            Answered(
                campaign=number,
                serial=serial,
                own=true["own"],
                d=true["d"],
                head=bool(key["head"]),
                verdict=one["verdict"],
                bare=tuple(e["name"] for e in one["effects"] if e["name"] not in aliased),
                aliases=aliases,
                shared=tuple(
                    (s["effect"], s["owner"]) for s in document["shared"] if serial in s["serials"]
                ),
            )
        )
    return made


def run_campaigns(work: Path, numbers: Sequence[int], *, seed: int) -> list[Answered]:
    """Write campaigns, ask the command about each, then open the keys; what is there is kept."""
    answers: dict[int, dict[str, Any]] = {}
    for number in numbers:
        folder = work / f"data/campaign-{number:03d}"
        if not (folder / "run.toml").exists():
            write_campaign(folder, work / f"keys/{number:03d}.json", number, seed=seed)
        stored = work / f"answers/{number:03d}.json"
        if not stored.exists():
            stored.parent.mkdir(parents=True, exist_ok=True)
            stored.write_text(json.dumps(ask_workflow(folder, ROOT)), encoding="utf-8")
        answers[number] = json.loads(stored.read_text(encoding="utf-8"))
    return [
        one
        for number, answer in answers.items()
        for one in answers_to(
            number, json.loads((work / f"keys/{number:03d}.json").read_text("utf-8")), answer
        )
    ]


def told(every: Sequence[Answered]) -> str:
    """Return the rates, and every answer that was not right."""
    right = sum(a.right for a in every)
    wrong = sum(bool(a.wrong_bare) for a in every)
    lines = [
        f"{len(every)} accelerometers in {len({a.campaign for a in every})} campaigns",
        f"right: {right} of {len(every)}; a wrong bare name: {wrong} of {len(every)}",
        f"verdicts: {dict(Counter(a.verdict for a in every))}",
    ]
    lines += [
        f"{a.campaign:03d} {a.serial} {'+'.join(sorted(a.hidden))} (d {a.d:.0f}): {a.verdict} "
        f"{','.join(a.bare)} {[' or '.join(s) for s in a.aliases]} {a.shared}"
        for a in every
        if not a.right
    ]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Blind campaigns of three on one head.")
    parser.add_argument("--work", type=Path, default=ROOT / "build/head")
    parser.add_argument("--campaigns", type=int, default=40)
    parser.add_argument("--seed", type=int, default=7)
    asked = parser.parse_args(argv)
    every = run_campaigns(asked.work, range(asked.campaigns), seed=asked.seed)
    sys.stdout.write(told(every) + "\n")
    right, wrong = sum(a.right for a in every), sum(bool(a.wrong_bare) for a in every)
    return 0 if right >= 0.95 * len(every) and wrong <= 0.01 * len(every) else 1


if __name__ == "__main__":
    sys.exit(main())
