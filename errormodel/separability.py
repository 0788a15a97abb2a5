"""Separability of a model's parameters by data, told by name before a number is given."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.linear import triangle_of

# Partners in a confounded group take part with at least this share of the largest.
PARTNER_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Separability:
    """Parameters that a set of regressors can and cannot separate.

    `confounded` holds groups of names that can only be had in combination (a group of one: no
    effect at all).
    """

    confounded: tuple[tuple[str, ...], ...]


def separability(
    columns: FloatArray,
    names: Sequence[str],
    min_shares: Sequence[float],
) -> Separability:
    """Find the unknowns that columns cannot separate.

    An unknown is not separable when the others reproduce its column but for `min_shares` of its
    length.

    Parameters
    ----------
    columns : ndarray, shape (n, p)
        Derivative of the model by its unknowns, whitened or not.
    names : sequence of str, length p
    min_shares : sequence of float, length p
    """
    p = columns.shape[1]
    if p == 0:
        return Separability(confounded=())
    norms = np.linalg.norm(columns, axis=0)
    present = norms > 0
    scaled = columns / np.where(present, norms, 1.0)
    triangle = triangle_of(scaled)
    groups: list[set[str]] = [{names[j]} for j in range(p) if not present[j]]
    seen: list[int] = np.flatnonzero(present).tolist()
    for j in seen:
        others = [k for k in seen if k != j]
        weights, left = _explain(triangle[:, j], triangle[:, others])
        if left < min_shares[j]:
            size = np.abs(weights)
            partners = {
                names[k]
                for k, s in zip(others, size, strict=False)
                if s > PARTNER_SHARE * size.max()
            }
            groups.append({names[j]} | partners)
    return Separability(confounded=_merged(groups, names))


def _explain(column: FloatArray, others: FloatArray) -> tuple[FloatArray, float]:
    """Return the weights of `others` that come nearest to a column, and the share left over."""
    if others.shape[1] == 0:
        return np.zeros(1), 1.0
    weights, *_ = linalg.lstsq(others, column, cond=1e-8)
    return weights, float(np.linalg.norm(column - others @ weights))


def _merged(groups: list[set[str]], names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Join groups that share a name; order names as the model does."""
    joined: list[set[str]] = []
    for group in groups:
        touching = [g for g in joined if g & group]
        joined = [g for g in joined if not g & group] + [set().union(group, *touching)]
    rank = {name: i for i, name in enumerate(names)}
    ordered = [tuple(sorted(g, key=rank.__getitem__)) for g in joined]
    return tuple(sorted(ordered, key=lambda g: rank[g[0]]))
