"""An effect that is in no library: what an emulated accelerometer may have all the same."""

from dataclasses import dataclass

import numpy as np

from errormodel.terms import Term, memoryless
from thermo.library.effects import MICRO, Example, millionths
from thermo.twin.accelerometer import T_REF_C

UNKNOWN = "unknown"
AMPLITUDE_UG, PERIOD_C = (15.0, 30.0), (16.0, 20.0)
CENTRE_C, WIDTH_C = (-10.0, 40.0), (50.0, 80.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEffect(Example):
    """A ripple of the bias over temperature under a slow envelope.

    Attributes
    ----------
    made : Term
        The term; no library has it.
    words : str
        Its formula and sizes.
    """

    made: Term
    words: str


def unknown_effect(seed: int) -> UnknownEffect:
    """Draw an effect that is in no library.

    Parameters
    ----------
    seed : int
    """
    rng = np.random.default_rng([seed, len(UNKNOWN)])
    size_ug, period_c, centre_c, width_c = (
        float(np.round(rng.uniform(*limits), 1))
        for limits in (AMPLITUDE_UG, PERIOD_C, CENTRE_C, WIDTH_C)
    )
    made = Term(
        name=UNKNOWN,
        sentence="A ripple over temperature under a slow envelope.",
        place="input",
        coefficients=(millionths(UNKNOWN, "u", "µg"),),
        columns=memoryless(
            lambda r: (
                np.sin(2.0 * np.pi * r["x_slow_c"] / period_c)
                * np.exp(-(((r["x_slow_c"] + T_REF_C - centre_c) / width_c) ** 2))
            )
        ),
        needs=frozenset(["x_slow_c"]),
    )
    words = (
        f"{size_ug:g} µg · sin(2π (T − {T_REF_C:g} °C)/{period_c:g} °C) · "
        f"exp(−((T − {centre_c:g} °C)/{width_c:g} °C)²)"
    )
    return UnknownEffect(term=UNKNOWN, values={UNKNOWN: size_ug / MICRO}, made=made, words=words)
