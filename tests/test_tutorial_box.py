"""The tutorial from a box of accelerometers to a SINS is executed, and its figures are true."""

import json
import re
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from accelbench.cli import main
from sinscal.recording.files import read_rig_run

FOLDER = Path(__file__).parents[1] / "docs/tutorial"
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+−]?\d+)?")
# Emulated instruments are seeded and their time is stepped; what differs between machines is
# rounding, which decides a last digit.
SAME = 0.01


@dataclass(frozen=True)
class Step:
    """A command of the tutorial and what the tutorial says it prints."""

    words: list[str]
    printed: list[str]


def steps_of(text: str) -> list[Step]:
    """Return the indented blocks that begin with a command."""
    blocks = re.findall(r"(?:^ {4}.*\n)+", text, re.MULTILINE)
    lines = [[line[4:] for line in block.splitlines()] for block in blocks]
    return [Step(shlex.split(b[0])[1:], b[1:]) for b in lines if b[0].startswith("accelbench ")]


def numbers(line: str) -> list[float]:
    return [float(n.replace("−", "-")) for n in NUMBER.findall(line)]


def agrees(told: str, found: str) -> bool:
    """Whether two lines have the same words, and numbers that differ by rounding at most.

    "…" in the tutorial stands for anything.
    """
    if "…" in told:
        return re.fullmatch(".+".join(map(re.escape, told.split("…"))), found) is not None
    if NUMBER.sub("#", told).split() != NUMBER.sub("#", found).split():
        return False
    return np.allclose(numbers(told), numbers(found), rtol=SAME, atol=1e-9)


@pytest.mark.slow  # those of tests/test_docs.py and tests/test_from_python.py run by default
@pytest.mark.timeout(900)  # 40 s of computing, on a machine that does a dozen things besides
def test_the_tutorial_runs_and_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for one in FOLDER.glob("box-*.toml"):
        shutil.copy(one, tmp_path)
    monkeypatch.chdir(tmp_path)
    steps = steps_of((FOLDER / "box-to-sins.md").read_text(encoding="utf-8"))
    assert [s.words[0] for s in steps] == [
        "run", "stability", "fit", "rig", "combine", "rig", "combine"
    ]  # fmt: skip
    for step in steps:
        wrong = any(line.startswith("contradiction") for line in step.printed)
        assert main(step.words) == (1 if wrong else 0), step.words
        found = [line.strip() for line in capsys.readouterr().out.splitlines()]
        lost = [t for t in step.printed if not any(agrees(t.strip(), f) for f in found)]
        assert lost == [], f"{step.words}: not printed"
    for report in ("stability", "fit", "combined"):
        assert (tmp_path / report / "report.html").stat().st_size > 100_000  # with its pictures
    judge_estimates()
    judge_compensated()


def judge_estimates() -> None:
    """All parameters within five of their sigmas of the truth that was put in."""
    truth = json.loads(Path("truth.json").read_text(encoding="utf-8"))["parameters"]
    made = json.loads(Path("flight.json").read_text(encoding="utf-8"))["parameters"]
    for name, one in made.items():
        # a term that the truth does not have is zero in it
        true = truth.get(name, {"value": 0.0, "unit": one["unit"]})
        assert one["unit"] == true["unit"], name
        assert abs(one["value"] - true["value"]) < 5.0 * one["sigma"], name


def judge_compensated() -> None:
    """What the tutorial says of the force: thousands of µg before, 2 µg afterwards."""
    before, after = read_rig_run("rig.csv"), read_rig_run("corrected.csv", physics=False)
    g = before.facts.site.gravity_m_s2
    off = {
        name: [
            (float(np.linalg.norm(run.accel[rows], axis=1).mean()) - g) / 9.80665e-6
            for rows in run.cycles
        ]
        for name, run in (("before", before), ("after", after))
    }
    np.testing.assert_allclose(off["before"], [-9801, 6438, -7777], rtol=SAME)
    assert np.max(np.abs(off["after"])) < 3.0
