"""Terms, the parts of an error model.

A channel measures ``y = gain · (1 + Σ scale terms) · (input + Σ input terms)``. A `Term` adds
columns in one of these three places; an `InputChange` replaces an input signal for every term
that uses it (a thermal lag replaces the measured temperature by the inner one). Both may have
nonlinear parameters with physical bounds. Both may have a memory, a state that is carried from
reading to reading, so that the same term fits a recorded night and drives an emulated accelerometer
reading by reading.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from errormodel.arrays import FloatArray, freeze
from errormodel.record import Record

Place = Literal["gain", "scale", "input"]
Values = Mapping[str, float]
# A memory is the state from which a term continues after the last reading; None before the first.
Memory = Any
Columns = Callable[[Record, Values, Memory], tuple[FloatArray, Memory]]
Change = Callable[[Record, Values, Memory], tuple[Record, Memory]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """The reported unit of a quantity, and its size in units of the model."""

    unit: str
    size: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """A parameter's name, how it is reported, and what it belongs to.

    Attributes
    ----------
    name, symbol : str
    unit : str
        ``reported = value · per_unit`` in `unit`.
    per_unit : float
    family : str
        The physical quantity to which it belongs: `k0` for `k0_t3`; by default its name.
    order : int
        Power of temperature.
    group : str
        The group of parameters with which it is estimated and reported; by default its name.
    axis : str
        The sensor to which it belongs, if there are several.
    prior_sigma : float, optional
        Prior sigma, in the model's unit.
    told : Told, optional
        The reported unit, if it is not `unit`.
    label : str
        Its short name within its family; by default its name.
    """

    name: str
    symbol: str
    unit: str
    per_unit: float = 1.0
    family: str = ""
    order: int = 0
    group: str = ""
    axis: str = ""
    prior_sigma: float | None = None
    told: Told | None = None
    label: str = ""

    def __post_init__(self) -> None:
        name = self.name
        freeze(
            self,
            family=self.family or name,
            group=self.group or name,
            label=self.label or name,
        )

    @property
    def told_in(self) -> Told:
        """The reported unit."""
        return self.told or Told(unit=self.unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient(Description):
    """A linear parameter.

    It is not separable if the other columns reproduce all but the share `min_share` of its column.
    The default covers rounding errors only; use a larger share for inputs of limited accuracy.
    """

    min_share: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter(Description):
    """A nonlinear parameter with physical bounds; fitted continuously between them."""

    lo: float
    hi: float
    start: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """Columns added to the model in one place.

    `columns(record, values, memory)` returns an array of shape (n, number of coefficients) and the
    memory after the last reading. `needs` names the signals that it uses. `predictive` is False for
    an event or an offset of one run, which a new run does not repeat.
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
    """Replacement of an input signal for every term that uses it.

    `change(record, values, memory)` returns the changed record and the memory after the last
    reading.
    """

    name: str
    sentence: str
    change: Change
    parameters: tuple[Parameter, ...]
    needs: frozenset[str] = frozenset()
    predictive: bool = True

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """Empty: its effect enters through other terms."""
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
    """Turn columns with a memory into a term's `columns`; each run of a record starts anew.

    `one_run(record, readings, values, memory)` gets the readings of one run. A given memory
    continues the first run of the record.
    """

    def with_memory(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        pieces: list[FloatArray] = []
        after = memory
        for index, readings in enumerate(record.run_slices):
            piece, after = one_run(record, readings, values, memory if index == 0 else None)
            pieces.append(piece[:, None] if piece.ndim == 1 else piece)
        return (np.concatenate(pieces) if pieces else np.zeros((0, 1))), after

    return with_memory


D = TypeVar("D", bound=Description)


def on_axis(effect: Effect, axis: str) -> Effect:
    """Return the effect for one of several sensors: its name and parameter names end in the axis.

    Several channels with the same terms can then be in one filter.
    """
    plain = [p.name for p in effect.parameters]

    def own(values: Values) -> Values:
        return {name: values[_of_axis(name, axis)] for name in plain}

    def described(one: D) -> D:
        return replace(one, name=_of_axis(one.name, axis), axis=axis)

    parameters = tuple(described(p) for p in effect.parameters)
    if isinstance(effect, InputChange):
        change = effect.change

        def changed(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
            return change(record, own(values), memory)

        name = _of_axis(effect.name, axis)
        return replace(effect, name=name, parameters=parameters, change=changed)
    columns = effect.columns

    def block(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        return columns(record, own(values), memory)

    return replace(
        effect,
        name=_of_axis(effect.name, axis),
        coefficients=tuple(described(c) for c in effect.coefficients),
        parameters=parameters,
        columns=block,
    )


def _of_axis(name: str, axis: str) -> str:
    return f"{name}_{axis}"


def in_unit(term: Term, unit: float) -> Term:
    """Return a term for a model whose unit is `unit` in units of this term; its parameters stay."""
    columns = term.columns

    def smaller(record: Record, values: Values, memory: Memory) -> tuple[FloatArray, Memory]:
        block, after = columns(record, values, memory)
        return block / unit, after

    return replace(term, columns=smaller)
