"""`accelbench import`, `fit` and `compensate`: from logs and runs to models and their use."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
from rich.console import RenderableType

from accelbench.commands.fit.text import fit_document, fit_text
from accelbench.shell.console import emit, micro_g, number, table
from accelbench.shell.inputs import add_reading_counts, read_with_doubts
from accelbench.shell.outputs import Results, check_results, checked_run_output, with_sidecars
from accelbench.shell.progress import working
from accelbench.shell.recording_text import recording_document, recording_text
from errormodel.errors import InputError, NotSeparableError
from errormodel.io.tables import TABLE_SUFFIXES
from thermo.compensation.compensated_files import (
    CompensatedChannel,
    CompensatedFile,
    compensate_files,
)
from thermo.compensation.model_file import ModelFile, dump_model, make_model_file
from thermo.fitting.fit import AccelerometerFit, TermsFile, fit_runs, read_terms
from thermo.recording.files import RecordedRuns, write_runs
from thermo.recording.foreign.read import import_log
from thermo.recording.summary import summary_of
from thermo.recording.units_check import unit_complaints

BEFORE = "error before: with a constant bias and scale factor only, as the raw residual of fit"
MOVED_UG = 1e5  # a tenth of a g: no accelerometer at one input leaves so much
MOVED = (
    "no position is recorded, but the output changes as if the input had changed: the model does "
    "not describe this; add the column position_deg"
)
WORSE = (
    "the residual with the model is larger than with constants alone: the model does not "
    "describe these readings"
)
RUNS = click.argument("files", nargs=-1, required=True, metavar="RUN.csv…")


def import_(file: Path, map_file: Path, out: Path, force: bool, as_json: bool) -> None:
    """Carry out `accelbench import_`; the arguments are its options."""
    checked_run_output(out, [file, map_file], force=force)
    record = import_log(file, map_file)
    write_runs(record, out)
    summary = summary_of(record)
    document = {"out": str(out), **recording_document(summary)}
    emit(document, [f"{out}: {recording_text(summary)}"], as_json=as_json)


def fit(
    files: tuple[str, ...],
    terms: Path | None,
    holdout: tuple[str, ...],
    out: Path | None,
    report: Path | None,
    trust_units: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench fit`; the arguments are its options."""
    paths, wanted = _runs_and_ids(files, holdout)
    inputs = [*with_sidecars(paths), *([terms] if terms else [])]
    check_results(out, report, inputs, force=force)
    given = read_terms(terms) if terms else None
    record, doubts = read_with_doubts(paths, trust_units=trust_units)
    fits = _fit(record, given, wanted)
    model = make_model_file(fits)
    worse = [f"{f.serial}: {WORSE}" for f in fits if f.worse_than_none]
    worse += [f"{f.serial}: {MOVED}" for f in fits if _input_moved(f)]
    results = Results(fit_document(fits, model), [*fit_text(fits, model), *worse, *doubts])
    add_reading_counts(results.document, record, doubts)
    results.add_file("model file", out, lambda: dump_model(model))
    results.add_report(report, lambda: _report(fits, record, model))
    results.write(as_json=as_json)
    return 1 if doubts or worse else 0


def _input_moved(one: AccelerometerFit) -> bool:
    """Return whether an input that is not recorded cannot have been constant."""
    return not one.channel.has_input and one.summary.rms_ug > MOVED_UG


def _report(
    fits: Sequence[AccelerometerFit], record: RecordedRuns, model: ModelFile
) -> dict[str, bytes]:
    from accelbench.commands.fit.page import (  # matplotlib takes its second
        ReportExtras,
        render_report,
    )

    title = f"Temperature model of {', '.join(f.serial for f in fits):.80}"
    return render_report(fits, record, title=title, extras=ReportExtras(model=model))


def _fit(
    record: RecordedRuns, terms: TermsFile | None, holdout: tuple[str, ...]
) -> tuple[AccelerometerFit, ...]:
    """Fit; a complaint about an accelerometer is told with the files it stands in."""
    try:
        with working("fitting"):
            return fit_runs(record, terms=terms, holdout=holdout)
    except (InputError, NotSeparableError) as err:
        if str(err).startswith(record.source):
            raise
        raise InputError(record.source, "", str(err)) from None


