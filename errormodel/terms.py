"""Terms: what an error model is a tuple of.

A channel measures ``y = gain · (1 + Σ scale terms) · (input + Σ input terms)``. A `Term` adds
columns in one of these three places; an `InputChange` replaces an input signal for every term
that uses it (a thermal lag puts the inner temperature in place of the measured one). Either may
have nonlinear parameters with physical bounds, and either may have a memory: then it carries a
state from reading to reading, so that the same term fits a recorded night and drives an emulated
accelerometer reading by reading.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record

Place = Literal["gain", "scale", "input"]
Values = Mapping[str, float]
# A memory is whatever the term needs to go on after the last reading; None before the first.
Memory = Any
Columns = Callable[[Record, Values, Memory], tuple[FloatArray, Memory]]
Change = Callable[[Record, Values, Memory], tuple[Record, Memory]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient:
    """A linear unknown: its name, and how it is reported.

    ``reported = value · per_unit`` in `unit`. When the other columns reproduce all but `min_share`
    of its own, the data do not separate it: the default allows for rounding only, a larger one
    for inputs that are themselves known only so well.
    """

    name: str
    symbol: str
    unit: str
    per_unit: float = 1.0
    min_share: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A nonlinear unknown with physical bounds; fitted continuously between them."""

    name: str
    symbol: str
    unit: str
    lo: float
    hi: float
    start: float
    per_unit: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """Columns added to the model in one place.

    `columns(record, values, memory)` returns an array of shape (n, number of coefficients) and
    the memory to go on with. `needs` names the signals it uses. `predictive` is False for an
    event or a run's own offset, which a new run will not repeat.
    """

    name: str
    sentence: str
    place: Place
    coefficients: tuple[Coefficient, ...]
    columns: Columns
    needs: frozenset[str] = frozenset()
    parameters: tuple[Parameter, ...] = ()
    predictive: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class InputChange:
    """An input signal replaced, for every term that uses it.

    `change(record, values, memory)` returns the changed record and the memory to go on with.
    """

    name: str
    sentence: str
    change: Change
    parameters: tuple[Parameter, ...]
    needs: frozenset[str] = frozenset()
    predictive: bool = True

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """None: what it adds enters through other terms."""
        return ()


Effect = Term | InputChange


def memoryless(columns: Callable[[Record], FloatArray]) -> Columns:
    """Turn columns that depend on the present reading only into a term's `columns`.

    A one-dimensional result becomes a single column.
    """

    def with_memory(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        del values
        result = np.asarray(columns(record), dtype=float)
        return (result[:, None] if result.ndim == 1 else result), memory

    return with_memory


def by_run(
    one_run: Callable[[Record, slice, Values, Memory], tuple[FloatArray, Memory]],
) -> Columns:
    """Turn columns with a memory into a term's `columns`: each run of a record starts afresh.

    `one_run(record, readings, values, memory)` gets the readings of one run. A memory handed in
    continues the record's first run.
    """

    def with_memory(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        pieces: list[FloatArray] = []
        after = memory
        for index, readings in enumerate(record.run_slices):
            piece, after = one_run(record, readings, values, memory if index == 0 else None)
            pieces.append(piece[:, None] if piece.ndim == 1 else piece)
        return (np.concatenate(pieces) if pieces else np.zeros((0, 1))), after

    return with_memory


def renamed(effect: Effect, suffix: str) -> Effect:
    """Return an effect whose name and whose unknowns' names end in `suffix`.

    So that several channels with the same terms stand in one filter.
    """
    plain = [p.name for p in effect.parameters]
    parameters = tuple(replace(p, name=p.name + suffix) for p in effect.parameters)

    def own(values: Values) -> Values:
        return {name: values[name + suffix] for name in plain}

    if isinstance(effect, InputChange):
        change = effect.change

        def changed(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
            return change(record, own(values), memory)

        return replace(effect, name=effect.name + suffix, parameters=parameters, change=changed)
    columns = effect.columns

    def block(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        return columns(record, own(values), memory)

    return replace(
        effect,
        name=effect.name + suffix,
        coefficients=tuple(replace(c, name=c.name + suffix) for c in effect.coefficients),
        parameters=parameters,
        columns=block,
    )


def in_unit(term: Term, unit: float) -> Term:
    """Return a term for a model that counts in `unit` of this term's own: its unknowns stay."""
    columns = term.columns

    def smaller(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        block, after = columns(record, values, memory)
        return block / unit, after

    return replace(term, columns=smaller)
