"""`accelbench discrepancy thermal`: the effect that an accelerometer's model lacks."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from accelbench.commands.discrepancy.larger_model import (
    library_path,
    model_files,
    model_lines,
    model_paths,
    shape_library,
    with_shapes,
)
from accelbench.commands.discrepancy.options import tell
from accelbench.commands.discrepancy.text import discrepancy_document, discrepancy_text
from accelbench.shell.inputs import add_reading_counts, read_with_doubts
from accelbench.shell.library import library_paths
from accelbench.shell.outputs import Results, check_results, checked_output, with_sidecars
from errormodel.errors import InputError
from thermo.compensation.model_file import read_model
from thermo.discrepancy.experiment_menu import Limits
from thermo.discrepancy.find import Discrepancy, find_discrepancy
from thermo.fitting.fit import TermsFile, read_terms
from thermo.recording.files import RecordedRuns

BARE = Path("bare")  # no file: k0 and k1, each quadratic in temperature
NO_EXPERIMENT = "no experiment is needed: none written"


def discrepancy_thermal(
    files: tuple[Path, ...],
    model: Path | None,
    out: Path | None,
    report: Path | None,
    experiment_out: Path | None,
    seed: int,
    workers: int,
    no_shape: bool,
    max_hours: float | None,
    temperatures: tuple[float, float] | None,
    angles: str | None,
    trust_units: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench discrepancy thermal`; the arguments are its options."""
    limits = _limits(max_hours, temperatures, angles)
    given = [p for p in (model,) if p and p != BARE]
    inputs = [*with_sidecars(list(files)), *given, *library_paths()]
    for path in (p for p in (out, experiment_out) if p):
        checked_output(path, inputs, force=force)
    check_results(None, report, [], force=force)
    runs, doubts = read_with_doubts(
        list(files), trust_units=trust_units, more_columns=True, tell=tell
    )
    for path in model_paths(out, len(runs.serials))[1:] if out is not None else ():
        checked_output(path, inputs, force=force)
    if out is not None and not no_shape:
        checked_output(library_path(out), inputs, force=force)
    found = find_discrepancy(
        runs,
        model=_present(model),
        seed=seed,
        workers=workers,
        with_shape=not no_shape,
        limits=limits,
        tell=tell,
    )
    library = shape_library(found, out) if out is not None else None
    document = discrepancy_document(found, library.path if library else None)
    results = Results(document, [*discrepancy_text(found), *doubts])
    add_reading_counts(results.document, runs, doubts)
    if out is not None:
        with with_shapes(library):
            made = model_files(runs, found, out)
            lines = list(model_lines(found, out, library_paths()))
        own = [(library.path, library.content)] if library else []
        results.add_files("out", out, [*made, *own], lines)
    if experiment_out is not None:
        proposed = _experiment_file(found, experiment_out)
        line = f"experiment: {experiment_out}" if proposed else NO_EXPERIMENT
        results.add_files("experiment_out", experiment_out, proposed, [line])
    results.add_report(report, lambda: _pages(found, runs))
    results.write(as_json=as_json)
    return 1 if doubts else 0


def _limits(
    hours: float | None, temperatures_c: tuple[float, float] | None, angles: str | None
) -> Limits:
    """Return what the laboratory can do.

    Raises
    ------
    InputError
        If it can do nothing.
    """
    if hours is not None and not hours > 0.0:
        raise InputError("discrepancy thermal", "--max-hours", f"{hours:g}, expected more than 0")
    if temperatures_c is not None and not temperatures_c[0] < temperatures_c[1]:
        problem = "expected the coldest and then the hottest, as --temperatures -20 60"
        raise InputError("discrepancy thermal", "--temperatures", problem)
    try:
        head = tuple(float(a) for a in angles.split(",")) if angles is not None else None
    except ValueError:
        problem = f"{angles!r}, expected angles in °, as 0,90,180,270"
        raise InputError("discrepancy thermal", "--angles", problem) from None
    return Limits(
        most_hours=math.inf if hours is None else hours,
        temperatures_c=temperatures_c,
        angles_deg=head,
    )


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


def _pages(found: Sequence[Discrepancy], runs: RecordedRuns) -> dict[str, bytes]:
    from accelbench.commands.discrepancy.page import (
        render_discrepancy,  # matplotlib takes its second
    )

    return render_discrepancy(found, runs)
