"""Restricted likelihood (REML) of residuals under a noise: that of the error contrasts.

What the regressors absorb of the noise is accounted for, and the white sigma is profiled out.
`RestrictedLikelihood` has regressors that stand whole and any number of residuals;
`BlockLikelihood` has one residual and regressors that come in blocks, some or all of them each
run's own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.blocks import Blocked, parts_of_runs
from errormodel.linear import independent, triangle_of
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import BlockWhitener, TimeBase, Whitener
from errormodel.record import Record

HARDLY = 1e-6  # of the longest regressor: shorter, it is not there


def profiled(rest2: FloatArray, log_det: float, dof: int) -> tuple[FloatArray, FloatArray]:
    """Return restricted log-likelihoods, profiled over the white sigma, and that sigma.

    Parameters
    ----------
    rest2 : ndarray
        Squared lengths of whitened residuals beside the regressors, in units of the white sigma.
    log_det : float
        ln det of the noise's covariance and of the whitened regressors' Gram matrix.
    dof : int
        Samples less regressors.

    References
    ----------
    Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
    related problems, JASA 72, eq. for the restricted likelihood.
    """
    sigma2 = np.maximum(rest2 / dof, np.finfo(float).tiny)
    return -0.5 * (log_det + dof * np.log(sigma2)), np.sqrt(sigma2)


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Whitening by one noise with the regressors projected out.

    `basis` (n, p) spans the whitened regressors; `log_det` is that of the covariance and of their
    Gram matrix.
    """

    whitener: Whitener
    basis: FloatArray
    log_det: float

    def beside(self, columns: FloatArray) -> FloatArray:
        """Return columns whitened, the regressors projected out."""
        white = self.whitener.whiten(columns)
        return white - self.basis @ (self.basis.T @ white)


