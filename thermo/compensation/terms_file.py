"""Writing TERMS.toml, so that `fit` takes what another command found."""

from collections.abc import Sequence

from errormodel.io.toml_write import Plain, toml_text
from thermo.fitting.fit import TermsFile


def terms_toml(terms: TermsFile, sentences: Sequence[str] = ()) -> str:
    """Return a TERMS.toml's text; `read_terms` gives an equal one back.

    Parameters
    ----------
    terms : TermsFile
    sentences : sequence of str
        One for each term, for a comment beside it.
    """
    names = terms.terms or ()
    data: dict[str, Plain] = {"t_ref_c": terms.t_ref_c, "terms": names}
    if terms.start:
        data["start"] = dict(terms.start)
    said = zip(names, sentences, strict=True) if sentences else ()
    return toml_text(data, {("terms", name): sentence for name, sentence in said})
