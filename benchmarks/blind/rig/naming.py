"""Does `discrepancy rig` call a slow drift what it is, and a delay by its name and size?

    python -m benchmarks.blind.rig.naming --drifts 25 --delays 20 --out runs.jsonl

Drifts are random walks of either kind of sensor and warmth that is not recorded, of 0.5 to 3 times
the size that the tests can see; a wrong bare name is a verdict `named` of anything, or an alias set
that the drift is not in. Delays of the accelerometers are of 0.2, 1 and 5 ms, at several speeds (at
10 °/s alone the least has strength 4, and can have no name); each is calibrated without them, which
must fail and name them first, and with them, which must find their size.
"""

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.blind.rig.motion import AXES
from benchmarks.blind.rig.protection import UNRECORDED, hide, rows_of
from benchmarks.blind.rig.sets import PROTOCOLS
from benchmarks.blind.rig.setup import Setup
from benchmarks.blind.rig.truth import Stranger, write_rig_run
from sinscal.discrepancy.find import find_rig_discrepancy
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.recording.files import read_rig_run
from sinscal.recording.run import RigRun

DRIFTING = ("gyro_walk", "accel_walk", *UNRECORDED)
DELAYS_S = (0.2e-3, 1e-3, 5e-3)
LEAST_TIMES, MOST_TIMES = 0.5, 3.0


def setup_of(seed: int, mode: str) -> Setup:
    """Return a set-up, of the two programmes in turn, with the angle in the precise mode."""
    protocol = ("multirate", "article")[seed % 2]
    return replace(PROTOCOLS[protocol], angles=mode == "precise")


def recorded(
    setup: Setup, seed: int, values: Mapping[str, float], stranger: Stranger | None, *, warm: bool
) -> RigRun:
    """Return a run as the package reads it, with or without its temperatures."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write_rig_run(path, seed=seed, setup=setup, values=values, stranger=stranger)
        if not warm:
            frame = pd.read_csv(path)
            bare = frame.drop(columns=[c for c in frame if c.startswith("temp")])
            bare.to_csv(path, index=False)
        return read_rig_run(path)


def drift_row(name: str, mode: str, seed: int) -> dict[str, object]:
    """Return what `discrepancy rig` says of a run in which something drifts."""
    setup = setup_of(seed, mode)
    rng = np.random.default_rng([seed, DRIFTING.index(name), 12])
    times = float(np.exp(rng.uniform(np.log(LEAST_TIMES), np.log(MOST_TIMES))))
    hidden = hide(name, setup, rng, times)
    run = recorded(
        setup, int(rng.integers(2**31)), hidden.values, hidden.stranger,
        warm=name not in UNRECORDED,
    )  # fmt: skip
    d = find_rig_discrepancy(run)
    truth = f"{name.partition('_')[0]}_bias_drift"
    sets = [list(s) for s in d.alias_sets]
    open_sets = bool(sets) and all(truth in s for s in sets)
    return {
        "times": times,
        "verdict": d.verdict,
        "names": [e.effect.name for e in d.effects],
        "alias_sets": sets,
        "drift": f"{d.drift.kind} {d.drift.family}" if d.drift else None,
        "wrong": d.verdict == "named" or (d.verdict == "alias" and not open_sets),
    }


def delay_row(by_s: float, mode: str, seed: int) -> dict[str, object]:
    """Return what `rig calibrate` says of a run whose accelerometers are late."""
    setup = setup_of(0, mode)
    truth = {f"accel_delay_{a}": by_s for a in AXES}
    run = recorded(setup, 7919 * seed + round(1e6 * by_s), truth, None, warm=True)
    options = Options(mode="precise" if mode == "precise" else "coarse")
    without = calibrate_and_judge(run, options)
    effects = without.consistency.effects
    assert effects is not None
    having = calibrate_and_judge(run, replace(options, groups=("accel_delay",)))
    return {
        "named_first": bool(effects.missing) and effects.missing[0].name == "accel_delay",
        "passed_without": without.passed,
        "passed_with": having.passed,
        "sigmas": [(having.found.value(n) - s) / having.found.sigma(n) for n, s in truth.items()],
    }


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Hold names to what is hidden.")
    parser.add_argument("--drifts", type=int, default=0, help="seeds of each kind of drift")
    parser.add_argument("--delays", type=int, default=0, help="seeds of each delay")
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, appended to")
    asked = parser.parse_args(argv)
    modes = ("coarse", "precise")
    # both programmes in each mode in turn
    wanted = [(n, modes[s // 2 % 2], s) for s in range(asked.drifts) for n in DRIFTING]
    delays = [f"delay {d:g}" for d in DELAYS_S]
    wanted += [(n, modes[s % 2], s) for s in range(asked.delays) for n in delays]
    wanted.sort(key=lambda w: w[2] / (asked.drifts if w[0] in DRIFTING else asked.delays))
    made = {(r["hidden"], r["mode"], r["seed"]) for r in rows_of(asked.out)}
    for name, mode, seed in (w for w in wanted if w not in made):
        if name in DRIFTING:
            row = drift_row(name, mode, seed)
        else:
            row = delay_row(float(name.partition(" ")[2]), mode, seed)
        with asked.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"hidden": name, "mode": mode, "seed": seed} | row) + "\n")


if __name__ == "__main__":
    main()
