"""Check of the gyros against the turn of gravity that the accelerometers see.

Gravity stands still: in the body it changes by df/dt = f × ω. With readings that are wrong in
scale, sign or order the rate that turns gravity is M ω instead, and M names the fault. It is found
by least squares over short spans,

    f̄(k+1) − f̄(k) = f̄ × (M θ + c L),

θ the gyros' turn between the middles of two spans, L the time between them, c a bias of the gyros.
A lever arm, a start from rest or a reversal moves M by far less than a fault does.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from sinscal.frames.attitude import skew
from sinscal.recording.bins import Bins, bins_of
from sinscal.recording.run import BoolArray, RigRun

SPAN_S = 1.0
LARGEST_TURN = np.deg2rad(15.0)  # of gravity between spans: tan(x)/x there is 1.006
PRIOR_M = 1e3  # sigma about the identity: what does not show is not known
SHOWN = 1e-12  # of the largest eigenvalue, columns scaled to one length: less is rounding
PRIOR_BIAS = 0.05  # rad/s: a bias of 3 °/s is beyond MEMS
EXCITED = 100.0  # a gyro's mean square turn over that of its noise
KNOWN = 0.1  # sigma of the entries of a column that is spoken of, over its length
FEWEST = 20  # pairs of spans
SIGMAS_OF_TURN = 6.0  # from which a turn is none of the noise
SLOWEST = np.deg2rad(0.05)  # rad/s: neither is it the earth's rotation or a bias
MUCH = 5.0  # times the noise of a change: below it is nothing to explain


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GravityMap:
    """M with its sigmas, shape (3, 3); these are upper bounds.

    Neighbouring changes share their noise with opposite signs; it is counted as independent, which
    makes the sigmas of slow turns some three times too large: a fault is not called one too soon.
    `known` says of which gyros it tells; `unexplained` is the share of gravity's changes that no M
    explains, zero when they are no larger than noise; `bias` is that of the gyros, rad/s, zero
    where it cannot be told from a rate.
    """

    matrix: FloatArray
    sigma: FloatArray
    known: tuple[bool, bool, bool]
    unexplained: float
    bias: FloatArray


def gravity_map(run: RigRun) -> GravityMap | None:
    """Find M; None when there is too little to go by."""
    bins = _fine_bins(run)
    if int(bins.follows.sum()) < FEWEST:
        return None
    at = np.flatnonzero(bins.follows)
    change = bins.accel[at + 1] - bins.accel[at]
    middle = 0.5 * (bins.accel[at + 1] + bins.accel[at])
    length = 0.5 * (bins.length_s[at + 1] + bins.length_s[at])
    turn = 0.5 * (bins.gyro[at + 1] + bins.gyro[at]) * length[:, None]
    cross = skew(middle)
    columns = np.concatenate(
        [
            np.einsum("kij,kl->kijl", cross, turn).reshape(at.size, 3, 9),
            cross * length[:, None, None],
        ],
        axis=2,
    )
    found, cov = _solve(columns, change, _turning(run, bins, at, turn))
    sigma = np.sqrt(np.diag(cov)[:9]).reshape(3, 3)
    strong = np.mean(turn**2, axis=0) > EXCITED * _noise_turn2(run, bins)
    matrix = found[:9].reshape(3, 3)
    known = strong & (sigma.max(axis=0) < KNOWN * np.linalg.norm(matrix, axis=0))
    left = change - columns @ found
    return GravityMap(
        matrix=matrix,
        sigma=sigma,
        known=(bool(known[0]), bool(known[1]), bool(known[2])),
        unexplained=_unexplained(run, bins, change, left),
        bias=np.where(np.sqrt(np.diag(cov)[9:]) < 0.2 * PRIOR_BIAS, -found[9:], 0.0),
    )


def _fine_bins(run: RigRun) -> Bins:
    """Return spans so short that gravity turns little between them, whatever the gyros say."""
    span_s = SPAN_S
    while True:
        bins = bins_of(run, span_s)
        at = np.flatnonzero(bins.follows)
        if bins.rows == 1 or at.size == 0:
            return bins
        a, b = bins.accel[at], bins.accel[at + 1]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
        if np.quantile(angle, 0.95) < LARGEST_TURN:
            return bins
        span_s *= 0.5


def _turning(run: RigRun, bins: Bins, at: IntArray, turn: FloatArray) -> BoolArray:
    """Return between which spans the run turns, by more than the gyros' noise makes up."""
    noise: FloatArray = np.sqrt(np.sum(_noise_turn2(run, bins)))
    least = np.maximum(SIGMAS_OF_TURN * noise, SLOWEST * bins.length_s[at])
    return np.linalg.norm(turn, axis=1) > least


