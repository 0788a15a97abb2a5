"""The larger model that a search found, as the files that the other commands take."""

from collections.abc import Sequence

from thermo.discrepancy import Discrepancy
from thermo.discrepancy_source import Fitted
from thermo.fitting import TermsFile, fit_runs
from thermo.modelfile import ModelFile, make_model_file
from thermo.recording import RecordedRuns
from thermo.terms_file import terms_toml


def present_terms(d: Discrepancy) -> TermsFile:
    """Return the terms of the present model, its nonlinear parameters at their estimates."""
    return _terms(d, d.before)


def larger_terms(d: Discrepancy) -> TermsFile:
    """Return the terms of the model with the effects found."""
    return _terms(d, d.after)


def _terms(d: Discrepancy, fitted: Fitted) -> TermsFile:
    names = tuple(t.name for t in fitted.model.terms)
    start = {p.name: fitted.values[p.name] for p in fitted.model.parameters}
    return TermsFile(terms=names, t_ref_c=d.t_ref_c, start=start)


def larger_toml(d: Discrepancy) -> str:
    """Return the larger model's TERMS.toml, each term with what it is."""
    return terms_toml(larger_terms(d), [t.sentence for t in d.after.model.terms])


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
