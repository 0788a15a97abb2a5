"""What one spoiled reading in a hundred changes in the answers of the commands.

A recording is written to a file as it was measured and once more spoiled; both are read and given
to the command's twin in Python. The recordings are in turn of three kinds, so that there is more
than one verdict to keep: nothing hidden, a loop, and runs that differ.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from accelbench import api
from accelbench.result import named_rows
from tests.thermo.recording.readings_examples import WAYS, clean, recorded
from thermo.discrepancy.find import find_discrepancy
from thermo.recording.files import RecordedRuns, read_runs, write_runs
from thermo.stability.limits import CoefficientLimits, GradeLimits, LimitsFile

KINDS: tuple[dict[str, Any], ...] = ({}, {"loop_ug": 20.0}, {"offsets_ug": (0.0, 60.0)})
# Far from what the runs show, so that no verdict is at its margin: two runs that do not differ by
# more than 1 µg and 2.5 ppm are known not to by 50 µg and 100 ppm, two 60 µg apart to differ by 19
# to 1400 µg. So there are "pass" and "undecided", and two grades.
LIMITS = LimitsFile(
    limits={"k0": CoefficientLimits(sigma_run=100.0), "k1": CoefficientLimits(sigma_run=300.0)},
    grades={"A": GradeLimits(spread_ug=100.0), "B": GradeLimits(spread_ug=3000.0)},
)
DRAWS = 80  # simulated nulls: what is hidden is far beyond luck


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a command says: a verdict, and values with their sigmas by name."""

    verdict: tuple[Any, ...]
    values: Mapping[str, tuple[float, float]]


def fit(runs: RecordedRuns) -> Answer:
    """Ask for the coefficients; the verdict is which there are, and what is said to be left."""
    one = api.fit(runs).document["accelerometers"][0]
    values = {row["name"]: (row["value"], row["sigma"]) for row in named_rows(one["coefficients"])}
    verdict = (*values, one["thermal_history_left"], one["higher_order_helps"])
    return Answer(verdict=verdict, values=values)


def stability(runs: RecordedRuns) -> Answer:
    """Ask how the runs differ; the verdict has the grade, and which coefficients move and how."""
    result = api.stability(runs, limits=LIMITS)
    one = result.found.accelerometers[0]
    values = {
        f"{name} of run {run['run']}": (run["value"], run["sigma"])
        for name, c in result.document["accelerometers"][0]["coefficients"].items()
        for run in c["by_run"]
    }
    moved = [(p.coefficient, p.kind, p.run_id) for p in one.patterns]
    verdict = (one.verdict, one.grade, one.grade_best, *one.trends, *moved, one.loops_differ)
    return Answer(verdict=verdict, values=values)


def discrepancy(runs: RecordedRuns) -> Answer:
    """Ask what the model lacks; the values are the sizes of what is named."""
    (one,) = find_discrepancy(runs, draws=DRAWS)
    values = {
        f"{effect.name} {name}": (p.value, p.sigma)
        for effect in one.effects
        for name, p in effect.parameters.items()
    }
    names = [effect.name for effect in one.effects]
    return Answer(verdict=(one.verdict, *names, *one.alias_sets), values=values)


COMMANDS: Mapping[str, Callable[[RecordedRuns], Answer]] = {
    f.__name__: f for f in (fit, stability, discrepancy)
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What spoiling a recording in one way changed in one command's answer.

    Attributes
    ----------
    command, way : str
    seed : int
    readings, spoiled, not_found, sound_flagged : int
        Of the recording.
    clean, got : str
        The verdicts.
    rms_sigma, max_sigma : float
        Of the values against those of the clean recording, in their sigmas there.
    lost_sigma : float
        What losing so many readings costs in the root mean square: √(p/(1 − p)) of a sigma for a
        share p; no method can come closer to the clean recording.
    beyond_sigma : float
        The largest change against the clean recording without the readings left out.
    same_without : bool
        Whether the verdict is that of the clean recording without the readings left out.
    """

    command: str
    way: str
    seed: int
    readings: int
    spoiled: int
    not_found: int
    sound_flagged: int
    clean: str
    got: str
    rms_sigma: float
    max_sigma: float
    lost_sigma: float
    beyond_sigma: float
    same_without: bool

    def line(self) -> dict[str, Any]:
        """Return it as a line of JSON has it."""
        return asdict(self)


def read_again(frame: pd.DataFrame) -> RecordedRuns:
    """Write a recording to a file, whatever its readings are, and read it as the commands do."""
    with TemporaryDirectory() as name:
        path = Path(name) / "run.csv"
        write_runs(recorded(clean(0)), path)  # for its sidecar
        frame.to_csv(path, index=False)
        return read_runs([path])


def original(seed: int) -> pd.DataFrame:
    """Return a recording of the kind that its seed has."""
    return clean(seed, **KINDS[seed % len(KINDS)])


def change(command: str, way: str, seed: int, clean_answer: Answer) -> Change:
    """Spoil a recording and ask a command again.

    Parameters
    ----------
    command, way : str
    seed : int
    clean_answer : Answer
        The command's, of the recording as measured.

    Returns
    -------
    Change
    """
    ask = COMMANDS[command]
    before = original(seed)
    after = WAYS[way](before, np.random.default_rng([seed, list(WAYS).index(way)]))
    touched = (
        (before["temp_c"] != after["temp_c"]) | (before["output"] != after["output"])
    ).to_numpy()
    runs = read_again(after)
    got, good = ask(runs), runs.good
    # with every spoiled reading left out, what is kept is what was measured: the same answer
    without = ask(read_again(before).take(good)) if (touched & good).any() else got
    off = _sigmas(clean_answer, got)
    share = 1.0 - float(good.mean())
    return Change(
        command=command,
        way=way,
        seed=seed,
        readings=len(runs),
        spoiled=int(touched.sum()),
        not_found=int((touched & good).sum()),
        sound_flagged=int((~touched & ~good).sum()),
        clean=str(clean_answer.verdict),
        got=str(got.verdict),
        rms_sigma=float(np.sqrt(np.mean(off**2))) if off.size else 0.0,
        max_sigma=float(np.abs(off).max(initial=0.0)),
        lost_sigma=float(np.sqrt(share / (1.0 - share))),
        beyond_sigma=float(np.abs(_sigmas(without, got)).max(initial=0.0)),
        same_without=without.verdict == got.verdict,
    )


def _sigmas(one: Answer, other: Answer) -> np.ndarray:
    """Return by how many sigmas the values that both give differ, where they have sigmas."""
    pairs = [(one.values[n], other.values[n]) for n in one.values if n in other.values]
    off = np.array([(b - a) / sigma for (a, sigma), (b, _) in pairs])
    return off[np.isfinite(off)]
