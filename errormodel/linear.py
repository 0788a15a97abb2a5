"""Least squares on a matrix as small as the model: whitened products compressed once by QR."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel

MAX_STEPS = 30
# Rows rotated at a time: 20 columns of them fit a second-level cache.
BLOCK_ROWS = 2048
# Gauss-Newton stops when a step is this small in sigmas: far below any digit that is reported.
STEP_SIGMAS = 1e-7


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Compressed:
    """Whitened products and outputs, rotated so that only as many rows are left as columns."""

    triangle: FloatArray  # (≤ P, P)
    target: FloatArray  # (≤ P, m)
    rest2: FloatArray  # (m,): squared length of what no combination of products explains


def triangle_of(columns: FloatArray, above: FloatArray | None = None) -> FloatArray:
    """Return R of the QR factorisation of (n, p), shape (≤ p, p): every length and angle is kept.

    Blocks of rows are rotated one after another, so that each stays in the processor's cache.
    `above` is the triangle of rows that went before.
    """
    p = columns.shape[1]
    held = np.zeros((0, p)) if above is None else above
    for begin in range(0, columns.shape[0], BLOCK_ROWS):
        block = np.vstack([held, columns[begin : begin + BLOCK_ROWS]])
        # "raw" zeroes below the diagonal in p rows only, not in the whole block
        held = linalg.qr(block, mode="raw", check_finite=False, overwrite_a=True)[1][:p]
    return held


def compress(products: FloatArray, outputs: FloatArray) -> Compressed:
    """Rotate whitened products (n, P) and outputs (n, m) into a triangle of P rows."""
    p = products.shape[1]
    if outputs.shape[1] <= p:  # carrying a few outputs along is cheaper than forming Q
        return compressed(triangle_of(np.column_stack([products, outputs])), outputs.shape[1])
    q, triangle = linalg.qr(products, mode="economic", check_finite=False)
    target = q.T @ outputs
    rest2 = np.sum((outputs - q @ target) ** 2, axis=0)
    return Compressed(triangle=triangle, target=target, rest2=rest2)


def compressed(triangle: FloatArray, outputs: int = 1) -> Compressed:
    """Split the triangle of products and outputs side by side."""
    p = triangle.shape[1] - outputs
    rest = triangle[p:, p:]
    return Compressed(
        triangle=triangle[:p, :p], target=triangle[:p, p:], rest2=np.sum(rest**2, axis=0)
    )


def solve_compressed(
    model: ErrorModel, data: Compressed, start: Mapping[str, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Run Gauss-Newton on compressed data, for all its channels at once.

    Returns
    -------
    values : ndarray, shape (m, p)
        The linear coefficients, in the order of `model.coefficients`.
    information : ndarray, shape (m, p, p)
        JᵀJ at the solution.
    cost : ndarray, shape (m,)
        Whitened sum of squares.
    """
    m = data.target.shape[1]
    names = [c.name for c in model.coefficients]
    values = np.tile([start[name] for name in names], (m, 1)).astype(float)
    information = np.zeros((m, len(names), len(names)))
    for _ in range(MAX_STEPS):
        weights, jacobian = model.product_weights(values)
        residual = data.target.T - weights @ data.triangle.T
        columns = np.einsum("rp,mpc->mrc", data.triangle, jacobian)
        norms = np.linalg.norm(columns, axis=1)
        norms = np.where(norms > 0, norms, 1.0)
        # the pseudo-inverse also serves folds of a held-out choice that lack some coefficient
        inverse = np.linalg.pinv(np.asarray(columns / norms[:, None, :], dtype=np.float64), 1e-13)
        step = np.einsum("mcr,mr->mc", inverse, residual) / norms
        values = values + step
        information = np.einsum("mrc,mrd->mcd", columns, columns)
        if np.all(np.einsum("mc,mcd,md->m", step, information, step) < STEP_SIGMAS**2):
            break
    weights, _ = model.product_weights(values)
    residual = data.target.T - weights @ data.triangle.T
    return values, information, np.sum(residual**2, axis=1) + data.rest2


def independent(columns: FloatArray, share: float = 1e-6) -> FloatArray:
    """Return an orthonormal basis of the columns' span, shape (n, rank).

    Columns are brought to unit length first; directions below `share` of the largest are dropped.
    """
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > 0] / norms[norms > 0]
    if scaled.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    kept = values > max(share, 1e-11) * values[-1]
    basis = scaled @ (vectors[:, kept] / np.sqrt(values[kept]))
    # rounding leaves the columns this much short of orthonormal: 1e-10 at the least share but one
    return basis if share >= 1e-6 else np.linalg.qr(basis)[0]
