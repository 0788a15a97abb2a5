"""The noise of an accelerometer's runs: what neither repeats nor belongs to a run's coefficients.

Restricted maximum likelihood (REML) judges noise by the error contrasts: the part of the readings
that the fixed effects leave (Patterson and Thompson 1971). Fixed are here

- each run's own coefficients, and its own heating less cooling (a parabola) where runs differ in
  it beyond chance (a loop that only some runs show is a difference between runs, no noise);
- a function of temperature in each direction that all runs share: what repeats.

So what these take of the drift is accounted for exactly, whether there are two runs or twenty.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, IntArray
from errormodel.covariance import expected_covariance
from errormodel.model import ErrorModel
from errormodel.noise.drift_or_white import estimate_noise
from errormodel.noise.model import NoiseFit, NoiseModel
from errormodel.record import Record

# Runs are taken to be alike in their noise unless chance gives such a difference in one of 10⁴.
UNLIKE = 1e-4
# Parabolas of each run take up slow drift too, which the noise that is left then hardly shows: with
# 3 µg of drift over one hour p was 1e-5 in one of three pairs of runs; 40 µg of loop in two runs of
# five give 1e-11.
LOOPS_DIFFER = 1e-8
ROUNDS = 3  # of weighing runs that are not alike
FEWEST = 2.0  # degrees of freedom of a sigma
RANK = 1e-9  # of the fixed effects' Gram matrix


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunsNoise:
    """Noise common to the runs in its shape.

    Attributes
    ----------
    common : NoiseFit
    ratios : ndarray, shape (runs,)
        Each run's noise over the common one; all 1 where the runs are alike.
    loops_p : float
        How often chance alone makes heating less cooling differ so from run to run.
    """

    common: NoiseFit
    ratios: FloatArray
    loops_p: float

    def of_run(self, number: int) -> NoiseFit:
        """Return the noise of one run."""
        ratio = float(self.ratios[number])
        support = tuple((w, n.scaled(ratio)) for w, n in self.common.support)
        return NoiseFit(noise=self.common.noise.scaled(ratio), support=support)


def runs_noise(
    record: Record,
    columns: Sequence[FloatArray],
    residual: FloatArray,
    alike: FloatArray,
    direction: IntArray,
) -> RunsNoise:
    """Estimate the noise of runs.

    Parameters
    ----------
    record : Record
        Of all runs, run by run.
    columns : sequence of ndarray, shape (n_r, p_r)
        Derivative of each run's own coefficients.
    residual : ndarray, shape (n,)
        At some value of those (any: they are fixed effects).
    alike : ndarray, shape (n, q)
        Columns of what repeats in all runs.
    direction : ndarray of int, shape (n,)
        1 heating, −1 cooling, 0 hold.

    References
    ----------
    Patterson and Thompson (1971), Biometrika 58, 545; Bartlett (1937), Proc. R. Soc. A 160, 268,
    for the test that the runs are alike.
    """
    fixed = _fixed_effects(record, columns, alike)
    loops = _loops(record, direction)
    loops_p = _significance(record, fixed, loops, residual)
    if loops_p < LOOPS_DIFFER:
        fixed = np.hstack([fixed, loops])
    ratios = np.ones(len(columns))
    found = _estimate(record, fixed, residual, ratios)
    ratios = _ratios(record, fixed, residual, found.noise)
    if np.any(ratios != 1.0):
        found = _estimate(record, fixed, residual, ratios)
    return RunsNoise(common=found, ratios=ratios, loops_p=loops_p)


def _loops(record: Record, direction: IntArray) -> FloatArray:
    """Return each run's heating less cooling, a parabola in temperature, shape (n, 3·runs)."""
    x = record["x_c"]
    x = np.asarray((x - x.mean()) / max(float(np.ptp(x)), 1e-9), dtype=np.float64)
    shapes = direction[:, None] * x[:, None] ** np.arange(3)
    own = record.run[:, None] == np.unique(record.run)
    return np.asarray(own[:, :, None] * shapes[:, None, :], dtype=float).reshape(len(record), -1)


def _significance(
    record: Record, fixed: FloatArray, extra: FloatArray, residual: FloatArray
) -> float:
    """Return the p-value of columns beyond the fixed effects: an F test of the innovations.

    The noise is that of the model with them; the mean is over all noises the data allow.
    """
    extra = extra[:, np.any(extra != 0.0, axis=0)]
    before, after = _basis(fixed), _basis(np.hstack([fixed, extra]))
    more = after.shape[1] - before.shape[1]
    dof = len(record) - after.shape[1]
    if more < 1 or dof < 2:
        return 1.0
    noise = estimate_noise(record, residual, after, wary=True)
    p = 0.0
    for share, one in noise.support:
        white = one.whiten(record, np.column_stack([before, after, residual]))
        y = white[:, -1]
        little, much = (
            float(np.sum((y - q @ (q.T @ y)) ** 2))
            for q in (_basis(white[:, : before.shape[1]]), _basis(white[:, before.shape[1] : -1]))
        )
        f = (little - much) / more / (much / dof) if much > 0.0 else 0.0
        p += share * float(stats.f.sf(f, more, dof))
    return p / sum(share for share, _ in noise.support)


