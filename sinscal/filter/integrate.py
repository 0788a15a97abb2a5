"""Full-rate data integrated once into intervals, for a filter of a lower rate.

In the local axes n the attitude error φ (C_true = (I + φ×)·C_computed) obeys
``φ̇ = −ω_ie × φ − C·δω`` and the mean of ``C·f − γ`` is ``γ × φ̄ + mean(C·δf)``, with γ = (0, 0, g).
The errors δω, δf are linear in the unknowns, with columns that turn with the body: over an interval
they are summed at the full rate, so that the filter loses nothing by its lower one.

The columns are derivatives of the true motion by the unknowns, the readings given, and not of the
readings: they act along the sensors' true axes, and through a lever arm an error of the rate is one
of the force. The two differ by 1e-3 of a column, but what a run shows worst may be known 10⁴ times
worse than what it shows best.

References
----------
Savage, P. G. (1998), Strapdown inertial navigation integration algorithm design, J. Guidance 21,
parts 1 and 2, for the rotation-vector and sculling forms.
"""

from dataclasses import dataclass, field

import numba
import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.filter.kalman import REORDERED
from sinscal.frames.quaternions import (
    Quaternion,
    Vector,
    cross,
    dot,
    normalised,
    plus,
    product,
    quaternion_of,
    row_of,
    times,
    unit_quaternion,
    vector_of,
    write_matrix,
)
from sinscal.recording.run import BoolArray

LEAST_S = 1e-9  # instead of no usable reading at all


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeltRates:
    """Error of the corrected force by an error of the rate: lever arms, delays.

    Attributes
    ----------
    by_rate, by_derivative : ndarray, shape (n, 3, 3)
        Error of the force in the body by that of the rate, and of its derivative, along the gyros'
        axes.
    derivative : ndarray, shape (p_g, n)
        Of the gyros' columns in time.
    """

    by_rate: FloatArray
    by_derivative: FloatArray
    derivative: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SensorColumns:
    """Derivatives of the sensors' errors by unknowns over n steps, and the axes they act along.

    Attributes
    ----------
    gyro, accel : ndarray, shape (p_g, n), (p_a, n)
    gyro_axis, accel_axis : ndarray of int, shape (p_g,), (p_a,)
        0, 1, 2 of the sensors.
    gyro_frame, accel_frame : ndarray, shape (3, 3)
        Columns are the sensors' axes in the body: an error of a reading is one of the true rate or
        force along them.
    felt : FeltRates, optional
        How errors of the rate come into the force.
    """

    gyro: FloatArray
    gyro_axis: IntArray
    accel: FloatArray
    accel_axis: IntArray
    gyro_frame: FloatArray = field(default_factory=lambda: np.eye(3))
    accel_frame: FloatArray = field(default_factory=lambda: np.eye(3))
    felt: FeltRates | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Intervals:
    """Jacobians of one cycle, K intervals; p_g parameters of gyros, p_a of accelerometers.

    Attributes
    ----------
    length_s, weight_s : ndarray, shape (K,)
        Duration, and what of it has usable readings of force.
    turned : ndarray, shape (K, 3, p_g)
        ∫ C·(gyro columns) over the interval: what −φ grows by.
    turned_mean : ndarray, shape (K, 3, p_g)
        The mean over the interval of that integral so far.
    forced : ndarray, shape (K, 3, p_a)
        Mean of C·(accelerometer columns).
    felt : ndarray, shape (K, 3, p_g)
        Mean of what the gyros' errors do to the force by themselves, not by the attitude.
    """

    length_s: FloatArray
    weight_s: FloatArray
    turned: FloatArray
    turned_mean: FloatArray
    forced: FloatArray
    felt: FloatArray


def _own(values: FloatArray | BoolArray) -> FloatArray:
    """Return floats that may be written to: for others a compiled function is compiled anew."""
    return np.require(values, dtype=np.float64, requirements=["C", "W"])


