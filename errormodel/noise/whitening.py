"""Noise taken out of columns, and put in: the Cholesky factor of its covariance in linear time.

The noise is white plus slow first-order Gauss-Markov processes. Whitening is the innovation
sequence of the Kalman filter of their sum. There is one filter; `Whitener` keeps its gains for
columns that come whole and often, `BlockWhitener` carries its state through columns that come in
blocks.
"""

from dataclasses import dataclass

import numba
import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.blocks import Blocked
from errormodel.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class TimeBase:
    """Times of the samples, and the relative white noise of each.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        From each run's start, s.
    run : ndarray of int, shape (n,)
    white2 : ndarray, shape (n,)
        Relative variance of the white part; a mean of k readings has 1/k.
    elapsed_s : ndarray, shape (n,)
        From the first run's start, s: for noise that goes on between runs.
    """

    time_s: FloatArray
    run: IntArray
    white2: FloatArray
    elapsed_s: FloatArray

    def __len__(self) -> int:
        return self.time_s.size

    @property
    def step_s(self) -> float:
        """Median interval, s."""
        steps = np.diff(self.time_s)[np.diff(self.run) == 0]
        return float(np.median(steps)) if steps.size else 1.0

    @property
    def span_s(self) -> float:
        """Duration of the longest run, s."""
        return max(float(np.ptp(self.time_s[self.run == r])) for r in np.unique(self.run))

    def take(self, rows: IntArray) -> "TimeBase":
        """Return some samples; runs keep their numbers."""
        return TimeBase(self.time_s[rows], self.run[rows], self.white2[rows], self.elapsed_s[rows])


@dataclass(frozen=True, slots=True, eq=False)
class SlowProcesses:
    """Slow Gauss-Markov processes beside white noise of unit variance.

    Parameters
    ----------
    variance : ndarray, shape (m,)
        Stationary variance of each, relative to the white variance.
    tau_s : ndarray, shape (m,)
        Correlation time of each, s.
    settled : bool
        Whether each run begins in the stationary distribution; otherwise it begins from zero.
    continued : bool
        Whether they go on between the runs.
    """

    variance: FloatArray
    tau_s: FloatArray
    settled: bool = True
    continued: bool = False

    @property
    def start(self) -> FloatArray:
        """Variance of each at a start, shape (m,)."""
        return self.variance if self.settled else np.zeros_like(self.variance)


