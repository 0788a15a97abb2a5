"""What one spoiled reading in a hundred changes in what the commands say.

    PYTHONPATH=. .venv/bin/python benchmarks/bench_spoiled.py build/spoiled.jsonl
    PYTHONPATH=. .venv/bin/python benchmarks/bench_spoiled.py build/spoiled.jsonl --commands fit

Every way of spoiling (`tests/thermo/recording/readings_examples.py`) against `fit`, `stability`
and `discrepancy`, 20 recordings of each. Each comparison is a line of JSON that is written when it
is done: begun again, the study goes on after those that are there. At the end, or with --table
alone, the table is told.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

import argparse
import json
import logging
from pathlib import Path
from typing import Any

import pandas as pd

from tests.thermo.recording.readings_examples import WAYS
from tests.thermo.recording.spoiled import COMMANDS, Answer, change, original, read_again

BEYOND = 0.1  # sigma, over what losing the readings costs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--commands", nargs="+", choices=tuple(COMMANDS), default=tuple(COMMANDS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="Seed of the first recording.")
    parser.add_argument("--table", action="store_true", help="Tell what is there, ask nothing.")
    asked = parser.parse_args()
    logging.disable(logging.WARNING)  # each reading left out
    if not asked.table:
        for command in asked.commands:
            for seed in range(asked.first, asked.first + asked.seeds):
                go_on(asked.file, command, seed)
    print(table(lines(asked.file)))


def lines(file: Path) -> list[dict[str, Any]]:
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def go_on(file: Path, command: str, seed: int) -> None:
    """Ask a command about a recording spoiled in every way that is not in the file yet."""
    done = {(line["command"], line["way"], line["seed"]) for line in lines(file)}
    clean: Answer | None = None
    for way in WAYS:
        if (command, way, seed) in done:
            continue
        clean = clean or COMMANDS[command](read_again(original(seed)))
        found = change(command, way, seed, clean)
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(found.line(), ensure_ascii=False) + "\n")


def table(found: list[dict[str, Any]]) -> str:
    """Return a line for each command and way."""
    every = pd.DataFrame(found)
    every["other_verdict"] = every["clean"] != every["got"]
    every["too_far"] = every["beyond_sigma"] > BEYOND
    by = every.groupby(["command", "way"], sort=False)
    told = pd.DataFrame(
        {
            "seeds": by.size(),
            "spoiled": by["spoiled"].sum(),
            "not_found": by["not_found"].sum(),
            "sound_flagged_%": 100 * by["sound_flagged"].sum() / by["readings"].sum(),
            "rms_sigma": by["rms_sigma"].mean(),
            "max_sigma": by["max_sigma"].max(),
            "lost_sigma": by["lost_sigma"].mean(),
            "beyond_sigma": by["beyond_sigma"].max(),
            "other_verdict": by["other_verdict"].sum(),
            "not_of_loss": by["same_without"].apply(lambda same: int((~same).sum())),
        }
    )
    return told.round(4).to_string()


if __name__ == "__main__":
    main()
