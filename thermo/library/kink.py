"""A kink of the bias over temperature: its slope changes at one temperature."""

from collections.abc import Callable, Sequence

import numpy as np

from errormodel.terms import Effect, Parameter, Term
from thermo.library.effects import MICRO, Context, Example, Form, ThermalEffect, millionths

ORDINARY = 1e-3  # 1 mg/°C: wider than any accelerometer
TRIALS = 12
# A kink nearer to the ends of the range is an order of temperature.
INSIDE = 0.1


def bias_kink() -> Term:
    """Return a bias that grows from one temperature on, in proportion to the excess over it."""
    return Term(
        name="bias_kink",
        sentence="The bias's slope over temperature changes at one temperature, as where an "
        "adhesive softens or a part touches another.",
        place="input",
        coefficients=(millionths("bias_kink", "bk", "µg/°C", prior_sigma=ORDINARY),),
        columns=lambda r, v, m: (
            np.maximum(r["x_slow_c"] - v["bias_kink_at_c"], 0.0)[:, None],
            m,
        ),
        needs=frozenset(["x_slow_c"]),
        parameters=(
            Parameter(
                name="bias_kink_at_c",
                symbol="xk",
                unit="°C",
                lo=-150.0,
                hi=150.0,
                start=0.0,
                family="bias_kink",
                label="at",
            ),
        ),
    )


def _kink(at: Context) -> Sequence[Form]:
    lo, hi = at.x_range_c
    if "bias_kink" in at.term_names or hi <= lo:
        return []
    inside = np.linspace(lo + INSIDE * (hi - lo), hi - INSIDE * (hi - lo), TRIALS)
    grid = tuple((float(x),) for x in inside)
    return [Form(terms=("bias_kink",), parameters=("bias_kink_at_c",), grid=grid)]


TERMS: dict[str, Callable[[], Effect]] = {"bias_kink": bias_kink}
EFFECTS = (
    ThermalEffect(
        name="bias_kink",
        sentence="The bias's slope over temperature changes at one temperature, {size}.",
        forms=_kink,
        experiment="a slow ramp over ten degrees about the kink, up and down",
        example=Example(term="bias_kink", values={"bias_kink": 3 / MICRO, "bias_kink_at_c": 10.0}),
    ),
)