def _runs_and_ids(
    files: tuple[str, ...], holdout: tuple[str, ...]
) -> tuple[list[Path], tuple[str, ...]]:
    """Sort the arguments: ``--holdout A B`` leaves B among the files, where it is none."""
    paths, more = list[Path](), list[str]()
    for name in files:
        is_file = Path(name).suffix.lower() in TABLE_SUFFIXES or Path(name).exists()
        if holdout and not is_file:
            more.append(name)
        else:
            paths.append(Path(name))
    return paths, (*holdout, *more)


def compensate(
    files: tuple[str, ...], model: Path, out: Path, trust_units: bool, force: bool, as_json: bool
) -> int:
    """Carry out `accelbench compensate`; the arguments are its options."""
    paths = [Path(name) for name in files]
    checked_run_output(out, [*with_sidecars(paths), model], force=force)
    done = compensate_files(paths, model, out, trust_units=trust_units)
    doubts = unit_complaints(done.runs) if trust_units else ()
    document = _compensated_document(done, out)
    add_reading_counts(document, done.runs, doubts)
    emit(document, [*_compensated_text(done, out), *doubts], as_json=as_json)
    return 1 if doubts else 0


def _compensated_document(done: CompensatedFile, out: Path) -> dict[str, object]:
    return {
        "out": str(out),
        "model_id": done.models.model_id,
        "readings": len(done.runs),
        "accelerometers": [
            {
                "serial": c.serial,
                "n_samples": c.n,
                "outside_range": c.outside_range,
                "outside_rate": c.outside_rate,
                "outside_input": c.outside_input,
                "error_before_ug": c.error_before_ug,
                "error_after_ug": c.error_after_ug,
                "sigma_ug": c.sigma_ug,
                "left_in_ug": c.left_in_ug,
                "run_to_run_known": c.run_to_run_known,
                "scale_left_ug": c.scale_left_ug,
            }
            for c in done.channels
        ],
    }


def _compensated_text(done: CompensatedFile, out: Path) -> list[RenderableType]:
    names = ("readings", "outside", "error before µg", "error after µg", "sigma µg")
    made = table("serial", *names, right=names)
    for c in done.channels:
        outside = c.outside_range + c.outside_rate + c.outside_input
        before, after = number(c.error_before_ug), number(c.error_after_ug)
        made.add_row(c.serial, str(c.n), str(outside), before, after, number(c.sigma_ug, 3))
    notes = [BEFORE, *(note for c in done.channels for note in _notes(c))]
    return [made, *notes, f"{out}: compensated with model {done.models.model_id}"]


def _notes(c: CompensatedChannel) -> Iterator[str]:
    """Tell what the table does not, of one accelerometer."""
    kinds = {
        "temperatures": c.outside_range, "rates": c.outside_rate, "forces": c.outside_input
    }  # fmt: skip
    beyond = [f"{count} {kind}" for kind, count in kinds.items() if count]
    if beyond:
        yield f"{c.serial}: the model does not cover {', '.join(beyond)}; the readings are flagged"
    if c.left_in_ug is not None:
        yield (
            f"{c.serial}: errors cannot be computed if the input is not recorded; without "
            f"positions, misalignment and cross-coupling are not compensated, up to "
            f"{micro_g(c.left_in_ug)} "
            "at 1 g across"
        )
    if c.scale_left_ug:
        yield (
            f"{c.serial}: K1 was taken as nominal at every temperature, and K0 includes its "
            f"error at the gravity of the fit: at the gravity here, each per cent of error or "
            f"temperature change of K1 leaves {micro_g(c.scale_left_ug)} at 1 g; the sigmas do "
            f"not include it"
        )
    if not c.run_to_run_known:
        yield (
            f"{c.serial}: the model file has no run-to-run component (one run, or an older "
            f"version): the sigmas do not include it"
        )