class RestrictedLikelihood:
    """Restricted likelihood of residuals beside regressors (n, m), by noise."""

    def __init__(self, times: TimeBase, regressors: FloatArray) -> None:
        self.times = times
        self.mean = independent(regressors)
        self.dof = max(len(times) - self.mean.shape[1], 1)

    def evaluate(self, noise: NoiseModel, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log-likelihoods and white sigmas of residuals (n, D), each of shape (D,)."""
        whitener = noise.whitener(self.times)
        mean, data = whitener.whiten(self.mean), whitener.whiten(residuals)
        factor, log_det = _factor(whitener, mean)
        inner = linalg.solve_triangular(factor, mean.T @ data, lower=True, check_finite=False)
        rest2 = np.sum(data**2, axis=0) - np.sum(inner**2, axis=0)
        return profiled(rest2, log_det, self.dof)

    def projection(self, noise: NoiseModel) -> Projection:
        """Return the whitening that leaves the regressors out, once for many columns."""
        whitener = noise.whitener(self.times)
        mean = whitener.whiten(self.mean)
        factor, log_det = _factor(whitener, mean)
        basis = linalg.solve_triangular(factor, mean.T, lower=True, check_finite=False).T
        return Projection(whitener, basis, log_det)

    def beside(
        self, noise: NoiseModel, residual: FloatArray, columns: Sequence[FloatArray]
    ) -> FloatArray:
        """Return the log-likelihoods of a residual with more columns in the mean, one a set.

        The mean is projected out once for all sets (Frisch and Waugh); how well the columns are
        determined is left out of account: it is the same for every noise but for a few units.
        """
        projection = self.projection(noise)
        rest = projection.beside(residual)
        made: list[float] = []
        for own in columns:
            white = independent(projection.beside(own)) if own.shape[1] else own
            left = float(rest @ rest) - float(np.sum((white.T @ rest) ** 2))
            dof = max(self.dof - white.shape[1], 1)
            made.append(-0.5 * (projection.log_det + dof * float(np.log(left / dof))))
        return np.array(made)


def _factor(whitener: Whitener, mean: FloatArray) -> tuple[FloatArray, float]:
    """Return the Cholesky factor of whitened regressors' Gram matrix, and ln det of all."""
    factor = np.asarray(linalg.cholesky(mean.T @ mean, lower=True, check_finite=False))
    return factor, whitener.log_det + 2.0 * float(np.sum(np.log(np.diag(factor))))


class BlockLikelihood:
    """Restricted likelihood of one residual beside regressors in blocks, by noise.

    Regressors and residual are brought to unit length. Each run may have parameters of its own.

    Parameters
    ----------
    record : Record
    residual : ndarray, shape (n,)
    columns : Blocked, shape (n, p)
        The regressors.
    own : bool
        Whether each run has parameters of its own.
    own_columns : sequence of int
        Regressors of which each run has a parameter of its own, where not all are.
    """

    def __init__(
        self,
        record: Record,
        residual: FloatArray,
        columns: Blocked,
        *,
        own: bool,
        own_columns: Sequence[int] = (),
    ) -> None:
        self.record, self.residual, self.columns = record, residual, columns
        self.width = columns.shape[1] + 1
        runs = record.run_slices
        self.own_columns = list(own_columns) if len(runs) > 1 else []
        self.others = [k for k in range(self.width) if k not in self.own_columns]
        apart = own or bool(self.own_columns)
        self.groups = runs if apart else (slice(0, len(record)),)
        parameters = self.width - 1
        if self.own_columns:
            parameters += (len(self.groups) - 1) * len(self.own_columns)
        elif own:
            parameters *= len(self.groups)
        self.dof = max(len(record) - parameters, 1)
        self.norms = np.ones(self.width)
        squares = np.zeros(self.width)
        for _, joint in self._joint():
            squares += np.sum(joint**2, axis=0)
        norms = np.sqrt(squares)
        self.scale = float(norms[-1])
        self.norms = np.where(norms > 0, norms, 1.0)

    def evaluate(self, noise: NoiseModel) -> tuple[float, float]:
        """Return the log-likelihood of a noise of unit white sigma, and the white sigma found.

        The sigma is in units of the residual's length, `scale`.
        """
        if self.own_columns:
            rest2, log_seen, log_det = self._apart(noise)
        else:
            rest2, log_seen, log_det = self._together(noise)
        value, sigma = profiled(np.array(rest2), log_det + 2.0 * log_seen, self.dof)
        return float(value), float(sigma)

    def _apart(self, noise: NoiseModel) -> tuple[float, float, float]:
        """Eliminate first the parameters that each run has of its own."""
        left, log_seen = np.zeros((len(self.others),) * 2), 0.0
        mine = len(self.own_columns)
        order = [*self.own_columns, *self.others]
        grams, log_det = self._grams(noise)
        for gram in grams:
            root = _root(gram[np.ix_(order, order)])
            log_seen += _log_of_seen(np.diag(root)[:mine])
            rest = root[mine:, mine:]
            left += rest.T @ rest
        diagonal = np.diag(_root(left))
        return float(diagonal[-1]) ** 2, log_seen + _log_of_seen(diagonal[:-1]), log_det

    def _together(self, noise: NoiseModel) -> tuple[float, float, float]:
        rest2, log_seen = 0.0, 0.0
        diagonals, log_det = self._triangle_diagonals(noise)
        for diagonal in diagonals:
            rest, inner = diagonal[-1], diagonal[:-1]
            seen = inner[inner > 1e-9 * inner.max(initial=0.0)]
            rest2 += float(rest) ** 2
            log_seen += float(np.sum(np.log(seen)))
        return rest2, log_seen, log_det

    def _grams(self, noise: NoiseModel) -> tuple[list[FloatArray], float]:
        """Return the Gram matrix of each group's whitened columns, and ln det of all."""
        grams: list[FloatArray] = [np.zeros((self.width, self.width)) for _ in self.groups]
        whitener = noise.block_whitener(self.width)
        for number, white in self._whitened(whitener):
            grams[number] += white.T @ white
        return grams, whitener.log_det

    def _triangle_diagonals(self, noise: NoiseModel) -> tuple[list[FloatArray], float]:
        """Return the diagonals of R of the groups' QR factorisations, without signs, and ln det."""
        grams, log_det = self._grams(noise)
        try:  # the columns are of unit length and few: their Gram matrix keeps enough digits
            return [np.diag(linalg.cholesky(g, check_finite=False)) for g in grams], log_det
        except linalg.LinAlgError:
            triangles: list[FloatArray] = [np.zeros((0, self.width)) for _ in self.groups]
            for number, white in self._whitened(noise.block_whitener(self.width)):
                triangles[number] = triangle_of(white, triangles[number])
            return [np.abs(np.diag(t)) if len(t) else np.zeros(self.width) for t in triangles], (
                log_det
            )

    def _whitened(self, whitener: BlockWhitener) -> Iterator[tuple[int, FloatArray]]:
        """Yield whitened columns of readings of one group, with the group; runs begin afresh."""
        for rows, joint in self._joint():
            white = whitener.whiten(self.record.view(rows), joint)
            for number, part in parts_of_runs(self.groups, rows):
                yield number, white[part.start - rows.start : part.stop - rows.start]

    def _joint(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with their columns and residual, of unit length."""
        for rows, block in self.columns.blocks():
            joint = np.empty((block.shape[0], self.width))
            np.divide(block, self.norms[:-1], out=joint[:, :-1])
            np.divide(self.residual[rows], self.norms[-1], out=joint[:, -1])
            yield rows, joint


def _root(gram: FloatArray) -> FloatArray:
    """Return the upper Cholesky factor; a column that the others hold gets hardly a length."""
    ridge = HARDLY**2 * np.eye(gram.shape[0])
    longest = float(np.diag(gram).max(initial=0.0))
    return np.asarray(linalg.cholesky(gram + ridge * longest, check_finite=False))


def _log_of_seen(diagonal: FloatArray) -> float:
    seen = diagonal[diagonal > 10.0 * HARDLY * diagonal.max(initial=0.0)]
    return float(np.sum(np.log(seen)))
