"""Foresight: effects that a measurement can show, before its residual is looked at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Signature, columns_of
from errormodel.discrepancy.scan import NOTHING, ROUNDING, View

# An effect is expected to be named at this whitened strength (seven of its own sigmas).
NAMEABLE_D = 7.0
# From this share on, one pattern can replace another.
SAME = 0.98


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Foresight:
    """Visibility of each candidate in a measurement.

    Attributes
    ----------
    names : tuple of str
    strength : ndarray, shape (m,)
        Whitened length of the first visible column, at the middle of its grid, per unit of its
        size; 0 for an effect without a size.
    least_theta : dict of str to float
        For an effect with a nonlinear parameter as its size: the value at which it reaches
        `NAMEABLE_D`.
    invisible : tuple of str
        Effects that the measurement does not show.
    imitated : ndarray, shape (m, m)
        Share of effect i that effect j can imitate beside the baseline.
    """

    names: tuple[str, ...]
    strength: FloatArray
    least_theta: dict[str, float]
    invisible: tuple[str, ...]
    imitated: FloatArray

    def partners(self, name: str) -> tuple[str, ...]:
        """Return the effects that can imitate the named one at any size."""
        if name not in self.names:
            return ()
        row = self.imitated[self.names.index(name)]
        return tuple(n for n, s in zip(self.names, row, strict=True) if s > SAME and n != name)


def foresee_candidates(view: View, candidates: Sequence[Candidate]) -> Foresight:
    """Return the visibility of each candidate under a noise.

    Parameters
    ----------
    view : View
    candidates : sequence of Candidate
    """
    middle = [columns_of(c.grid_signatures[len(c.grid) // 2])[:, 0] for c in candidates]
    targets = view.beside_base(view.white(np.column_stack(middle)))
    total = np.sum(targets**2, axis=0)
    imitated = np.zeros((len(candidates), len(candidates)))
    invisible: list[str] = []
    for j, candidate in enumerate(candidates):
        linear = [Signature(columns=columns_of(s)) for s in candidate.grid_signatures]
        points = view.points(linear)
        if not any(p.basis.shape[1] for p in points):
            invisible.append(candidate.name)
            continue
        gains = view.gains(points, targets).max(axis=0)
        imitated[:, j] = np.divide(gains, total, out=np.zeros_like(gains), where=total > 1e-12)
    least = {c.name: _least(view, c) for c in candidates if c.grid_signatures[0].offset is not None}
    seen = np.array([_seen(view, c) for c in candidates])
    strength = seen * np.array([c.name not in least for c in candidates])
    return Foresight(
        names=tuple(c.name for c in candidates),
        strength=strength,
        least_theta={n: v for n, v in least.items() if np.isfinite(v)},
        invisible=tuple(invisible),
        imitated=np.clip(imitated, 0.0, 1.0),
    )


def _seen(view: View, candidate: Candidate) -> float:
    """Return the whitened length of an effect's first column that the measurement shows."""
    middle = columns_of(candidate.grid_signatures[len(candidate.grid) // 2])
    white = view.white(middle)
    left = np.linalg.norm(view.beside_base(white), axis=0)
    shown = left > NOTHING * np.linalg.norm(white, axis=0) + ROUNDING
    return float(left[np.argmax(shown)]) if shown.any() else 0.0


def _least(view: View, candidate: Candidate) -> float:
    """Return the smallest parameter at which an effect without a coefficient can be named."""
    strengths = np.array([view.strength(s) for s in candidate.grid_signatures])
    values = np.array([theta[0] for theta in candidate.grid])
    enough = np.flatnonzero(strengths >= NAMEABLE_D)
    if enough.size == 0:
        return float("nan")
    k = int(enough[0])
    if k == 0:
        return float(values[0])
    below, above = np.log(np.maximum(strengths[k - 1 : k + 1], 1e-12)).tolist()
    part = (np.log(NAMEABLE_D) - below) / max(above - below, 1e-12)
    return float(values[k - 1] * (values[k] / values[k - 1]) ** part)
