"""Write sets, ask the command about each as a black box, and record what it said.

    python -m benchmarks.blind.second.run --sets all --seeds 0:310 --out answers.jsonl --workers 2

A seed that OUT.jsonl holds is not asked again. Where the command wrote a larger model, the unseen
run is compensated with it, by the command as well, and what it is off by is recorded.
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.second.files import write_set
from benchmarks.blind.second.plan import ASKED, seeds_of

ROOT = Path(__file__).parents[3]
LIMIT_S = 3600.0  # of one answer: another program may hold the processor
# the command, and the processor's time: the clock's is that of all who share the machine
ENTRY = """
import atexit, sys, time
atexit.register(lambda: sys.stderr.write(f"\\ncpu_s {time.process_time():.3f}\\n"))
from accelbench.cli import main
sys.exit(main(sys.argv[1:]))
"""


def command(folder: Path, program: Path, *words: str) -> dict[str, Any]:
    """Run `accelbench` in a folder; return `json`, `exit`, `stderr` (its end), `cpu_s`."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(program),
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    asked = [sys.executable, "-c", ENTRY, *words, "--json"]
    try:
        done = subprocess.run(
            asked,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"json": None, "exit": None, "stderr": f"no answer in {LIMIT_S:g} s", "cpu_s": None}
    try:
        document = json.loads(done.stdout)
    except json.JSONDecodeError:
        document = None
    said, _, seconds = done.stderr.rpartition("\ncpu_s ")
    return {
        "json": document,
        "exit": done.returncode,
        "stderr": said[-1000:],
        "cpu_s": float(seconds) if seconds.strip() else None,
    }


def ask(seed: int, program: Path, work: Path) -> dict[str, Any]:
    """Write a set, ask, compensate the unseen run; return all as one record."""
    folder, keys = work / f"set-{seed:05d}", work / f"key-{seed:05d}"
    try:
        key = write_set(seed, folder, keys)
        options = [*key["options"], "--out", "larger.toml"]
        answer = command(folder, program, "discrepancy", "thermal", "run.csv", *options)
        off = _unseen_ug(folder, keys, program, key)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(keys, ignore_errors=True)
    document: dict[str, Any] = answer["json"] or {}
    for part in (document, *document.get("accelerometers", ())):
        part.pop("smallest_nameable", None)  # long, and not scored
    return {"seed": seed, "key": key, "answer": answer, "unseen_ug": off}


def _unseen_ug(
    folder: Path, keys: Path, program: Path, key: dict[str, Any]
) -> dict[str, float] | None:
    """Return what the larger model leaves on the unseen run, `rms` and `mean`; None without one."""
    carrier = next(k for k, a in enumerate(key["accelerometers"]) if a["carrier"])
    of_its_own = folder / f"larger-{carrier + 1}.json"
    model = of_its_own if of_its_own.exists() else folder / "larger.json"
    if not model.exists():
        return None
    for name in ("unseen.csv", "unseen.toml"):
        shutil.copy(keys / name, folder / name)
    words = ["compensate", "unseen.csv", "--model", model.name, "--out", "after.csv"]
    for own in sorted(folder.glob("*.py")):  # effects that the command wrote for itself
        words += ["--library", own.name]
    command(folder, program, *words)
    after = folder / "after.csv"
    if not after.exists():
        return None
    with after.open(encoding="utf-8") as lines:
        rows = [r for r in csv.DictReader(lines) if not r.get("flag")]
    if not rows:
        return None
    told = np.array([float(r["accel_compensated_g"]) for r in rows])
    angle = np.radians([float(r["position_deg"]) for r in rows])
    off = 1e6 * (told - np.sin(angle))
    return {"rms": float(np.sqrt(np.mean(off**2))), "mean": float(off.mean())}


def answered(out: Path) -> set[int]:
    """Return the seeds that a file of answers holds."""
    if not out.exists():
        return set()
    return {json.loads(line)["seed"] for line in out.read_text(encoding="utf-8").splitlines()}


def run(seeds: Sequence[int], out: Path, *, workers: int = 1, program: Path = ROOT) -> None:
    """Ask about all seeds that are not answered; a record a line, as they come.

    They are asked in a shuffled order, so that what is answered in a limited time is of all kinds.
    """
    there = answered(out)
    shuffled = np.random.default_rng(0).permutation(seeds).tolist()
    missing = [seed for seed in shuffled if seed not in there]
    out.parent.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as work,
        ThreadPoolExecutor(workers) as pool,
        out.open("a", encoding="utf-8") as lines,
    ):
        futures = [pool.submit(ask, seed, program, Path(work)) for seed in missing]
        for number, future in enumerate(as_completed(futures), 1):
            lines.write(json.dumps(future.result()) + "\n")
            lines.flush()
            sys.stderr.write(f"\r{number} of {len(missing)} ")
    if missing:
        sys.stderr.write("\n")


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Second blind benchmark of `discrepancy thermal`.")
    parser.add_argument("--sets", choices=list(ASKED), default="all")
    parser.add_argument("--seeds", default="0:310", help="A:B, B left out")
    parser.add_argument("--out", type=Path, required=True, help="answers, JSON lines")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--program", type=Path, default=ROOT, help="root of what is to answer")
    asked = parser.parse_args(argv)
    first, end = (int(word) for word in asked.seeds.split(":"))
    seeds = seeds_of(asked.sets, first, end)
    run(seeds, asked.out, workers=asked.workers, program=asked.program.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
