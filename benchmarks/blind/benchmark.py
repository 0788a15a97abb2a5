"""The blind benchmark: write data sets, let the workflow answer, only then open the keys.

    python -m benchmarks.blind.benchmark --part full --work build/hidden
    python -m benchmarks.blind.benchmark --kind rig --work build/hidden-rig

Each data set is answered by `accelbench discrepancy KIND FILE --json` in a process of its own,
which is given a folder without keys. A set already answered is not run again; with `--minutes` the
run ends in time and goes on when called again. Exit 1 when an acceptance rate is not reached.
"""

import argparse
import json
import math
import secrets
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.chamber.answering import ask_workflow
from benchmarks.blind.chamber.plan import PARTS
from benchmarks.blind.chamber.truth import write_set
from benchmarks.blind.rig.plan import RIG_PARTS
from benchmarks.blind.rig.scoring import RIG
from benchmarks.blind.rig.sets import write_rig_set
from benchmarks.blind.scoring import Scored, score
from benchmarks.blind.summary import THERMAL, Subject, page, picture, table

ROOT = Path(__file__).parents[2]
FIXED_SEED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One of the workflows: its data sets, who writes them, and how its page is called."""

    name: str
    parts: Mapping[str, Callable[[], Sequence[Any]]]
    write: Callable[[Path, Path, Any, Sequence[int]], object]
    subject: Subject
    page: str
    options: tuple[str, ...] = ()  # of the command


# what is hidden is what lacks beside bias and scale factor alone: K2 and orders as well
BARE = ("--model", "bare")

CHAMBER = Kind(
    name="thermal",
    parts=PARTS,
    write=write_set,
    subject=THERMAL,
    page="hidden-effects",
    options=BARE,
)
RIGS = Kind(
    name="rig", parts=RIG_PARTS, write=write_rig_set, subject=RIG, page="hidden-rig-effects"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """Where data, keys and answers of a benchmark lie, and whose answers they are."""

    work: Path
    recipes: Sequence[Any]
    seed: int
    kind: Kind = CHAMBER
    program: Path = ROOT

    def name(self, number: int) -> str:
        return f"set-{number:04d}"

    def folder(self, number: int) -> Path:
        return self.work / "data" / self.name(number)

    def key(self, number: int) -> Path:
        return self.work / "keys" / f"{self.name(number)}.json"

    def answer(self, number: int) -> Path:
        return self.work / "answers" / f"{self.name(number)}.json"

    def write(self, number: int) -> None:
        """Write a data set and its key."""
        recipe = self.recipes[number]
        self.kind.write(self.folder(number), self.key(number), recipe, [self.seed, number])

    def ask(self, number: int) -> None:
        """Let the workflow answer; what it may read is the one folder."""
        self.answer(number).parent.mkdir(parents=True, exist_ok=True)
        kind = self.kind
        answer = ask_workflow(self.folder(number), self.program, *kind.options, kind=kind.name)
        unfinished = self.answer(number).with_suffix(".part")
        unfinished.write_text(json.dumps(answer), encoding="utf-8")
        unfinished.rename(self.answer(number))

    def answered(self) -> list[int]:
        """Return the numbers of the sets that have been answered."""
        return [k for k in range(len(self.recipes)) if self.answer(k).exists()]

    def scored(self, numbers: Sequence[int]) -> list[Scored]:
        """Open the keys of some sets."""
        unanswered = [self.name(k) for k in numbers if not self.answer(k).exists()]
        if unanswered:
            raise RuntimeError(f"the keys stay closed: no answer yet to {unanswered[0]}")
        return [
            score(
                self.name(k),
                json.loads(self.key(k).read_text(encoding="utf-8")),
                json.loads(self.answer(k).read_text(encoding="utf-8")),
            )
            for k in numbers
        ]


def work_through(
    pool: Executor, job: Callable[[int], None], numbers: Sequence[int], what: str
) -> None:
    """Do a job for all numbers; progress and the time left go to stderr."""
    begin = time.perf_counter()
    futures = [pool.submit(job, number) for number in numbers]
    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        left = (time.perf_counter() - begin) / done * (len(futures) - done)
        sys.stderr.write(f"\r{what}: {done} of {len(futures)}, {left:.0f} s left ")
        sys.stderr.flush()
    if numbers:
        sys.stderr.write("\n")


def run(bench: Bench, *, workers: int = 2, minutes: float = math.inf) -> list[Scored]:
    """Write what is not written, ask what is not answered, and score what is answered.

    Sets are asked in a shuffled order, so that those answered in a limited time are of all kinds;
    after `minutes` no further set is asked, and its key stays closed.
    """
    end = time.perf_counter() + 60 * minutes
    numbers = np.random.default_rng(0).permutation(len(bench.recipes)).tolist()
    _same_benchmark(bench)

    def ask_in_time(number: int) -> None:
        if time.perf_counter() < end:
            bench.ask(number)

    with ProcessPoolExecutor(workers) as pool:
        missing = [k for k in numbers if not bench.key(k).exists()]
        work_through(pool, bench.write, missing, "written")
    with ThreadPoolExecutor(workers) as pool:  # each thread waits for a process of its own
        missing = [k for k in numbers if not bench.answer(k).exists()]
        work_through(pool, ask_in_time, missing, "answered")
    return bench.scored(bench.answered())


def _same_benchmark(bench: Bench) -> None:
    """Refuse to mix two benchmarks in one folder."""
    path = bench.work / "benchmark.json"
    mine = {"seed": bench.seed, "sets": len(bench.recipes)}
    if path.exists() and (there := json.loads(path.read_text(encoding="utf-8"))) != mine:
        raise SystemExit(f"{bench.work} holds another benchmark ({there}); name another --work")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(mine), encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Blind benchmark of `discrepancy`.")
    kinds = {kind.name: kind for kind in (CHAMBER, RIGS)}
    parser.add_argument("--kind", choices=list(kinds), default=CHAMBER.name)
    parser.add_argument("--part", choices=list(PARTS), default="full")
    parser.add_argument("--work", type=Path, help="by default build/hidden-KIND")
    parser.add_argument("--program", type=Path, default=ROOT, help="root of what is to answer")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=math.inf, help="ask no longer than this")
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--seed", type=int, default=FIXED_SEED)
    seeds.add_argument("--fresh", action="store_true", help="seeds that nobody has seen")
    parser.add_argument("--docs", type=Path, help="folder in which to write page and picture")
    asked = parser.parse_args(argv)
    kind = kinds[asked.kind]
    bench = Bench(
        work=(asked.work or ROOT / f"build/hidden-{kind.name}").resolve(),
        recipes=kind.parts[asked.part](),
        kind=kind,
        seed=secrets.randbits(32) if asked.fresh else asked.seed,
        program=asked.program.resolve(),
    )
    sets = run(bench, workers=asked.workers, minutes=asked.minutes)
    subject = kind.subject
    sys.stdout.write(table(sets, subject) + "\n")
    if asked.docs:
        (asked.docs / f"pictures/{kind.page}.png").write_bytes(picture(sets, subject))
        told = asked.docs / f"explanation/{kind.page}.md"
        told.write_text(page(sets, subject), encoding="utf-8")
    return 0 if all(rate.met is not False for rate in subject.acceptance(sets)) else 1


if __name__ == "__main__":
    sys.exit(main())