def attitudes(
    w: FloatArray, step_s: FloatArray, c_start: FloatArray, earth: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Integrate Poisson's equation; return the mean attitudes and those at the ends of the steps.

    Where the rate changes, the mean over a step lies α·dt²/12 before half its turn: at a reversal
    with 20 °/s² and 50 steps a second 12 µrad, as much as an accelerometer's noise over a second.

    Parameters
    ----------
    w : ndarray, shape (n, 3)
        Mean rate over each step, rad/s.
    step_s : ndarray, shape (n,)
    c_start : ndarray, shape (3, 3)
        C_nb before the first step.
    earth : ndarray, shape (3,)
        The earth's rotation in the local axes, rad/s.

    Returns
    -------
    ndarray, ndarray, each of shape (n, 3, 3)
    """
    return _attitudes(_own(w), _own(step_s), quaternion_of(c_start), vector_of(earth))


@numba.njit(cache=True)
def _attitudes(
    w: FloatArray, step_s: FloatArray, start: Quaternion, earth: Vector
) -> tuple[FloatArray, FloatArray]:
    n = w.shape[0]
    middle = np.empty((n, 3, 3))
    end = np.empty((n, 3, 3))
    q, before = start, (0.0, 0.0, 0.0)
    left, left_s = (1.0, 0.0, 0.0, 0.0), 0.0
    for k in range(n):
        dt = step_s[k]
        if dt != left_s:
            left, left_s = unit_quaternion(times(-0.5 * dt, earth)), dt
        theta = times(dt, row_of(w, k))
        # coning between steps: the twelfth of the cross product of neighbouring increments
        full = plus(theta, times(1.0 / 12.0, cross(before, theta)))
        half = unit_quaternion(times(0.5, full))
        q = product(left, product(q, half))
        # the twelfth of what the increment grows by, of central differences
        first, last = max(k - 1, 0), min(k + 1, n - 1)
        apart = 0.5 * (step_s[first] + step_s[last]) + (dt if last - first == 2 else 0.0)
        slope = dt * dt / 12.0 / apart
        grown = plus(times(-slope, row_of(w, last)), times(slope, row_of(w, first)))
        write_matrix(product(q, unit_quaternion(grown)), middle[k])
        q = product(left, product(q, half))
        if k % 64 == 63:  # rounding must not let it cease to be a rotation
            q = normalised(q)
        write_matrix(q, end[k])
        before = theta
    return middle, end


@numba.njit(cache=True)
def _force_sums(
    middle: FloatArray, w: FloatArray, f: FloatArray, step_s: FloatArray, use_s: FloatArray,
    first: IntArray,
) -> FloatArray:  # fmt: skip
    force = np.zeros((first.size - 1, 3))
    for k in range(first.size - 1):
        for s in range(first[k], first[k + 1]):
            # a force that stands still in n turns in the body during the step: its mean there is
            # shorter across the rotation by (ω·dt)²/24
            theta, mean = times(step_s[s], row_of(w, s)), row_of(f, s)
            longer = plus(times(dot(theta, theta), mean), times(-dot(theta, mean), theta))
            x, y, z = plus(mean, times(1.0 / 24.0, longer))
            c = middle[s]
            for i in range(3):
                force[k, i] += use_s[s] * (c[i, 0] * x + c[i, 1] * y + c[i, 2] * z)
    return force


@numba.njit(cache=True, fastmath=REORDERED)
def _column_sums(
    middle: FloatArray, weight: FloatArray, columns: FloatArray, axis: IntArray, first: IntArray
) -> FloatArray:
    """Return Σ weight·C·column of each interval, (K, 3, p); columns are (p, n), each along an axis.

    The attitudes of an interval are laid out so that each sum runs over neighbours in memory.
    """
    p, count = columns.shape[0], first.size - 1
    out = np.empty((count, 3, p))
    turning = np.empty((3, 3, np.max(np.diff(first))))
    for k in range(count):
        begin, length = first[k], first[k + 1] - first[k]
        for s in range(length):
            for i in range(3):
                for j in range(3):
                    turning[i, j, s] = weight[begin + s] * middle[begin + s, i, j]
        for col in range(p):
            for i in range(3):
                total = 0.0
                for s in range(length):
                    total += turning[i, axis[col], s] * columns[col, begin + s]
                out[k, i, col] = total
    return out


def interval_rows(time_s: FloatArray, step_s: FloatArray, interval_s: float) -> IntArray:
    """Return the first row of each interval of about `interval_s`, and the number of rows."""
    since = time_s - (time_s[0] - step_s[0])
    count = max(1, round(float(since[-1]) / interval_s))
    ends = np.searchsorted(since, np.arange(1, count) * interval_s + 1e-9 * interval_s, "right")
    return np.unique(np.concatenate([[0], ends, [time_s.size]])).astype(np.intp)


def usable_s(step_s: FloatArray, good: FloatArray | BoolArray, first: IntArray) -> FloatArray:
    """Return how long each interval has usable readings of force, s, shape (K,)."""
    return np.add.reduceat(step_s * good, first[:-1])


def mean_forces(
    middle: FloatArray,
    w: FloatArray,
    f: FloatArray,
    step_s: FloatArray,
    good: FloatArray | BoolArray,
    first: IntArray,
    gravity_m_s2: float,
) -> FloatArray:
    """Return the mean of C·f − γ over each interval, m/s², shape (K, 3).

    Parameters
    ----------
    middle : ndarray, shape (n, 3, 3)
        C_nb in the mean over each step.
    w, f : ndarray, shape (n, 3)
        Corrected rates and forces, means over the steps.
    step_s : ndarray, shape (n,)
    good : ndarray, shape (n,)
        0 where the force must not be used, else 1.
    first : ndarray of int, shape (K + 1,)
        From `interval_rows`.
    gravity_m_s2 : float
    """
    total = _force_sums(
        _own(middle), _own(w), _own(f), _own(step_s), _own(step_s * good), np.array(first)
    )
    mean = total / np.maximum(usable_s(step_s, good, first), LEAST_S)[:, None]
    return mean - np.array([0.0, 0.0, gravity_m_s2])


def sum_columns(
    middle: FloatArray,
    step_s: FloatArray,
    good: FloatArray | BoolArray,
    columns: SensorColumns,
    first: IntArray,
) -> Intervals:
    """Sum one cycle's columns into intervals, its attitude given.

    Parameters
    ----------
    middle, step_s, good, first
        As of `mean_forces`.
    columns : SensorColumns
    """
    step_s = _own(step_s)
    use_s = step_s * good
    starts, rows = first[:-1], np.diff(first)
    weight_s = np.add.reduceat(use_s, starts)
    # what a step adds to the integral is in its mean for all that is usable of the interval later
    so_far = np.cumsum(use_s)
    later = np.repeat(so_far[first[1:] - 1], rows) - so_far + 0.5 * use_s
    share = 1.0 / np.maximum(weight_s, LEAST_S)[:, None, None]
    rows_of = np.array(first)

    by_gyro, by_accel = (_own(middle @ f) for f in (columns.gyro_frame, columns.accel_frame))

    def summed(frame: FloatArray, weight: FloatArray, of: FloatArray, axis: IntArray) -> FloatArray:
        return _column_sums(frame, weight, _own(of), np.array(axis), rows_of)

    def felt() -> FloatArray:
        if (by := columns.felt) is None:
            return np.zeros((rows.size, 3, columns.gyro_axis.size))
        at_once = summed(_own(middle @ by.by_rate), use_s, columns.gyro, columns.gyro_axis)
        changing = _own(middle @ by.by_derivative)
        return share * (at_once + summed(changing, use_s, by.derivative, columns.gyro_axis))

    return Intervals(
        length_s=np.add.reduceat(step_s, starts),
        weight_s=weight_s,
        turned=summed(by_gyro, step_s, columns.gyro, columns.gyro_axis),
        turned_mean=share * summed(by_gyro, step_s * later, columns.gyro, columns.gyro_axis),
        forced=share * summed(by_accel, use_s, columns.accel, columns.accel_axis),
        felt=felt(),
    )
