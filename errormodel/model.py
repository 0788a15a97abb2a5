"""The error model: a tuple of terms, which simulates and gives the columns to fit."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.blocks import in_blocks
from errormodel.record import Record
from errormodel.terms import (
    Coefficient,
    Effect,
    InputChange,
    Memory,
    Parameter,
    Place,
    Term,
    Values,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """The columns of a model on a record, by place; `base` is the input itself."""

    base: FloatArray  # (n,)
    scale: FloatArray  # (n, number of scale coefficients)
    input: FloatArray  # (n, number of input coefficients)

    def products(self) -> FloatArray:
        """Return every product the output can be made of, shape (n, (1 + ns)·(1 + ni)).

        The output is linear in these whatever the coefficients: the column of scale k and input j
        stands at ``k·(1 + ni) + j``, with 0 for the 1 before the scale terms and the base.
        """
        inputs = np.column_stack([self.base, self.input])
        scaled = [column[:, None] * inputs for column in self.scale.T]
        return np.hstack([inputs, *scaled])


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """A tuple of named terms, for one channel that measures the signal `base`.

    Appending a term is all it takes to add an effect. The output is
    ``gain · (1 + Σ scale) · (base + Σ input)``, in the unit of `base`.

    Raises
    ------
    ValueError
        If a term, coefficient or parameter name stands twice, or there are two gains.
    """

    terms: tuple[Effect, ...]
    base: str = "a_i_g"

    def __post_init__(self) -> None:
        names = [c.name for t in self.terms for c in t.coefficients]
        names += [p.name for t in self.terms for p in t.parameters]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is listed twice in the model")
        if len(self.coefficients_in("gain")) > 1:
            raise ValueError("a channel has one gain")

    def coefficients_in(self, place: Place) -> tuple[Coefficient, ...]:
        """Return the coefficients that enter at a place, in the order of the terms."""
        return tuple(
            c
            for t in self.terms
            if isinstance(t, Term) and t.place == place
            for c in t.coefficients
        )

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The linear unknowns: gain, scale, then input; the order of every vector and matrix."""
        return tuple(c for place in ("gain", "scale", "input") for c in self.coefficients_in(place))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The nonlinear unknowns, in the order of the terms; they follow the coefficients."""
        return tuple(p for t in self.terms for p in t.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns, in the order of every vector and matrix."""
        return tuple(u.name for u in (*self.coefficients, *self.parameters))

    @cached_property
    def needs(self) -> frozenset[str]:
        """The signals a record must have."""
        return frozenset([self.base]).union(*(t.needs for t in self.terms))

    def with_terms(self, *terms: Effect) -> "ErrorModel":
        """Return the model with terms appended."""
        return ErrorModel((*self.terms, *terms), self.base)

    def without(self, *names: str) -> "ErrorModel":
        """Return the model without the terms named."""
        return ErrorModel(tuple(t for t in self.terms if t.name not in names), self.base)

    def start_values(self) -> dict[str, float]:
        """Return the values of an ideal channel: gain one, no error, parameters at their start."""
        gain = {c.name: 1.0 for c in self.coefficients_in("gain")}
        rest = {c.name: 0.0 for c in self.coefficients if c.name not in gain}
        return {**gain, **rest, **{p.name: p.start for p in self.parameters}}

    def design(
        self, record: Record, values: Values, memory: Mapping[str, Memory] | None = None
    ) -> tuple[Design, dict[str, Memory]]:
        """Evaluate every term's columns.

        Parameters
        ----------
        record : Record
            Has the signals in `needs`.
        values : mapping of str to float
            The nonlinear parameters at least.
        memory : mapping, optional
            What an earlier call returned, to go on with the same run after its last reading.

        Returns
        -------
        Design, dict
            The columns by place, and the memory after the record's last reading.

        Raises
        ------
        ValueError
            If the record lacks a signal.
        """
        record, blocks, after = self._evaluated(record, values, memory)
        placed: dict[Place, list[FloatArray]] = {"gain": [], "scale": [], "input": []}
        for term, block in blocks:
            placed[term.place].append(block)
        scale, inputs = (_side_by_side(placed[p], len(record)) for p in ("scale", "input"))
        return Design(base=record[self.base], scale=scale, input=inputs), after

    def _evaluated(
        self, record: Record, values: Values, memory: Mapping[str, Memory] | None
    ) -> tuple[Record, list[tuple[Term, FloatArray]], dict[str, Memory]]:
        """Return the record with its inputs changed, each term's columns, and the memory after."""
        missing = sorted(self.needs - set(record.signals))
        if missing:
            raise ValueError(f"the record lacks {', '.join(missing)}")
        before: Mapping[str, Memory] = memory or {}
        after: dict[str, Any] = {}
        for change in (t for t in self.terms if isinstance(t, InputChange)):
            record, after[change.name] = change.change(record, values, before.get(change.name))
        blocks: list[tuple[Term, FloatArray]] = []
        for term in (t for t in self.terms if isinstance(t, Term)):
            block, after[term.name] = term.columns(record, values, before.get(term.name))
            blocks.append((term, block))
        return record, blocks, after

    def simulate(self, record: Record, values: Values) -> FloatArray:
        """Compute the output of a channel with the coefficients and parameters given.

        Parameters
        ----------
        record : Record
            The inputs.
        values : mapping of str to float
            Every name in `names`, in the model's unit.

        Returns
        -------
        ndarray, shape (n,)
            Output in the unit of `base`, noise-free.

        Raises
        ------
        ValueError
            If the record lacks a signal.
        """
        output = np.empty(len(record))
        parts = in_blocks(record, lambda part, at: self.continue_simulation(part, values, at))
        for rows, simulated in parts:
            output[rows] = simulated
        return output

    def continue_simulation(
        self, record: Record, values: Values, memory: Mapping[str, Memory] | None
    ) -> tuple[FloatArray, dict[str, Memory]]:
        """Compute the output and return the memory, to go on from the record's last reading."""
        record, blocks, after = self._evaluated(record, values, memory)
        gain, factor, measured = 1.0, np.ones(1), record[self.base]
        for term, block in blocks:
            own = np.array([values[c.name] for c in term.coefficients])
            if term.place == "gain":
                gain = float(own[0])
            elif term.place == "scale":
                factor = factor + _weighted(block, own)
            else:
                measured = measured + _weighted(block, own)
        return gain * factor * measured, after

    def linearise(self, record: Record, values: Values) -> tuple[FloatArray, FloatArray]:
        """Compute the output (n,) and its derivative by the coefficients (n, their number)."""
        output = np.empty(len(record))
        derivative = np.empty((len(record), len(self.coefficients)))
        for rows, design in self.designs(record, values):
            output[rows], derivative[rows] = self.linearised(design, values)
        return output, derivative

    def designs(self, record: Record, values: Values) -> Iterator[tuple[slice, Design]]:
        """Yield the readings of each block of a record with their columns, as `design` has them."""
        return in_blocks(record, lambda part, at: self.design(part, values, at))

    def linearised(self, design: Design, values: Values) -> tuple[FloatArray, FloatArray]:
        """Compute the output and its derivative of columns that were evaluated."""
        gain, factor, measured = self._factors(design, values)
        by_gain = [(factor * measured)[:, None]] if self.coefficients_in("gain") else []
        by_scale = (gain * measured)[:, None] * design.scale
        plain = not by_gain and design.scale.shape[1] == 0
        by_input = design.input if plain else (gain * factor)[:, None] * design.input
        n = design.base.size
        return gain * factor * measured, _side_by_side([*by_gain, by_scale, by_input], n)

    def _factors(self, design: Design, values: Values) -> tuple[float, FloatArray, FloatArray]:
        """Return the three factors of the output: gain, 1 + Σ scale, base + Σ input.

        Without scale terms the second is a single one.
        """
        gain, scale, inputs = (
            np.array([values[c.name] for c in self.coefficients_in(place)])
            for place in ("gain", "scale", "input")
        )
        factor = 1.0 + design.scale @ scale if scale.size else np.ones(1)
        return (float(gain[0]) if gain.size else 1.0), factor, design.base + design.input @ inputs

    def product_weights(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what `Design.products` are multiplied by, for m channels at once.

        Parameters
        ----------
        values : ndarray, shape (m, number of coefficients)
            In the order of `coefficients`.

        Returns
        -------
        weights : ndarray, shape (m, P)
            The output is ``products @ weights[channel]``.
        jacobian : ndarray, shape (m, P, number of coefficients)
            Derivative of the weights by the coefficients.
        """
        m = values.shape[0]
        n_gain = len(self.coefficients_in("gain"))
        n_scale = len(self.coefficients_in("scale"))
        ones = np.ones((m, 1))
        gain = values[:, :n_gain] if n_gain else ones
        scale = np.hstack([ones, values[:, n_gain : n_gain + n_scale]])
        inputs = np.hstack([ones, values[:, n_gain + n_scale :]])
        plain = (scale[:, :, None] * inputs[:, None, :]).reshape(m, -1)
        by_scale = np.einsum("sk,mi->msik", np.eye(scale.shape[1])[:, 1:], inputs)
        by_input = np.einsum("ms,ik->msik", scale, np.eye(inputs.shape[1])[:, 1:])
        pieces = [plain[:, :, None]] if n_gain else []
        pieces += [
            gain[:, :, None] * d.reshape(m, plain.shape[1], -1) for d in (by_scale, by_input)
        ]
        return gain * plain, np.concatenate(pieces, axis=2)


def _weighted(block: FloatArray, by: FloatArray) -> FloatArray:
    """Return block @ by; for a single column a product is several times as fast."""
    return block[:, 0] * by[0] if by.size == 1 else block @ by


def _side_by_side(blocks: list[FloatArray], n: int) -> FloatArray:
    """Return blocks of columns of n rows as one; a single block is not copied."""
    filled = [b for b in blocks if b.shape[1]]
    if not filled:
        return np.zeros((n, 0))
    return filled[0] if len(filled) == 1 else np.hstack(filled)
