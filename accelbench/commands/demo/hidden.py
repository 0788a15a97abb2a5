"""A hidden effect through the instruments: measured, named from the files alone, and closed.

One emulated accelerometer of a station has an effect that nobody who reads its runs is told of.
The station measures all of them over real bytes, the search reads the recorded files, the larger
model is loaded into an emulated accelerometer beside the real one, and the next run compares them.
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np

from accelbench.commands.demo.hidden_bench import (
    Bench,
    TestEndedError,
    Units,
    Watch,
    hidden_sequence,
)
from accelbench.commands.demo.hidden_page import NextRun, hidden_report
from accelbench.commands.demo.steps import DemoSteps
from accelbench.commands.discrepancy.larger_model import (
    fitted_file,
    larger_terms,
    larger_toml,
    present_terms,
    shape_library,
    with_shapes,
)
from accelbench.commands.discrepancy.text import larger
from accelbench.shell.outputs import REPORT_NAME
from errormodel.io.atomic import write_files
from errormodel.io.python_file import PythonFile
from thermo.compensation.model_file import dump_model, read_model
from thermo.discrepancy.experiment import Experiment
from thermo.discrepancy.find import Discrepancy, find_discrepancy
from thermo.planning.sequence import Sequence as TestSequence
from thermo.planning.sequence import TestedAccelerometer, load_sequence
from thermo.recording.channel import channel_of
from thermo.recording.files import RecordedRuns, join_runs, read_runs
from thermo.station.outcome import TestOutcome
from thermo.twin.planted import (
    plain_accelerometer,
    plantable,
    simulated_by,
    size_in_words,
    who_has_it,
)
from thermo.twin.unknown import UNKNOWN

Tell = Callable[[str], None]
PRESENT, LARGER = "present model", "larger model"
# How long the steps take beside each other, as measured.
NIGHT, SEARCH, EXPERIMENT, NEXT_RUN = 24.0, 8.0, 30.0, 8.0
MOST_EXPERIMENTS = 2


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HiddenDemo:
    """Outcome of the demonstration.

    Attributes
    ----------
    folder : Path
    serial, effect, size : str
        The key: which accelerometer had what. Opened when the verdicts were there.
    first : tuple of Discrepancy
        The verdicts on the first test.
    experiments : tuple of Experiment
        Those proposed and carried out because a question was open.
    verdicts : tuple of Discrepancy
        The verdicts in the end.
    next_run : NextRun or None
        None when nothing was named.
    report : Path or None
    seconds : float
    failed : TestOutcome or None
        A test that did not finish.
    """

    folder: Path
    serial: str = ""
    effect: str = ""
    size: str = ""
    first: tuple[Discrepancy, ...] = ()
    experiments: tuple[Experiment, ...] = ()
    verdicts: tuple[Discrepancy, ...] = ()
    next_run: NextRun | None = None
    report: Path | None = None
    seconds: float = 0.0
    failed: TestOutcome | None = None

    @property
    def right(self) -> bool:
        """True when the accelerometer's effect alone was named, and of the others nothing.

        Of an effect that no library has: no name was given, and a shape was built.
        """
        said = {d.serial: [e.name for e in d.effects] for d in self.verdicts if not d.alias_sets}
        others = [d for d in self.verdicts if d.serial != self.serial]
        expected = [] if self.effect == UNKNOWN else [self.effect]
        built = self.serial in {d.serial for d in self.verdicts if d.shape is not None}
        return (
            said.get(self.serial) == expected
            and built == (self.effect == UNKNOWN)
            and all(d.verdict == "nothing" for d in others)
        )


def run_hidden_demo(
    folder: Path,
    effect: str | None,
    *,
    watch: Watch,
    sequence: TestSequence | None = None,
    seed: int = 1,
    tell: Tell = lambda _: None,
) -> HiddenDemo:
    """Hide an effect in an emulated accelerometer, and see whether it is found.

    Parameters
    ----------
    folder : Path
        Where everything goes: recorded runs, models, the proposed sequences, the report, the key.
    effect : str or None
        An effect of the library that has an example, or "unknown": one that is in no library.
    watch : callable
        Gives a test's observers, as a context.
    sequence : TestSequence, optional
        By default the one shipped.
    seed : int
        Draws the accelerometers, which of them has it, and the noise.
    tell : callable
        Told what is being done.

    Returns
    -------
    HiddenDemo

    Raises
    ------
    InputError
        If no accelerometer can have that effect.
    """
    planted, began_s = plantable(effect, seed), time.monotonic()
    assert effect is not None
    sequence = sequence or hidden_sequence()
    serials = tuple(a.serial for a in sequence.accelerometers)
    serial = who_has_it(effect, serials, seed)
    key = {"serial": serial, "effect": effect, "size": size_in_words(planted)}
    write_files([(folder / "key.json", json.dumps(key, ensure_ascii=False).encode())])
    units = {
        s: plain_accelerometer(s, planted if s == serial else None, seed=seed) for s in serials
    }
    try:
        made = _search(Bench(folder, watch, seed), units, sequence, tell)
    except TestEndedError as ended:
        made = HiddenDemo(folder=folder, failed=ended.outcome)
    opened = json.loads((folder / "key.json").read_text(encoding="utf-8"))
    return replace(made, **opened, seconds=time.monotonic() - began_s)


def _search(bench: Bench, units: Units, sequence: TestSequence, tell: Tell) -> HiddenDemo:
    """Measure, name, settle what is open, and close the gap."""
    steps = DemoSteps(tell, [NIGHT, *[SEARCH for _ in units], NEXT_RUN])
    steps.next(f"a night of {len(units)} accelerometers")
    runs = read_runs([bench.measure("run", sequence, units)])
    first: list[Discrepancy] = []
    verdicts: list[Discrepancy] = []
    experiments: list[Experiment] = []
    seen: dict[str, RecordedRuns] = {}
    for serial in units:
        steps.next(
            f"search for a missing effect in the model of {serial}, by the recorded file alone"
        )
        mine = runs.select(serial=serial)
        d = _found(mine, tell)
        settled, own, seen[serial] = _settled(bench, units, d, mine, steps)
        first.append(d)
        verdicts.append(settled)
        experiments += own
    made = HiddenDemo(
        folder=bench.folder,
        first=tuple(first),
        experiments=tuple(experiments),
        verdicts=tuple(verdicts),
    )
    steps.next("the next run compared with the models, and the report")
    found = [d for d in verdicts if larger(d)]
    if not found:
        return made
    strongest = max(found, key=_strength)
    next_run = _next_run(bench, units, sequence, strongest, seen[strongest.serial])
    files = hidden_report(verdicts, runs, next_run)
    write_files([(bench.folder / "report" / name, content) for name, content in files.items()])
    return replace(made, next_run=next_run, report=bench.folder / "report" / REPORT_NAME)


def _strength(d: Discrepancy) -> float:
    """Return how many of its own sigmas the first effect has, or the shape."""
    if d.effects:
        return d.effects[0].strength_d
    return float(np.sqrt(d.shape.pattern.shape.gain)) if d.shape else 0.0


def _found(runs: RecordedRuns, tell: Tell) -> Discrepancy:
    """Search one accelerometer's runs, on every processor there is."""
    # bare: what is hidden may be a term that a fit would choose by itself
    (d,) = find_discrepancy(
        runs, model="bare", workers=os.cpu_count() or 1, tell=lambda line: tell(f"  {line}")
    )
    return d


