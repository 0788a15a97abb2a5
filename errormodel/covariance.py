"""Covariance of a least-squares estimate, averaged over the noises that the data allow."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from errormodel.linear import triangle_of
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel, given_noise
from errormodel.noise.whitening import drift_product
from errormodel.record import Record

Support = Sequence[tuple[float, NoiseModel]]


def expected_covariance(
    model: ErrorModel, record: Record, values: Mapping[str, float], noise: NoiseModel
) -> FloatArray:
    """Return the covariance a fit with equal weights will have, before there is an output.

    Returns
    -------
    ndarray, shape (p, p)
        In the order of `model.names`.
    """
    columns = Columns(model, record, values)
    return equal_weight_covariance(record, columns, given_noise(noise).support)[0]


def equal_weight_covariance(
    record: Record, columns: Columns, support: Support
) -> tuple[FloatArray, float]:
    """Return A V Aᵀ with A the least-squares inverse, averaged over the noises; and a condition."""
    triangle = columns.triangle()
    norms = np.linalg.norm(triangle, axis=0)  # those of the columns: rotations keep lengths
    norms = np.where(norms > 0, norms, 1.0)
    r = triangle / norms
    inverse = linalg.pinv(r) / norms[:, None]
    total = sum(share for share, _ in support)
    cov = sum(s * noise.white**2 for s, noise in support) / total * (inverse @ inverse.T)
    by_tau: dict[float, float] = {}
    for share, noise in support:
        weight = share / total * noise.drift**2
        by_tau[noise.drift_tau_s] = by_tau.get(noise.drift_tau_s, 0.0) + weight
    solved = inverse @ inverse.T
    for tau_s, variance in by_tau.items():
        if variance > 0.0:
            spread = drift_product(record, tau_s, columns)
            cov = cov + variance * (solved @ spread @ solved)
    return cov, float(np.linalg.cond(r))


def noise_weight_covariance(
    record: Record, columns: Columns, residual: FloatArray, support: Support
) -> tuple[FloatArray, float]:
    """Return (Jᵀ V⁻¹ J)⁻¹ averaged over the noises, with how far the estimate moves with them."""
    triangle = columns.triangle()
    norms = np.linalg.norm(triangle, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    p = norms.size
    steps: list[FloatArray] = []
    covs: list[FloatArray] = []
    for _, noise in support:
        whitener, whitened = noise.block_whitener(p + 1), np.zeros((0, p + 1))
        for rows, block in columns.blocks():
            joint = np.column_stack([block / norms, residual[rows]])
            white = whitener.whiten(record.view(rows), joint) / noise.white
            whitened = triangle_of(white, whitened)
        inverse = linalg.pinv(whitened[:p, :p])
        steps.append(inverse @ whitened[:p, -1])
        covs.append(inverse @ inverse.T)
    share = np.array([w for w, _ in support]) / sum(w for w, _ in support)
    apart = np.array(steps) - share @ np.array(steps)
    within = np.einsum("i,ijk->jk", share, np.array(covs))
    cov = within + np.einsum("i,ij,ik->jk", share, apart, apart)
    return cov / np.outer(norms, norms), float(np.linalg.cond(triangle / norms))
