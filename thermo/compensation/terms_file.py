"""Writing TERMS.toml, so that `fit` takes what another command found."""

import json
from collections.abc import Sequence

from thermo.fitting.fit import TermsFile


def terms_toml(terms: TermsFile, sentences: Sequence[str] = ()) -> str:
    """Return a TERMS.toml's text; `read_terms` gives an equal one back.

    Parameters
    ----------
    terms : TermsFile
    sentences : sequence of str
        What each term is, for a comment beside it.
    """
    names = terms.terms or ()
    said = [f"  # {s}" for s in sentences] or [""] * len(names)
    lines = [f"t_ref_c = {terms.t_ref_c!r}", "terms = ["]
    lines += [f"    {json.dumps(n)},{s}" for n, s in zip(names, said, strict=True)]
    lines += ["]"]
    if terms.start:
        lines += ["", "[start]", *(f"{k} = {v!r}" for k, v in terms.start.items())]
    return "\n".join(lines) + "\n"