def _settled(
    bench: Bench, units: Units, d: Discrepancy, runs: RecordedRuns, steps: DemoSteps
) -> tuple[Discrepancy, list[Experiment], RecordedRuns]:
    """Carry out the experiments that a verdict proposes until it is no alias set."""
    done: list[Experiment] = []
    while d.verdict == "alias" and len(done) < MOST_EXPERIMENTS:
        proposed = d.experiment
        if proposed is None or proposed.sequence is None:
            break
        steps.add(EXPERIMENT)
        steps.next(f"{', '.join(d.alias_sets[0])} cannot be separated: {proposed.text}")
        name = f"next-{d.serial}-{len(done) + 1}"
        write_files([(bench.folder / f"{name}.toml", proposed.toml().encode())])
        # a record's sidecar is NAME.toml as well: it has another name than its sequence
        more = bench.measure(f"{name}-run", load_sequence(bench.folder / f"{name}.toml"), units)
        done.append(proposed)
        runs = join_runs([runs, read_runs([more])])
        d = _found(runs, steps.tell)
    return d, done, runs


def _shape_file(folder: Path, d: Discrepancy) -> PythonFile | None:
    """Write the library of a verdict's shape beside the models; None where there is none."""
    library = shape_library([d], folder / "larger_model.toml")
    if library is not None:
        write_files([(library.path, library.content)])
    return library


def _loaded_models(folder: Path, d: Discrepancy, runs: RecordedRuns) -> Units:
    """Write both models of an accelerometer, and return emulated ones made of their files."""
    models = {
        PRESENT: fitted_file(runs, [(d.serial, present_terms(d))]),
        LARGER: fitted_file(runs, [(d.serial, larger_terms(d))]),
    }
    paths = {name: folder / f"{name.replace(' ', '_')}.json" for name in models}
    write_files([(paths[n], dump_model(m).encode()) for n, m in models.items()])
    write_files([(folder / "larger_model.toml", larger_toml(d).encode())])
    return {name: simulated_by(read_model(path).of(d.serial)) for name, path in paths.items()}


def _next_run(
    bench: Bench, units: Units, sequence: TestSequence, d: Discrepancy, runs: RecordedRuns
) -> NextRun:
    """Measure the accelerometer once more, its two models emulated beside it."""
    one = next(a for a in sequence.accelerometers if a.serial == d.serial)
    with with_shapes(_shape_file(bench.folder, d)):
        loaded = _loaded_models(bench.folder, d, runs)
    together = sequence.model_copy(
        update={
            "accelerometers": tuple(
                TestedAccelerometer(serial=s, nominal_scale=one.nominal_scale)
                for s in (d.serial, *loaded)
            ),
            "temperature": sequence.temperature.model_copy(update={"repeats": 1}),
        }
    )
    path = bench.measure("next_run", together, {d.serial: units[d.serial], **loaded})
    channels = {s: channel_of(read_runs([path]), s) for s in (d.serial, *loaded)}
    measured = channels[d.serial]
    period_s = sequence.sampling.period_s
    slots = {s: np.round(c.record.time_s / period_s) for s, c in channels.items()}
    # a reading that any of the three lacks is left out
    shared = reduce(np.intersect1d, slots.values())
    rows = {s: np.isin(own, shared) for s, own in slots.items()}
    output = {s: np.asarray(c.record.output)[rows[s]] for s, c in channels.items()}
    gap_ug = {name: 1e6 * (output[d.serial] - output[name]) for name in loaded}
    return NextRun(
        serial=d.serial,
        time_h=measured.record.time_s[rows[d.serial]] / 3600.0,
        temp_c=measured.temp_c[rows[d.serial]],
        before_ug=gap_ug[PRESENT],
        after_ug=gap_ug[LARGER],
        floor_ug=d.floor_ug,
        predictive=d.heldout is None or d.heldout.predictive,
    )
