"""The whole main job on emulated instruments, from the sequence file to the report."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from accelbench.commands.fit.page import ReportExtras, write_report
from accelbench.shell.outputs import prove_writable
from accelbench.shell.page import ReportTable
from drivers.clock import ScaledClock, SteppedClock
from errormodel.errors import InputError
from errormodel.io.atomic import write_files
from thermo.compensation.compensated_files import CompensatedFile, compensate_files
from thermo.compensation.model_file import ModelFile, dump_model, make_model_file
from thermo.fitting.fit import AccelerometerFit, fit_runs
from thermo.launch.emulated import run_emulated
from thermo.planning.sequence import Sequence as TestSequence
from thermo.planning.sequence import parse_sequence
from thermo.recording.files import RecordedRuns, read_runs
from thermo.station.checks.uniformity import RampVerdict, judge_test
from thermo.station.job import make_job
from thermo.station.outcome import Observer, TestOutcome
from thermo.store.files import export_recorded, open_existing_store

# What nobody fitting the data is told: the third accelerometer's bias lags behind its temperature.
HIDDEN: Mapping[str, Mapping[str, float]] = {
    "QA-003": {"bias_hysteresis": 20e-6, "bias_hysteresis_width": 12.0}
}
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemoResult:
    """Results of the demonstration; `outcome` alone when its test did not finish."""

    folder: Path
    outcome: TestOutcome
    seconds: float
    verdicts: tuple[RampVerdict, ...] = ()
    fits: tuple[AccelerometerFit, ...] = ()
    model: ModelFile | None = None
    compensated: CompensatedFile | None = None
    report: Path | None = None


def demo_sequence() -> TestSequence:
    """Return the sequence that the demonstration runs, as it is shipped."""
    file = resources.files("accelbench").joinpath("examples/sequences/demo.toml")
    return parse_sequence(file.read_text(encoding="utf-8"), "demo.toml")


def fresh_folder(parent: Path) -> Path:
    """Make the next numbered folder, 001 and so on; what is there is left alone.

    Raises
    ------
    InputError
        If it cannot be made, or nothing can be written there.
    """
    try:
        for k in range(1, 1_000_000):
            folder = parent / f"{k:03d}"
            if not folder.exists():
                prove_writable(folder / "store.sqlite")
                folder.mkdir(parents=True)
                return folder
    except InputError as err:
        raise InputError(parent, "", f"no folder can be made there: {err.problem}") from None
    except OSError as err:
        problem = f"no folder can be made there: {err.strerror or err}"
        raise InputError(parent, "", problem) from None
    raise InputError(parent, "", "is full")


def run_demo(
    folder: Path,
    *,
    sequence: TestSequence | None = None,
    speed: float | None = None,
    observers: Sequence[Observer] = (),
    tell: Tell = lambda _: None,
) -> DemoResult:
    """Run the sequence on emulated instruments, then fit, compensate and report.

    Parameters
    ----------
    folder : Path
        Where the store, the recorded run, the model, the compensated run and the report go.
    sequence : Sequence, optional
        By default the one shipped.
    speed : float, optional
        Multiple of real time; by default as fast as the machine can compute it.
    observers : sequence of Observer
        Of the test.
    tell : callable
        Told in a few words what is being done after the test.

    Returns
    -------
    DemoResult
    """
    began_s = time.monotonic()
    sequence = sequence or demo_sequence()
    store_path = folder / "store.sqlite"
    hidden = {a.serial: HIDDEN[a.serial] for a in sequence.accelerometers if a.serial in HIDDEN}
    job = make_job(sequence, store_path)
    outcome = run_emulated(
        job,
        effects=hidden,
        clock=SteppedClock() if speed is None else ScaledClock(speed),
        observers=observers,
    )
    ended = DemoResult(folder=folder, outcome=outcome, seconds=time.monotonic() - began_s)
    if outcome.status != "finished":
        return ended
    with open_existing_store(str(store_path)) as store:
        verdicts = judge_test(job.plan, store.readings(outcome.test_id))
        exported = export_recorded(store, outcome.test_id, folder / "run.csv")
    result = _evaluate(replace(ended, verdicts=verdicts), read_runs([exported[0].path]), tell)
    return replace(result, seconds=time.monotonic() - began_s)


def _evaluate(result: DemoResult, record: RecordedRuns, tell: Tell) -> DemoResult:
    """Fit, compensate and report what was exported to run.csv."""
    folder = result.folder
    tell("fitting")
    fits = fit_runs(record)
    model = make_model_file(fits)
    write_files([(folder / "model.json", dump_model(model).encode())])
    tell("compensating")
    compensated = compensate_files(
        [folder / "run.csv"], folder / "model.json", folder / "compensated.csv"
    )
    tell("drawing the report")
    report = write_report(
        fits,
        record,
        folder / "report",
        title=f"Temperature models of test {result.outcome.test_id}",
        extras=ReportExtras(model=model, tables=station_tables(result.outcome, result.verdicts)),
    )
    return replace(result, fits=fits, model=model, compensated=compensated, report=report)


def station_tables(
    outcome: TestOutcome, verdicts: Sequence[RampVerdict]
) -> tuple[ReportTable, ...]:
    """Return what a report says of the test that measured its runs."""
    passed = sum(v.passed for v in verdicts)
    safe = "verified by reading back" if outcome.safe.verified else "NOT VERIFIED"
    return (
        ReportTable(
            title="Uniformity of the ramps",
            columns=("accelerometer, run, ramp", "verdict"),
            rows=tuple(
                (f"{v.serial}, run {v.run}, segment {v.segment}", v.sentence.split(": ", 1)[1])
                for v in verdicts
            ),
            note=f"{passed} of {len(verdicts)} are uniform.",
        ),
        ReportTable(
            title="End of the test",
            columns=("what", "result"),
            rows=(
                ("test", f"{outcome.test_id}: {outcome.status}, {outcome.reason}"),
                (
                    "readings",
                    f"{outcome.readings} stored, {outcome.skipped} slots without a reading, "
                    f"{outcome.flagged} flagged",
                ),
                ("chamber's safe condition", safe),
                ("what was done", "; ".join(outcome.safe.steps)),
            ),
        ),
    )
