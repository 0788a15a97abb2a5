"""`accelbench rig simulate` and `rig covariance`: a rig test before there is one."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import RenderableType

from accelbench.commands.rig_plan.text import (
    analysis_document,
    analysis_text,
    article_document,
    article_text,
)
from accelbench.joint.chambers import emulated_chamber, three_serials
from accelbench.joint.result_file import told_truth
from accelbench.shell.console import emit
from accelbench.shell.outputs import (
    Results,
    check_results,
    checked_output,
    checked_run_output,
)
from accelbench.shell.progress import working
from errormodel.errors import InputError
from errormodel.io.atomic import write_files
from errormodel.io.toml import read_text
from errormodel.progress import track
from sinscal.article.tables import BEST, LITERAL, ArticleAnalysis, ArticleTables
from sinscal.calibration.rig import Mode
from sinscal.model.priors import PriorFile, read_priors
from sinscal.planning.advice import Advice, analyse_programme
from sinscal.planning.covariance import RigCovariance
from sinscal.recording.files import write_rig_run
from sinscal.twin.programme import article_programme
from sinscal.twin.rehearse import Rehearsal, drawn_errors, groups_of, rehearse, sensors_with
from sinscal.twin.rig_file import RecordingTable, RigFile, TemperatureTable, read_rig_file

RANDOM = "random"

priors_option = click.option("--priors", type=Path, help="PRIORS.toml: prior sigmas and means.")


def _groups(text: str | None) -> tuple[str, ...]:
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())


groups_option = click.option(
    "--groups",
    metavar="A,B",
    help="Groups of errors in addition to biases, scale errors and misalignments.",
)


def simulate(
    programme: Path,
    out: Path,
    errors: str | None,
    truth: Path | None,
    seed: int,
    angle: bool | None,
    rate_hz: float | None,
    increments: bool | None,
    accelerometers: str | None,
    self_heating: bool,
    groups: str | None,
    priors: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Carry out `accelbench simulate`; the arguments are its options."""
    given = Path(errors) if errors and errors != RANDOM else None
    inputs = [p for p in (programme, given, priors) if p is not None]
    checked_run_output(out, inputs, force=force)
    if truth is not None:
        checked_output(truth, [*inputs, out], force=force)
    changes = {"angle": angle, "rate_hz": rate_hz, "increments": increments}
    file = _changed(read_rig_file(programme), changes, self_heating=self_heating)
    if given is not None:
        values = _read_errors(given)
    elif errors == RANDOM:
        values = _drawn(file, groups, read_priors(priors) if priors else None, seed)
    else:
        values = dict(file.errors)
    source = str(given or programme)
    mounted = three_serials(accelerometers) if accelerometers else []
    chambers = [emulated_chamber(serial) for serial in mounted]
    made = rehearse(file, values, seed=seed, source=source, accelerometers=chambers)
    document = _simulated(made, file, seed, out)
    write_rig_run(made.run, out, increments=file.recording.increments)
    if truth is not None:
        content = json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False) + "\n"
        write_files([(truth, content.encode())])
    text = (
        f"{out}: {document['cycles']} cycles, {document['rows']} rows of {len(made.values)} "
        f"errors at {file.recording.rate_hz:g} Hz, seed {seed}, {out.stat().st_size / 1e6:.3g} MB"
    )
    emit(document, [text, *([f"errors: {truth}"] if truth else [])], as_json=as_json)


def _simulated(made: Rehearsal, file: RigFile, seed: int, out: Path) -> dict[str, Any]:
    """Return what was recorded, with the true errors."""
    return {
        "out": str(out),
        "rows": len(made.run),
        "cycles": len(made.run.cycles),
        "duration_s": float(np.sum(made.run.step_s)),
        "rate_hz": file.recording.rate_hz,
        "seed": seed,
        "parameters": told_truth(made),
    }


def _changed(file: RigFile, changes: dict[str, Any], *, self_heating: bool) -> RigFile:
    """Return a file with what the options say instead of it."""
    told = {key: value for key, value in changes.items() if value is not None}
    recording = RecordingTable(**{**file.recording.model_dump(), **told})
    temperature = file.temperature or (TemperatureTable() if self_heating else None)
    return file.model_copy(update={"recording": recording, "temperature": temperature})


def _drawn(
    file: RigFile, groups: str | None, priors: PriorFile | None, seed: int
) -> dict[str, float]:
    sensors = sensors_with(_groups(groups), file, angle=file.recording.angle)
    return drawn_errors(sensors, np.random.default_rng([seed, 1]), priors)


def _read_errors(path: Path) -> dict[str, float]:
    """Read errors from JSON with "parameters", as `--truth` and `rig calibrate` write them."""
    try:
        found = json.loads(read_text(path))
        values = {str(k): float(v["value"]) for k, v in found["parameters"].items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        expected = 'expected JSON with "parameters": {NAME: {"value": number}}'
        raise InputError(path, "parameters", expected) from None
    if bad := [name for name, value in values.items() if not np.isfinite(value)]:
        raise InputError(path, f"parameters.{bad[0]}", "not a finite number")
    groups_of(values, str(path))
    return values


def covariance(
    programme: Path | None,
    mode: str,
    groups: str | None,
    priors: Path | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Carry out `accelbench covariance`; the arguments are its options."""
    if programme is None and (groups or priors):
        raise click.UsageError("--groups and --priors need a PROGRAMME.toml")
    check_results(None, report, [], force=force)
    modes: tuple[Mode, ...] = ("coarse", "precise")
    modes = tuple(m for m in modes if mode in (m, "both"))
    advice: dict[str, tuple[Advice, ...]] = {}
    tables, document, text = None, dict[str, Any](programme=str(programme)), list[RenderableType]()
    if programme is None:
        with working("computing the article's tables"):
            analysis = ArticleAnalysis()
            best, literal = (analysis.tables(reading) for reading in track((BEST, LITERAL)))
        tables = (best, literal)
        file, found = RigFile(**article_programme().model_dump()), tables[0].by_mode(modes)
        document, text = article_document(*tables), list(article_text(*tables))
    else:
        file, prior_file = read_rig_file(programme), read_priors(priors) if priors else None
        with working("analysing the programme"):
            analysed = {m: _analysed(file, m, groups, prior_file, programme) for m in track(modes)}
        found = {m: one for m, (one, _) in analysed.items()}
        advice = {m: told for m, (_, told) in analysed.items()}
    document |= analysis_document(found, advice)
    text += analysis_text(found, advice)
    title = "the article's programme" if programme is None else programme.name
    results = Results(document, text)
    results.add_report(report, lambda: _pages(file, found, advice, title, tables))
    results.write(as_json=as_json)


def _pages(
    file: RigFile,
    found: Mapping[str, RigCovariance],
    advice: Mapping[str, tuple[Advice, ...]],
    title: str,
    tables: tuple[ArticleTables, ArticleTables] | None,
) -> dict[str, bytes]:
    from accelbench.commands.rig_plan.page import render_covariance  # matplotlib takes its second

    return render_covariance(file, found, title=title, tables=tables, advice=advice)


def _analysed(
    file: RigFile, mode: Mode, groups: str | None, priors: PriorFile | None, source: Path
) -> tuple[RigCovariance, tuple[Advice, ...]]:
    try:
        return analyse_programme(file, mode, _groups(groups), priors)
    except ValueError as err:
        raise InputError(source, "cycles", str(err)) from None
