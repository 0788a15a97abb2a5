"""Terms made by hand for the core's tests: no term of the thermo package is used here."""

import numpy as np

from errormodel.terms import Coefficient, Parameter, Term, by_run, memoryless


def linear_term(name: str, place: str, signal: str, power: int = 1, **kw: float) -> Term:
    return Term(
        name=name,
        sentence="",
        place=place,  # type: ignore[arg-type]
        coefficients=(Coefficient(name=name, symbol=name, unit="", **kw),),  # type: ignore[arg-type]
        columns=memoryless(lambda r: r[signal] ** power if power else np.ones(len(r))),
        needs=frozenset([signal]) if power else frozenset(),
    )


def decay_term() -> Term:
    """An event at the start of each run with an unknown time constant."""

    def one_run(record, readings, values, memory):  # type: ignore[no-untyped-def]
        return np.exp(-record.time_s[readings] / values["tau"]), None

    return Term(
        name="decay",
        sentence="",
        place="input",
        coefficients=(Coefficient(name="decay", symbol="d", unit=""),),
        columns=by_run(one_run),
        parameters=(Parameter(name="tau", symbol="τ", unit="s", lo=50.0, hi=5000.0, start=300.0),),
    )
