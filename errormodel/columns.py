"""The derivative of a model over a record, which need not stand whole.

A recording of millions of readings has no room for a dozen columns of them beside its own. They
are evaluated block by block whenever they are multiplied with something; short ones are kept.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import DTypeLike

from errormodel.arrays import FloatArray
from errormodel.blocks import block_slices, parts_of_runs
from errormodel.linear import triangle_of
from errormodel.model import ErrorModel
from errormodel.record import Record

KEPT = 1 << 18  # readings: twenty columns of them take 42 MB


def derivative(model: ErrorModel, record: Record, values: Mapping[str, float]) -> FloatArray:
    """Compute the derivative of the output by every unknown.

    Nonlinear parameters are differenced centrally over 1e-4 of their range.

    Returns
    -------
    ndarray, shape (n, p)
        Columns in the order of `model.names`.
    """
    columns = np.empty((len(record), len(model.names)))
    count = len(model.coefficients)
    for rows, design in model.designs(record, values):
        columns[rows, :count] = model.linearised(design, values)[1]
    for k, p in enumerate(model.parameters, count):
        step = 1e-4 * (p.hi - p.lo)
        lo, hi = max(values[p.name] - step, p.lo), min(values[p.name] + step, p.hi)
        above = model.simulate(record, {**values, p.name: hi})
        below = model.simulate(record, {**values, p.name: lo})
        columns[:, k] = (above - below) / (hi - lo)
    return columns


class Columns:
    """The derivative of a model's output by its unknowns, shape (n, p), as a matrix to multiply.

    Parameters
    ----------
    model : ErrorModel
        With nonlinear parameters the columns are kept: each needs the whole record twice.
    record : Record
    values : mapping of str to float
        Where the derivative is taken.
    """

    __array_ufunc__ = None  # an array on the left leaves the product to `__rmatmul__`

    def __init__(self, model: ErrorModel, record: Record, values: Mapping[str, float]) -> None:
        self._model, self._record, self._values = model, record, dict(values)
        self.shape = (len(record), len(model.names))
        kept = bool(model.parameters) or len(record) <= KEPT
        self._whole = derivative(model, record, values) if kept else None

    def blocks(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with their columns."""
        if self._whole is not None:
            for rows in block_slices(self.shape[0]):
                yield rows, self._whole[rows]
            return
        for rows, design in self._model.designs(self._record, self._values):
            yield rows, self._model.linearised(design, self._values)[1]

    def __matmul__(self, right: FloatArray) -> FloatArray:
        """Return the sum of the columns with these factors, (p,) or (p, m)."""
        if self._whole is not None:
            return np.asarray(self._whole @ right)
        product = np.empty((self.shape[0], *right.shape[1:]))
        for rows, block in self.blocks():
            product[rows] = block @ right
        return product

    def __rmatmul__(self, left: FloatArray) -> FloatArray:
        """Return an array (n,) or (m, n) times the columns."""
        return self.transposed_times(left.T).T

    def transposed_times(self, right: FloatArray) -> FloatArray:
        """Return the products of each column with an array (n,) or (n, m)."""
        if self._whole is not None:
            return np.asarray(self._whole.T @ right)
        total = np.zeros((self.shape[1], *right.shape[1:]))
        for rows, block in self.blocks():
            total += block.T @ right[rows]
        return total

    def by_run(self, right: FloatArray) -> FloatArray:
        """Return the products of each column with an array (n,), run by run, (runs, p)."""
        runs = self._record.run_slices
        total = np.zeros((len(runs), self.shape[1]))
        for rows, block in self.blocks():
            for number, part in parts_of_runs(runs, rows):
                mine = block[part.start - rows.start : part.stop - rows.start]
                total[number] += mine.T @ right[part]
        return total

    def triangle(self, *beside: FloatArray) -> FloatArray:
        """Return R of the QR factorisation of the columns with others (n, m) at their right."""
        triangle: FloatArray | None = None
        for rows, block in self.blocks():
            joint = np.hstack([block, *(one[rows] for one in beside)]) if beside else block
            triangle = triangle_of(joint, triangle)
        return np.zeros((0, self.shape[1])) if triangle is None else triangle

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> FloatArray:
        """Return the columns whole."""
        if self._whole is not None:
            return np.array(self._whole, dtype=dtype) if copy else self._whole
        return derivative(self._model, self._record, self._values)
