"""The readout: a gain that depends on the sign or the size of its output."""

from collections.abc import Callable

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.terms import Effect, Term
from thermo.library.effects import (
    EVENT_SHARE,
    MICRO,
    Example,
    ThermalEffect,
    one_column,
    plain_form,
)


def _readout(
    name: str,
    symbol: str,
    unit: str,
    sentence: str,
    of_input: Callable[[FloatArray], FloatArray],
    label: str = "",
) -> Term:
    """Return a term of the readout, a function of the input."""
    return one_column(
        name,
        symbol=symbol,
        unit=unit,
        sentence=sentence,
        column=lambda r: of_input(r["a_i_g"]),
        needs=("a_i_g",),
        family="output_nonlinearity",
        label=label,
        min_share=EVENT_SHARE,
        prior_sigma=1e-3,  # 1 mg/g: wider than any readout
    )


def output_asymmetry() -> Term:
    """Return a scale factor that differs between positive and negative output."""
    sentence = "The readout's gain differs between positive and negative output."
    return _readout("output_nonlinearity", "n1", "µg/g", sentence, np.abs)


def output_bend() -> Term:
    """Return a gain that changes with the size of the output."""
    sentence = "The readout's gain changes with the size of its output."
    name = "output_nonlinearity_odd"
    return _readout(name, "n2", "µg/g²", sentence, lambda a: a * np.abs(a), "odd")


TERMS: dict[str, Callable[[], Effect]] = {
    "output_nonlinearity": output_asymmetry,
    "output_nonlinearity_odd": output_bend,
}
EFFECTS = (
    ThermalEffect(
        name="output_nonlinearity",
        sentence="The readout's gain depends on the sign or the size of its output: {size}.",
        forms=plain_form("output_nonlinearity", "output_nonlinearity_odd"),
        experiment="positions every 15°, and the same on another channel of the readout",
        cause="digitiser",
        example=Example(term="output_nonlinearity", values={"output_nonlinearity": 20 / MICRO}),
    ),
)
