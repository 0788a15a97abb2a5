"""Sigmas of groups of samples, estimated beside everything that may be missing."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Problem
from errormodel.linear import independent


class Scales:
    """Finds the sigma of each group of `Problem.scaled` in a residual.

    The sigma of a group is computed from the residual of its own samples after projecting out the
    saturated columns, so it contains neither the noise of another group nor a missing effect.
    """

    def __init__(self, problem: Problem) -> None:
        self._groups = [np.flatnonzero(group) for group in problem.scaled]
        self._spans = [independent(problem.saturated[rows]) for rows in self._groups]

    @property
    def free(self) -> tuple[int, ...]:
        """Degrees of freedom of each group's sigma."""
        pairs = zip(self._groups, self._spans, strict=True)
        return tuple(max(rows.size - span.shape[1], 1) for rows, span in pairs)

    def of(self, residual: FloatArray) -> FloatArray:
        """Return each group's sigma.

        Parameters
        ----------
        residual : ndarray, shape (n, D)

        Returns
        -------
        ndarray, shape (groups, D)
        """
        found = np.empty((len(self._groups), residual.shape[1]))
        for k, (rows, span) in enumerate(zip(self._groups, self._spans, strict=True)):
            own = residual[rows]
            seen = np.sum(own**2, axis=0) - np.sum((span.T @ own) ** 2, axis=0)
            found[k] = np.sqrt(np.maximum(seen, 0.0) / self.free[k])
        return found

    def normalised(self, residual: FloatArray) -> FloatArray:
        """Return a residual (n, D) over its groups' sigmas."""
        out = residual.copy()
        for rows, sigma in zip(self._groups, self.of(residual), strict=True):
            out[rows] /= sigma
        return out
