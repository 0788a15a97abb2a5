"""The larger model that a search found, as the files that the other commands take."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from errormodel.fit import examine
from errormodel.io.python_file import PythonFile, run_python_text
from errormodel.model import ErrorModel
from errormodel.terms import Term
from thermo.compensation.model_file import ModelFile, dump_model, make_model_file
from thermo.compensation.terms_file import terms_toml
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.shape.library_file import library_text
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.library import using_thermal_library, with_thermal_file
from thermo.library.quantities import QUANTITIES
from thermo.recording.files import RecordedRuns
from thermo.recording.further_columns import signal_of_column
from thermo.recording.signals import signals


def present_terms(d: Discrepancy) -> TermsFile:
    """Return the terms of the present model, its nonlinear parameters at their estimates."""
    return _terms(d, d.before)


def larger_terms(d: Discrepancy) -> TermsFile:
    """Return the terms of the model with the effects found."""
    return _terms(d, d.after)


def _terms(d: Discrepancy, fitted: Fitted) -> TermsFile:
    names = _separable(d, fitted)
    kept = (t for t in fitted.model.terms if t.name in names)
    start = {p.name: fitted.values[p.name] for t in kept for p in t.parameters}
    return TermsFile(terms=names, t_ref_c=d.t_ref_c, start=start)


def _separable(d: Discrepancy, fitted: Fitted) -> tuple[str, ...]:
    """Return the terms of a model that a fit to the same runs can tell from those before them.

    An effect may have more terms than the runs show: of forces across the input axis a head shows
    those in its plane alone.
    """
    terms, record = list(fitted.model.terms), d.channel.record
    while True:
        lost = examine(ErrorModel(tuple(terms)), record, fitted.values).confounded
        added = [
            t
            for t in terms[len(d.before.model.terms) :]
            if isinstance(t, Term)
            and any(u.name in group for u in (*t.coefficients, *t.parameters) for group in lost)
        ]
        if not added:
            return tuple(t.name for t in terms)
        terms.remove(added[-1])


def larger_toml(d: Discrepancy) -> str:
    """Return the larger model's TERMS.toml, each term with what it is."""
    larger = larger_terms(d)
    sentences = {t.name: t.sentence for t in d.after.model.terms}
    return terms_toml(larger, [sentences[name] for name in larger.terms or ()])


def fitted_file(runs: RecordedRuns, terms: Sequence[tuple[str, TermsFile]]) -> ModelFile:
    """Return a model file, each accelerometer fitted by terms of its own.

    Parameters
    ----------
    runs : RecordedRuns
    terms : sequence of (str, TermsFile)
        Serial number and terms.
    """
    fits = [one for s, given in terms for one in fit_runs(runs.select(serial=s), terms=given)]
    return make_model_file(fits)


def library_path(out: Path) -> Path:
    """Return where the shapes of a larger model go: effects of the user's own."""
    return out.with_suffix(".py")


def shape_library(found: Sequence[Discrepancy], out: Path) -> PythonFile | None:
    """Return the library file of all shapes, with the recorded columns that they need.

    None where nothing has a shape. It is not written yet.
    """
    shapes = [d.shape for d in found if d.shape is not None]
    if not shapes:
        return None
    declared = {*QUANTITIES, *(one.name for one in signals())}
    used = dict.fromkeys(s.pattern.quantity for s in shapes)
    columns = [signal_of_column(name) for name in used if name not in declared]
    return run_python_text(library_path(out), library_text(shapes, columns).encode())


def with_shapes(library: PythonFile | None) -> AbstractContextManager[object]:
    """Have the shapes of a library file among the effects until the end of a block.

    The larger model of a discrepancy with a shape is made within: its terms, its fit, its lines.
    """
    if library is None:
        return nullcontext()
    return using_thermal_library(with_thermal_file(library))


def model_files(
    runs: RecordedRuns, found: Sequence[Discrepancy], out: Path
) -> list[tuple[Path, bytes]]:
    """Return the larger model: its terms for `fit`, and the fitted file for `compensate`."""
    fitted = dump_model(fitted_file(runs, [(d.serial, larger_terms(d)) for d in found])).encode()
    if out.suffix.lower() == ".json":
        return [(out, fitted)]
    terms = [larger_toml(d).encode() for d in (_foremost(found), *(found if found[1:] else ()))]
    first, fitted_path, *each = model_paths(out, len(found))
    return [*zip([first, *each], terms, strict=True), (fitted_path, fitted)]


def model_paths(out: Path, count: int) -> list[Path]:
    """Return where the model goes: its terms, the fitted file, the terms of each of several."""
    if out.suffix.lower() == ".json":
        return [out]
    each = [out.with_stem(f"{out.stem}-{k + 1}") for k in range(count if count > 1 else 0)]
    return [out, out.with_suffix(".json"), *each]


def _foremost(found: Sequence[Discrepancy]) -> Discrepancy:
    """Return the first accelerometer from whose model something is missing, else the first."""
    return next((d for d in found if d.effects or d.shape), found[0])


def model_lines(
    found: Sequence[Discrepancy], out: Path, libraries: Sequence[Path] = ()
) -> Iterator[str]:
    """Say which file holds whose model, and how it is used.

    Parameters
    ----------
    found : sequence of Discrepancy
    out : Path
    libraries : sequence of Path
        Files of the user's own that the search was given.
    """
    added = any(d.effects or d.shape for d in found)
    what = "larger model" if added else "nothing to add; present model"
    paths = model_paths(out, len(found))
    yield f"{what}: {', '.join(str(p) for p in paths[:2])}"
    for d, path in zip(found, paths[2:], strict=False):  # of one alone there is no file
        yield f"of {d.serial} alone: {path}"
    for d in found:
        kept = set(larger_terms(d).terms or ())
        lost = [t.name for t in d.after.model.terms if t.name not in kept]
        if lost:
            yield (
                f"left out for {d.serial}, these runs cannot determine all of its parameters: "
                f"{', '.join(lost)}"
            )
    if any(d.shape for d in found):
        own = library_path(out)
        given = " ".join(f"--library {p}" for p in (*libraries, own))
        yield f"effects without a name: {own}; every command takes it with the model, as in"
        yield f"  accelbench compensate RUN.csv --model {out.with_suffix('.json')} {given}"
