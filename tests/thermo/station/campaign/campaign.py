"""Set random faults against a running test, and count what came of them.

    python -m tests.thermo.station.campaign.campaign --count 300 --seed 1

The instruments are foreign ones in another process (`bench.py`), the program is `accelbench`
itself; the kinds are in `kinds_*.py`. A table goes to standard output; the exit code is 1 if
anything failed.
"""

import argparse
import importlib
import json
import math
import random
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

from tests.thermo.station.campaign.case import Case, judge_readings
from tests.thermo.station.campaign.kinds import KINDS, NotSetError

for _group in ("process", "chamber", "store"):
    importlib.import_module(f"tests.thermo.station.campaign.kinds_{_group}")


TRIES = 3  # of a fault that could not be set: a loaded machine begins too late


def run_one(name: str, seed: int, folder: Path) -> dict:
    """Return what came of one fault of the kind `name`; one that could not be set is set anew."""
    for number in range(TRIES):
        found = _try_one(name, seed, folder / str(number))
        found["tries"] = number + 1
        if not found.pop("not_set"):
            break
        sys.stderr.write(f"{name} {seed}: not set, {found['problems'][0][-200:]!r}\n")
    return found


def _try_one(name: str, seed: int, folder: Path) -> dict:
    function, _, bench = KINDS[name]
    case = Case(folder, seed, **bench)
    found = {"kind": name, "seed": seed, "code": None, "safe_s": math.nan, "lost": 0, "double": 0,
             "wrong": 0, "acks": 0, "not_set": False, "problems": []}  # fmt: skip
    problems = found["problems"]
    began = time.monotonic()
    try:
        _judge(case, function, found)
    except Exception as error:  # the campaign goes on
        found["not_set"] = isinstance(error, NotSetError)
        problems.append(traceback.format_exc(limit=3)[-900:])
    finally:  # interrupted, too: nothing is left behind
        try:
            problems += case.close()
        except Exception as error:
            problems.append(f"closing: {error!r}")
        subprocess.run(["umount", str(folder / "disk")], check=False, capture_output=True)
    found["took_s"] = round(time.monotonic() - began, 1)
    if problems:
        found["text"] = case.process.text()[-1500:] if case.process else ""
    return found


def _judge(case: Case, function, found: dict) -> None:
    problems = found["problems"]
    result = function(case)
    problems += result.problems
    code = case.process.wait(200)
    found["code"] = code
    if code not in result.codes:
        problems.append(f"exit code {code}, not in {result.codes}")
    if result.within_s is None:
        if writes := case.log("write"):
            problems.append(f"{len(writes)} writes to a chamber that was never ours")
        return
    if code == 0:
        found["safe_s"] = 0.0
        if not case.is_safe():
            problems.append("exit code 0 and the chamber is not safe")
            found["safe_s"] = math.nan
    else:
        found["safe_s"] = case.wait_safe(result.within_s + 5)
        if not found["safe_s"] <= result.within_s:
            problems.append(f"safe after {found['safe_s']} s: {case.panel('state')}")
    listed, text = case.command("runs", "--store", result.where[0] if result.where else case.store)
    if listed != 0 and case.acks():
        problems.append(f"accelbench runs: exit code {listed}: {text[-300:]}")
    _judge_store(case, result, found)
    if result.says:
        said = case.process.text() + case.events() if not result.where else case.process.text()
        if result.says.lower() not in said.lower():
            problems.append(f"nowhere said: {result.says}")
    if result.resumable and case.acks() and case.rng.random() < 0.4:
        code, text = case.command(
            "run", "--resume", case.tests()[-1]["id"], "--store", case.store, "--out", "all.csv",
            acks=case.folder / "acks",
        )  # fmt: skip
        found["resumed"] = code
        if code != 0:
            problems.append(f"resumed: exit code {code}: {text[-600:]}")
        _judge_store(case, result, found)


def _judge_store(case: Case, result, found: dict) -> None:
    rows = [
        r
        for path in result.where or [case.store]
        for r in case.rows("select * from readings", path)
    ]
    found["acks"] = len(case.acks())
    for what, number in zip(("lost", "double", "wrong"), judge_readings(case, rows), strict=True):
        found[what] = number
        if number:
            found["problems"].append(f"{number} readings {what}")
    if found["code"] == 0 and not result.where:
        tests = case.tests()
        if tests[-1]["status"] != "finished":
            found["problems"].append(f"exit code 0 of a test that is {tests[-1]['status']}")


def table(results: list[dict]) -> str:
    """Return a line a kind: how many, safe, lost, doubled, wrong, exit codes, failures."""
    lines = [f"{'kind':34} n safe within s  acked lost twice wrong  codes          failed"]
    for name in [*KINDS, ""]:
        mine = [r for r in results if name in ("", r["kind"])]
        if not mine:
            continue
        safe = [r["safe_s"] for r in mine if r["safe_s"] > 0]
        sums = [sum(r[k] for r in mine) for k in ("acks", "lost", "double", "wrong")]
        codes = sorted({str(r["code"]) for r in mine})
        lines.append(
            f"{name or 'all':34} {len(mine):3} {max(safe, default=0.0):6.1f}  "
            f"{sums[0]:6} {sums[1]:4} {sums[2]:4} {sums[3]:4}  {','.join(codes):14} "
            f"{sum(bool(r['problems']) for r in mine)}"
        )
    return "\n".join(lines)


def draw(count: int, seed: int) -> list[tuple[str, int]]:
    """Return kinds and seeds: each kind once as far as they go, then by weight."""
    rng = random.Random(seed)
    names = list(KINDS)
    rng.shuffle(names)
    weights = [KINDS[n][1] for n in names]
    names += rng.choices(names, weights, k=max(0, count - len(names)))
    return [(n, rng.randrange(2**31)) for n in names[:count]]


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append")
    parser.add_argument("--skip", type=int, default=0)
    parser.add_argument("--log", type=Path, help="a JSON document a fault is added here")
    parser.add_argument("--keep", action="store_true", help="keep the folders of failures")
    asked = parser.parse_args()
    results = []
    root = Path(tempfile.mkdtemp(prefix="faults-"))
    faults = draw(asked.count, asked.seed)[asked.skip :]
    if asked.kind:
        rng = random.Random(asked.seed)
        faults = [(k, rng.randrange(2**31)) for k in asked.kind for _ in range(asked.count)]
    for number, (name, seed) in enumerate(faults):
        folder = root / f"{number}-{name}"
        result = run_one(name, seed, folder)
        results.append(result)
        if not (asked.keep and result["problems"]):
            shutil.rmtree(folder, ignore_errors=True)
        if asked.log:
            with asked.log.open("a") as log:
                log.write(json.dumps(result) + "\n")
        if result["problems"]:
            sys.stderr.write(f"{number} {name} {seed}: {result['problems']}\n")
            sys.stderr.flush()
    sys.stdout.write(table(results) + "\n")
    return int(any(r["problems"] for r in results))


if __name__ == "__main__":
    sys.exit(main())