def _solve(
    columns: FloatArray, change: FloatArray, turning: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the twelve unknowns and their covariance; outliers are left out once.

    What is an outlier among turns is judged by turns: what lever arms and starts leave there is
    beyond all that a dwell shows.
    """
    start = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    prior = np.concatenate([np.full(9, PRIOR_M), np.full(3, PRIOR_BIAS)]) ** -2.0
    apart = change - columns @ start
    noise2 = max(float(np.mean(change**2)), 1e-20)
    found, cov = start, np.diag(1.0 / prior)
    keep = np.ones(change.shape[0], dtype=np.bool_)
    for _ in range(4):  # the weight of the prior needs the noise, and the noise the solution
        a = columns[keep].reshape(-1, 12)
        length = np.linalg.norm(a, axis=0)
        a = a / (scale := np.where(length > 0.0, length, 1.0))  # units of the gyros do not matter
        size, axes = np.linalg.eigh(a.T @ a)
        size = np.where(size > SHOWN * size[-1], size, 0.0)  # the rest stays as it is beforehand
        back = axes / scale[:, None]
        information = np.diag(size / noise2) + (back.T * prior) @ back
        weight = np.sqrt(np.outer(np.diag(information), np.diag(information)))
        inverse = np.linalg.inv(information / weight) / weight
        score = np.where(size > 0.0, axes.T @ (a.T @ apart[keep].ravel()) / noise2, 0.0)
        cov, found = back @ inverse @ back.T, start + back @ (inverse @ score)
        left: FloatArray = np.linalg.norm(change - columns @ found, axis=1)
        typical = np.inf
        for mine in (turning, ~turning):  # a rest leaves no more than a turn does
            if mine.any():
                # of a norm of three normal numbers
                typical = min(typical, float(np.median(left[mine])) / 1.538)
                keep[mine] = left[mine] <= max(6.0 * typical, 1e-12)
        judged = keep & turning if np.any(keep & turning) else keep
        noise2 = max(float(np.mean(left[judged] ** 2)) / 3.0, 1e-20)
    return found, cov


def _noise_turn2(run: RigRun, bins: Bins) -> FloatArray:
    """Return the mean square turn that white noise of the gyros makes up, shape (3,)."""
    return _noise2(run.gyro) / bins.rows * float(np.mean(bins.length_s)) ** 2 / 2.0


def _noise2(values: FloatArray) -> FloatArray:
    """Return the variance of white noise in columns, whatever else moves them, shape (3,)."""
    second = np.diff(values, n=2, axis=0)  # of noise: six times its variance
    return np.square(np.median(np.abs(second), axis=0) / 0.6745) / 6.0


def _unexplained(run: RigRun, bins: Bins, change: FloatArray, left: FloatArray) -> float:
    rounding2 = float(np.max(np.abs(run.accel)) * np.finfo(float).eps) ** 2
    noise2 = 2.0 * float(np.sum(_noise2(run.accel))) / bins.rows + rounding2
    left2 = float(np.sum(np.mean(np.square(left), axis=0)))
    all2 = float(np.sum(np.mean(np.square(change), axis=0)))
    shown = all2 > rounding2 and left2 > MUCH**2 * noise2
    return float(np.sqrt(left2 / all2)) if shown else 0.0
