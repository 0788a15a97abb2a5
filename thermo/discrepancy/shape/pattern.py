"""The likeliest function of a quantity for what a model leaves, and the term that it is.

Every quantity that is recorded is tried, plain and multiplied by what may go with it: the input,
the direction of the ramp, temperature, the sign of the last turn.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.shape import (
    Formula,
    Shape,
    fit_shape,
    knots_of,
)
from errormodel.io.python_file import LibrarySource
from errormodel.noise.model import NoiseModel
from errormodel.terms import Term
from thermo.discrepancy.factors import Seen, kinds_in
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library import thermal_library, using_thermal_library
from thermo.library.effects import ThermalEffect
from thermo.library.quantities import QUANTITIES
from thermo.library.shape import TIMES, factor_values, quantity_of, shape_effect, shape_term

# Twice the log-likelihood that a further factor of a product, or no formula, must be worth.
PRICE = 9.0
# Quantities that no shape is made of: they belong to these runs.
OF_THESE_RUNS = frozenset({"run", "time", "rest_before_run", "direction", "hour_of_day"})
# In runs of one programme everything that repeats is a function of these: they are no rivals of a
# name, and a shape of them is made only of what has none.
OF_THE_PROGRAMME = frozenset({"time_in_run", "since_ramp_change", "turned_at"})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pattern:
    """A quantity, what its function is multiplied by, and the function."""

    quantity: str
    times: str
    shape: Shape

    def effect(self, name: str, sentence: str = "") -> ThermalEffect:
        """Return the effect that it is."""
        return shape_effect(name, sentence, self.shape.size.tolist())

    def term(self, name: str, sentence: str = "") -> Term:
        """Return the term that it is."""
        return shape_term(
            name,
            self.quantity,
            self.shape.knots.tolist(),
            self.shape.curves.tolist(),
            times=self.times,
            sentence=sentence,
        )

    @contextmanager
    def in_library(self, name: str, sentence: str = "") -> Generator[None]:
        """Have its term in the library until the end of the block."""
        made = self.term(name, sentence)
        source = LibrarySource(name=name, sha256="", members=frozenset([name]))
        known = thermal_library()
        terms = {n: make for n, make in known.terms.items() if n != name}
        wider = replace(known, terms=terms).with_members({name: lambda: made}, [], source)
        with using_thermal_library(wider):
            yield

    def source_with(self, source: ThermalSource, name: str) -> ThermalSource:
        """Return a source whose library has the effect too."""
        return ThermalSource(source.channel, source.model, (*source.effects, self.effect(name)))


def likeliest_pattern(
    source: ThermalSource, beside: Sequence[Choice], noise: NoiseModel, *, rivals: bool = False
) -> Pattern | None:
    """Return the likeliest function of a quantity; the plain one unless a product is clearly.

    Parameters
    ----------
    source : ThermalSource
    beside : sequence of Choice
        Effects in the model.
    noise : NoiseModel
    rivals : bool
        Only of quantities that are not the programme's.
    """
    view = View(source.problem(tuple(beside), noise), noise)
    found: list[tuple[float, Pattern]] = []
    for quantity, times in _trials(source.seen):
        if rivals and quantity in OF_THE_PROGRAMME:
            continue
        x, by = factor_by_block(source.seen, quantity, times)
        shape = fit_shape(view, x, by, knots_of(x))
        if shape is not None:
            score = 2.0 * shape.evidence - (PRICE if times else 0.0)
            found.append((score, Pattern(quantity=quantity, times=times, shape=shape)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _trials(seen: Seen) -> Iterator[tuple[str, str]]:
    names = [k.quantity.name for k in kinds_in(seen) if k.quantity.name not in OF_THESE_RUNS]
    signals = seen.channel.record.signals
    for name in names:
        for times in TIMES:
            if times == name or (times == "input" and not seen.has_input):
                continue
            if times in QUANTITIES and not QUANTITIES[times].needs <= set(signals):
                continue
            yield name, times


def factor_by_block(seen: Seen, quantity: str, times: str) -> tuple[FloatArray, FloatArray]:
    """Return a quantity by block, and what its function is multiplied by."""
    x = seen.of(quantity_of(quantity))
    if times == "input":
        return x, seen.blocks.mean(seen.channel.record["a_i_g"])
    if not times:
        return x, np.ones(x.size)
    return x, factor_values(times, seen.of(QUANTITIES[times]))


TIMES_WORDS = {
    "": "",
    "input": ", in proportion to the input",
    "direction": ", with the sign of heating or cooling",
    "temperature": ", in proportion to the temperature",
    "last_move": ", with the sign of the head's last turn",
}


def sentence_of(pattern: Pattern, formula: Formula | None) -> str:
    """Say what the effect does."""
    quantity = quantity_of(pattern.quantity)
    unit = "ppm" if pattern.times == "input" else "µg"
    peak = 0.5 * float(np.ptp(pattern.shape.values))
    text = f"An effect without a name: {peak:.2g} {unit}"
    if formula is not None and formula.family == "sine":
        text += f" with a period of {formula.at:.3g} {quantity.unit}".rstrip()
    return f"{text}; it {quantity.words}{TIMES_WORDS[pattern.times]}."
