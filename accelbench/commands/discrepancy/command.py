"""`accelbench discrepancy`: find, name, add and verify the effect that a model lacks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from accelbench.commands.discrepancy.larger_model import model_files, model_lines, model_paths
from accelbench.commands.discrepancy.rig_command import discrepancy_rig
from accelbench.commands.discrepancy.text import discrepancy_document, discrepancy_text
from accelbench.shell.console import emit
from accelbench.shell.inputs import add_reading_counts, read_with_doubts, trust_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    REPORT_NAME,
    check_results,
    checked_output,
    force_option,
    json_option,
    with_sidecars,
)
from errormodel.errors import InputError
from errormodel.io.atomic import write_files
from thermo.compensation.model_file import read_model
from thermo.discrepancy.find import Discrepancy, find_discrepancy
from thermo.fitting.fit import TermsFile, read_terms
from thermo.recording.files import RecordedRuns

BARE = Path("bare")  # no file: k0 and k1, each quadratic in temperature


@click.command()
@click.argument("kind", type=click.Choice(["thermal", "rig"]), metavar="thermal|rig")
@click.argument("files", nargs=-1, required=True, metavar="RUN.csv…", type=Path)
@click.option(
    "--model",
    type=Path,
    help="The present model: TERMS.toml, MODEL.json of a fit, or bare; of a rig, MODEL.toml.",
)
@click.option("--out", type=Path, help="MODEL.toml, the larger model; MODEL.json beside it.")
@click.option("--report", type=Path, help="Folder for the report and its figures.")
@click.option("--experiment-out", type=Path, help="SEQUENCE.toml of the experiment proposed.")
@click.option("--seed", type=int, default=1, help="Of the simulated nulls.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Threads that simulate them; the verdict is the same.",
)
@trust_option
@force_option
@library_option("--effects")
@json_option
def discrepancy(
    kind: str,
    files: tuple[Path, ...],
    model: Path | None,
    out: Path | None,
    report: Path | None,
    experiment_out: Path | None,
    seed: int,
    workers: int,
    trust_units: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Find where runs and model disagree, and name the effect that is missing.

    Without --model the present model is the equation that fit would choose, with --model bare k0
    and k1, each quadratic in temperature; of a SINS on a rig, biases, scale errors and
    misalignments. In Python: accelbench.discrepancy,
    accelbench.rig.discrepancy.
    """
    if kind == "rig":
        thermal_only = {"--experiment-out": experiment_out, "--workers": workers > 1}
        for name, value in thermal_only.items():
            if value:
                raise InputError("discrepancy rig", name, "belongs to discrepancy thermal only")
        discrepancy_rig(files, model, out, report, seed=seed, force=force, as_json=as_json)
        return 0
    given = [p for p in (model,) if p and p != BARE]
    inputs = [*with_sidecars(list(files)), *given]
    for path in (p for p in (out, experiment_out) if p):
        checked_output(path, inputs, force=force)
    check_results(None, report, [], force=force)
    runs, doubts = read_with_doubts(list(files), trust_units=trust_units)
    for path in model_paths(out, len(runs.serials))[1:] if out is not None else ():
        checked_output(path, inputs, force=force)
    found = find_discrepancy(runs, model=_present(model), seed=seed, workers=workers, tell=_tell)
    document, text = discrepancy_document(found), [*discrepancy_text(found), *doubts]
    add_reading_counts(document, runs, doubts)
    written: list[tuple[Path, bytes]] = []
    if out is not None:
        written += model_files(runs, found, out)
        document["out"] = str(out)
        text += model_lines(found, out)
    if experiment_out is not None:
        proposed = _experiment_file(found, experiment_out)
        written += proposed
        document["experiment_out"] = str(experiment_out) if proposed else None
        text.append(
            f"experiment: {experiment_out}"
            if proposed
            else "nothing is open that an experiment would settle: none written"
        )
    if report is not None:
        written += _report_files(found, runs, report)
        document["report"] = str(report / REPORT_NAME)
        text.append(f"report: {report / REPORT_NAME}")
    write_files(written)
    emit(document, text, as_json=as_json)
    return 1 if doubts else 0


def _tell(line: str) -> None:
    click.echo(line, err=True)


def _present(path: Path | None) -> TermsFile | Literal["bare"] | None:
    """Read the present model: a list of terms, or the terms of a fitted model."""
    if path is None:
        return None
    if path == BARE:
        return "bare"
    if path.suffix.lower() != ".json":
        return read_terms(path)
    first = read_model(path).accelerometers[0]
    return TermsFile(terms=first.terms, t_ref_c=first.t_ref_c)


def _experiment_file(found: Sequence[Discrepancy], path: Path) -> list[tuple[Path, bytes]]:
    """Return the experiment of an alias set, else the first there is."""
    open_first = sorted(found, key=lambda d: d.verdict != "alias")
    proposed = [d.experiment for d in open_first if d.experiment and d.experiment.sequence]
    return [(path, proposed[0].toml().encode())] if proposed else []


def _report_files(
    found: tuple[Discrepancy, ...], runs: RecordedRuns, folder: Path
) -> list[tuple[Path, bytes]]:
    from accelbench.commands.discrepancy.page import (
        render_discrepancy,  # matplotlib takes its second
    )

    pages = render_discrepancy(found, runs)
    return [(folder / name, content) for name, content in pages.items()]