def degrees_of_freedom(
    model: ErrorModel, record: Record, values: Mapping[str, float], noise: NoiseFit
) -> FloatArray:
    """Return to how many degrees of freedom the sigmas of a fit are known, shape (p,).

    The noises that the data allow give a coefficient the variances v; χ²-distributed variances of
    that mean and scatter have 2·mean(v)²/var(v) degrees of freedom (Satterthwaite 1946).
    """
    white = expected_covariance(model, record, values, NoiseModel(white=1.0))
    slow = {
        tau_s: expected_covariance(
            model, record, values, NoiseModel(white=1.0, drift=1.0, drift_tau_s=tau_s)
        )
        - white
        for tau_s in {n.drift_tau_s for _, n in noise.support if n.drift > 0.0}
    }
    variances = np.array(
        [
            n.white**2 * np.diag(white)
            + (n.drift**2 * np.diag(slow[n.drift_tau_s]) if n.drift > 0.0 else 0.0)
            for _, n in noise.support
        ]
    )
    share = np.array([w for w, _ in noise.support])
    share = share / share.sum()
    mean = share @ variances
    scatter = share @ (variances - mean) ** 2 / mean**2
    of_white = 2.0 / max(len(record) - len(model.names), 1)
    return np.asarray(np.maximum(2.0 / (scatter + of_white), FEWEST))


def _fixed_effects(record: Record, columns: Sequence[FloatArray], alike: FloatArray) -> FloatArray:
    """Return the columns of the fixed effects, shape (n, q)."""
    blocks: list[FloatArray] = []
    for rows, own in zip(record.run_slices, columns, strict=True):
        block = np.zeros((len(record), own.shape[1]))
        block[rows] = own
        blocks.append(block)
    return np.hstack([*blocks, alike])


def _estimate(
    record: Record, fixed: FloatArray, residual: FloatArray, ratios: FloatArray
) -> NoiseFit:
    weight = 1.0 / ratios[record.run]
    basis = _basis(fixed * weight[:, None])
    return estimate_noise(record, residual * weight, basis, wary=True)


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns' space, shape (n, rank)."""
    norms = np.linalg.norm(columns, axis=0)
    unit = columns[:, norms > 0] / norms[norms > 0]
    values, vectors = np.linalg.eigh(unit.T @ unit)
    kept = values > RANK * values[-1]
    return np.asarray(unit @ vectors[:, kept] / np.sqrt(values[kept]), dtype=np.float64)


def _ratios(
    record: Record, fixed: FloatArray, residual: FloatArray, noise: NoiseModel
) -> FloatArray:
    """Return each run's noise over that of all, or ones where chance explains the difference.

    What is compared are the innovations: whitened, they are independent.
    """
    runs = len(record.run_slices)
    joint = noise.whiten(record, np.column_stack([fixed, residual]))
    found = np.ones(runs)
    for k in range(ROUNDS):
        weight = 1.0 / found[record.run]
        basis = _basis(joint[:, :-1] * weight[:, None])
        y = joint[:, -1] * weight
        left = y - basis @ (basis.T @ y)
        free = 1.0 - np.sum(basis**2, axis=1)
        dof = np.array([float(free[r].sum()) for r in record.run_slices])
        square = np.array([float(np.sum(left[r] ** 2)) for r in record.run_slices])
        if np.any(dof < 2.0):
            return np.ones(runs)
        found = found * np.sqrt(square / dof)
        if k == 0 and _alike(square / dof, dof):
            return np.ones(runs)
    return found / float(np.sqrt(np.mean(found**2)))


def _alike(variances: FloatArray, dof: FloatArray) -> bool:
    """Tell by Bartlett's test whether variances are of one size."""
    total = float(dof.sum())
    pooled = float(dof @ variances) / total
    if pooled <= 0.0 or np.any(variances <= 0.0):
        return True
    statistic = total * np.log(pooled) - float(np.sum(dof * np.log(variances)))
    correction = 1.0 + (float(np.sum(1.0 / dof)) - 1.0 / total) / (3.0 * (dof.size - 1))
    return float(stats.chi2.sf(float(statistic) / correction, dof.size - 1)) > UNLIKE
