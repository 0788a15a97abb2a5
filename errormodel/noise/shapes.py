"""Noise shapes for the search of missing effects: white plus a sum of slow processes.

Each slow process is an Ornstein-Uhlenbeck process that starts afresh with every run, in its
stationary law or from zero. One of them is bias instability; one whose correlation time is many
times a run and that starts from zero is a random walk (where a run begins is then an offset of its
own, which is an effect with a name); five of them spaced evenly in the logarithm of the
correlation time, all of one variance, are flicker noise. Whitening is the innovation sequence of
the Kalman
filter of the sum, in linear time.
"""

from dataclasses import dataclass

import numba
import numpy as np

from errormodel.arrays import FloatArray, IntArray


@numba.njit(cache=True)
def _gains(
    time_s: FloatArray,
    run: IntArray,
    white2: FloatArray,
    var: FloatArray,
    tau_s: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what each process keeps, its gain, and the innovation's variance, per reading."""
    n, m = time_s.size, var.size
    keep, gain, total = np.zeros((n, m)), np.zeros((n, m)), np.empty(n)
    cov = np.zeros((m, m))
    for k in range(n):
        if k > 0 and run[k] == run[k - 1]:
            step = time_s[k] - time_s[k - 1]
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
        total[k] = white2[k] + cov.sum()
        seen = np.empty(m)
        for i in range(m):
            seen[i] = cov[i, :].sum()
            gain[k, i] = seen[i] / total[k]
        for i in range(m):
            for j in range(m):
                cov[i, j] -= gain[k, i] * seen[j]
    return keep, gain, total


@numba.njit(cache=True, nogil=True)
def _innovations(
    keep: FloatArray, gain: FloatArray, root: FloatArray, columns: FloatArray, colour: bool
) -> FloatArray:
    """Whiten the columns; or, when `colour`, give white columns the noise's colour."""
    n, width = columns.shape
    m = keep.shape[1]
    out = np.empty((n, width))
    mean = np.zeros((m, width))
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


@dataclass(frozen=True, slots=True, eq=False)
class TimeBase:
    """When the samples were taken: what noise has its colour on.

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


@dataclass(frozen=True, slots=True)
class NoiseShape:
    """White noise of unit variance plus slow processes.

    Parameters
    ----------
    family : {"white", "drift", "walk", "flicker"}
    variance : tuple of float
        Of each slow process, relative to the white variance.
    tau_s : tuple of float
        Correlation time of each, s.
    settled : bool
        Whether each run begins in the processes' stationary law; otherwise they begin from zero.
    continued : bool
        Whether they go on between the runs.
    """

    family: str = "white"
    variance: tuple[float, ...] = ()
    tau_s: tuple[float, ...] = ()
    settled: bool = True
    continued: bool = False

    def whitener(self, base: TimeBase) -> "Whitener":
        """Return what decorrelates columns on a time base."""
        return Whitener(self, base)

    def slow_share(self, span_s: float) -> float:
        """Return the mean square of the slow part over a run of `span_s`, relative to the white.

        A process slower than the run counts with what it moves within the run, from its start:
        the level it starts from is the run's own.
        """
        total = 0.0
        for variance, tau_s in zip(self.variance, self.tau_s, strict=True):
            ratio = span_s / tau_s
            kept = (1.0 - np.exp(-ratio)) / ratio
            total += variance * min(1.0, 2.0 * (1.0 - kept))
        return float(total)


class Whitener:
    """The Cholesky factor of a noise shape's covariance, as a recursion."""

    def __init__(self, shape: NoiseShape, base: TimeBase) -> None:
        var, tau = np.array(shape.variance, dtype=float), np.array(shape.tau_s, dtype=float)
        start = var if shape.settled else 0.0 * var
        time_s, run = base.time_s, base.run
        if shape.continued:
            time_s, run = base.elapsed_s, np.zeros_like(base.run)
        self._keep, self._gain, total = _gains(time_s, run, base.white2, var, tau, start)
        self._root = np.sqrt(total)
        self.log_det = float(np.sum(np.log(total)))

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Return columns (n, m) decorrelated, in units of the white sigma."""
        return self._run(columns, False)

    def colour(self, white: FloatArray) -> FloatArray:
        """Return white columns (n, m) of unit variance with the noise's covariance."""
        return self._run(white, True)

    def _run(self, columns: FloatArray, colour: bool) -> FloatArray:
        data = np.ascontiguousarray(columns, dtype=float)
        if data.ndim == 1:
            return _innovations(self._keep, self._gain, self._root, data[:, None], colour)[:, 0]
        return _innovations(self._keep, self._gain, self._root, data, colour)


# A process slower than this share of the longest run is hardly told from offsets and relaxations
# of the runs, which are effects with names.
SLOWEST_SPANS = 0.5
# A walk is a process this many times slower than the longest run, begun from zero.
WALK_SPANS = 50.0
FLICKER_POLES = 5


def drifting(ratio2: float, tau_s: float) -> NoiseShape:
    """Return white noise with one slow process of `ratio2` times its variance."""
    return NoiseShape("drift", (ratio2,), (tau_s,))


def walking(ratio2: float, base: TimeBase, *, continued: bool) -> NoiseShape:
    """Return white noise with a random walk that has `ratio2` of variance after the longest run.

    It begins from zero with every run, or goes on through the rests between them.
    """
    tau_s = WALK_SPANS * base.span_s
    variance = (0.5 * WALK_SPANS * ratio2,)
    return NoiseShape("walk", variance, (tau_s,), settled=False, continued=continued)


def flicker(ratio2: float, base: TimeBase) -> NoiseShape:
    """Return white noise with flicker noise; `ratio2` is the variance of each of its poles."""
    taus = np.geomspace(base.step_s, 10.0 * base.span_s, FLICKER_POLES)
    return NoiseShape("flicker", (ratio2,) * FLICKER_POLES, tuple(taus.tolist()))
