"""Drift and white noise taken out of columns, and drift put in, in linear time.

The drift is an Ornstein-Uhlenbeck process that starts afresh in each run. Its state is carried
from block to block of a record, so that the columns need not stand whole.
"""

import numba
import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.blocks import Blocked
from errormodel.record import Record


@numba.njit(cache=True)
def _whiten(
    time_s: FloatArray,
    run: IntArray,
    ratio2: float,
    tau_s: float,
    columns: FloatArray,
    mean: FloatArray,
    last: FloatArray,
) -> tuple[FloatArray, float]:
    """Filter rows; `mean` and `last` (time, run, variance) are the state, changed in place."""
    n, m = columns.shape
    out = np.empty((n, m))
    last_s, last_run, variance = last[0], last[1], last[2]
    log_det = 0.0
    for k in range(n):
        if run[k] == last_run:
            keep = np.exp(-(time_s[k] - last_s) / tau_s)
            variance = ratio2 + keep * keep * (variance - ratio2)
        else:
            keep = 0.0
            variance = ratio2
        last_s, last_run = time_s[k], float(run[k])
        total = variance + 1.0
        gain = variance / total
        root = 1.0 / np.sqrt(total)
        log_det += np.log(total)
        for j in range(m):
            predicted = keep * mean[j]
            innovation = columns[k, j] - predicted
            mean[j] = predicted + gain * innovation
            out[k, j] = innovation * root
        variance = variance * (1.0 - gain)
    last[0], last[1], last[2] = last_s, last_run, variance
    return out, log_det


@numba.njit(cache=True)
def _earlier_sums(
    time_s: FloatArray,
    run: IntArray,
    tau_s: float,
    columns: FloatArray,
    carry: FloatArray,
    last: FloatArray,
) -> FloatArray:
    """Sum exp(−(t_k − t_j)/τ) x_j over the earlier rows j of the same run, for every row k.

    `carry` and `last` (time, run) are the state, changed in place.
    """
    n, m = columns.shape
    out = np.empty((n, m))
    last_s, last_run = last[0], last[1]
    for k in range(n):
        keep = np.exp(-(time_s[k] - last_s) / tau_s) if run[k] == last_run else 0.0
        last_s, last_run = time_s[k], float(run[k])
        for j in range(m):
            out[k, j] = keep * carry[j]
            carry[j] = out[k, j] + columns[k, j]
    last[0], last[1] = last_s, last_run
    return out


class Whitening:
    """The innovations of columns, given block after block of a record.

    Parameters
    ----------
    ratio2 : float
        Variance of the drift over that of the white noise; 0 leaves the columns as they are.
    tau_s : float
        Correlation time of the drift, s.
    width : int
        Number of columns.
    """

    def __init__(self, ratio2: float, tau_s: float, width: int) -> None:
        self._shape = (ratio2, tau_s)
        self._mean, self._last = np.zeros(width), np.array([0.0, -1.0, ratio2])
        self.log_det = 0.0

    def whiten(self, block: Record, columns: FloatArray) -> FloatArray:
        """Return the columns of the next readings, in units of the white noise; adds `log_det`."""
        if self._shape[0] == 0.0:
            return np.asarray(columns, dtype=float)
        data = np.ascontiguousarray(columns, dtype=float)
        white, log_det = _whiten(
            block.time_s, block.run, *self._shape, data, self._mean, self._last
        )
        self.log_det += log_det
        return white


class DriftProduct:
    """Xᵀ C X of columns X (n, p) with C = exp(−|t_j − t_k|/τ) within runs, block after block.

    C is the identity, what lies below the diagonal, and its mirror image: one pass is enough.
    """

    def __init__(self, record: Record, tau_s: float, width: int) -> None:
        self._record, self._tau_s = record, tau_s
        self._carry, self._last = np.zeros(width), np.array([0.0, -1.0])
        self._own, self._below = np.zeros((width, width)), np.zeros((width, width))

    def add(self, rows: slice, columns: FloatArray) -> None:
        """Add the next readings' columns."""
        data = np.ascontiguousarray(columns, dtype=float)
        time_s, run = self._record.time_s[rows], self._record.run[rows]
        sums = _earlier_sums(time_s, run, self._tau_s, data, self._carry, self._last)
        self._own += data.T @ data
        self._below += data.T @ sums

    @property
    def total(self) -> FloatArray:
        """The product so far, shape (p, p)."""
        return self._own + self._below + self._below.T


def drift_product(record: Record, tau_s: float, columns: Blocked) -> FloatArray:
    """Return Xᵀ C X of `columns` X (n, p) with C = exp(−|t_j − t_k|/τ) within runs."""
    product = DriftProduct(record, tau_s, columns.shape[1])
    for rows, block in columns.blocks():
        product.add(rows, block)
    return product.total