@numba.njit(cache=True)
def _gains(
    time_s: FloatArray,
    run: IntArray,
    white2: FloatArray,
    var: FloatArray,
    tau_s: FloatArray,
    start: FloatArray,
    cov: FloatArray,
    last: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what each process keeps, its gain, and the innovation's variance, per reading.

    `cov` and `last` (time, run) are the filter's state, changed in place.
    """
    n, m = time_s.size, var.size
    keep, gain, total = np.zeros((n, m)), np.zeros((n, m)), np.empty(n)
    seen = np.empty(m)
    for k in range(n):
        if run[k] == last[1]:
            step = time_s[k] - last[0]
            for i in range(m):
                keep[k, i] = np.exp(-step / tau_s[i])
            for i in range(m):
                for j in range(m):
                    cov[i, j] *= keep[k, i] * keep[k, j]
                cov[i, i] += var[i] * (1.0 - keep[k, i] * keep[k, i])
        else:
            cov[:, :] = 0.0
            for i in range(m):
                cov[i, i] = start[i]
        last[0], last[1] = time_s[k], float(run[k])
        total[k] = white2[k] + cov.sum()
        for i in range(m):
            seen[i] = cov[i, :].sum()
            gain[k, i] = seen[i] / total[k]
        for i in range(m):
            for j in range(m):
                cov[i, j] -= gain[k, i] * seen[j]
    return keep, gain, total


@numba.njit(cache=True, nogil=True)
def _innovations(
    keep: FloatArray,
    gain: FloatArray,
    root: FloatArray,
    columns: FloatArray,
    mean: FloatArray,
    colour: bool,
) -> FloatArray:
    """Whiten the columns; or, when `colour`, give white columns the noise's colour.

    `mean` (m, width) is the filter's state, changed in place.
    """
    n, width = columns.shape
    m = keep.shape[1]
    out = np.empty((n, width))
    for k in range(n):
        for i in range(m):
            for j in range(width):
                mean[i, j] *= keep[k, i]
        for j in range(width):
            predicted = 0.0
            for i in range(m):
                predicted += mean[i, j]
            if colour:
                innovation = columns[k, j] * root[k]
                out[k, j] = predicted + innovation
            else:
                innovation = columns[k, j] - predicted
                out[k, j] = innovation / root[k]
            for i in range(m):
                mean[i, j] += gain[k, i] * innovation
    return out


NO_RUN = -1.0  # before the first reading


class Whitener:
    """The noise's filter on one time base: for columns that stand whole."""

    def __init__(self, slow: SlowProcesses, times: TimeBase) -> None:
        m = slow.variance.size
        time_s, run = times.time_s, times.run
        if slow.continued:
            time_s, run = times.elapsed_s, np.zeros_like(times.run)
        cov, last = np.zeros((m, m)), np.array([0.0, NO_RUN])
        self._keep, self._gain, total = _gains(
            time_s, run, times.white2, slow.variance, slow.tau_s, slow.start, cov, last
        )
        self._root = np.sqrt(total)
        self.log_det = float(np.sum(np.log(total)))

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Return columns (n, m) or (n,) decorrelated, in units of the white sigma."""
        return self._run(columns, False)

    def colour(self, white: FloatArray) -> FloatArray:
        """Return white columns (n, m) or (n,) of unit variance with the noise's covariance."""
        return self._run(white, True)

    def _run(self, columns: FloatArray, colour: bool) -> FloatArray:
        data = np.ascontiguousarray(columns, dtype=float)
        whole = data[:, None] if data.ndim == 1 else data
        mean = np.zeros((self._keep.shape[1], whole.shape[1]))
        out = _innovations(self._keep, self._gain, self._root, whole, mean, colour)
        return out[:, 0] if data.ndim == 1 else out


class BlockWhitener:
    """The noise's filter for columns that are given block after block of a record.

    Parameters
    ----------
    slow : SlowProcesses
        They begin afresh with each run.
    width : int
        Number of columns.
    """

    def __init__(self, slow: SlowProcesses, width: int) -> None:
        if slow.continued:
            raise ValueError("noise that continues between runs needs a common time base")
        m = slow.variance.size
        self._slow = slow
        self._cov, self._last = np.zeros((m, m)), np.array([0.0, NO_RUN])
        self._mean = np.zeros((m, width))
        self.log_det = 0.0

    def whiten(self, block: Record, columns: FloatArray) -> FloatArray:
        """Return the columns of the next readings, in units of the white noise; adds `log_det`."""
        slow = self._slow
        if slow.variance.size == 0:
            return np.asarray(columns, dtype=float)
        keep, gain, total = _gains(
            block.time_s, block.run, np.ones(len(block)),
            slow.variance, slow.tau_s, slow.start, self._cov, self._last,
        )  # fmt: skip
        self.log_det += float(np.sum(np.log(total)))
        data = np.ascontiguousarray(columns, dtype=float)
        return _innovations(keep, gain, np.sqrt(total), data, self._mean, False)


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


class DriftProduct:
    """Xᵀ C X of columns X (n, p) with C = exp(−|t_j − t_k|/τ) within runs, block after block.

    C is the identity, what lies below the diagonal, and its mirror image: one pass is enough.
    """

    def __init__(self, record: Record, tau_s: float, width: int) -> None:
        self._record, self._tau_s = record, tau_s
        self._carry, self._last = np.zeros(width), np.array([0.0, NO_RUN])
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
