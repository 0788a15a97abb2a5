"""The design of a variance-component model, and its restricted likelihood with derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse import csgraph

from errormodel.arrays import FloatArray, IntArray, freeze, readonly_int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RandomFactor:
    """A random factor: `codes` says which level 0, 1, … each observation belongs to, shape (n,).

    A nested factor has codes of its own for every level of the one that holds it; `nested` makes
    them.
    """

    name: str
    codes: IntArray

    def __post_init__(self) -> None:
        freeze(self, codes=readonly_int(np.unique(self.codes, return_inverse=True)[1]))

    @classmethod
    def nested(cls, name: str, *parts: ArrayLike) -> "RandomFactor":
        """Make a factor whose levels are the combinations that occur of several labels."""
        codes = np.zeros(np.size(parts[0]), dtype=np.intp)
        for part in parts:
            label = np.unique(np.asarray(part), return_inverse=True)[1]
            codes = np.unique(codes * (label.max(initial=0) + 1) + label, return_inverse=True)[1]
        return cls(name=name, codes=codes)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evaluation:
    """Minus twice the restricted log-likelihood, its derivative and expected second derivative.

    Both by the logarithms of the variances, shapes (K + 1,) and (K + 1, K + 1), noise last.
    """

    deviance: float
    score: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Groups:
    """Cross products of the levels that share observations, G groups of at most q levels.

    Smaller groups are filled up with levels that nothing belongs to: they change no result.
    """

    zz: FloatArray  # (G, q, q)
    zx: FloatArray  # (G, q, p)
    zy: FloatArray  # (G, q)
    member: FloatArray  # (G, q, K): 1 where a level belongs to a factor


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VarianceDesign:
    """Everything the likelihood needs; observations are scaled to unit variance by `scale`.

    `within` is the mean square that no factor explains.
    """

    groups: _Groups
    xx: FloatArray
    xy: FloatArray
    yy: float
    n: int
    scale: float
    levels: tuple[int, ...]
    dof: tuple[int, ...]
    within: float

    def evaluate(self, variances: FloatArray) -> Evaluation:
        """Evaluate the restricted likelihood at variances (K + 1,), noise last.

        Where they differ by more than a matrix can hold the deviance is infinite.
        """
        try:
            return self._evaluate(variances)
        except np.linalg.LinAlgError:
            count = len(self.dof)
            nothing = np.zeros(count)
            return Evaluation(deviance=np.inf, score=nothing, information=np.eye(count))

    def _evaluate(self, variances: FloatArray) -> Evaluation:
        noise, g = float(variances[-1]), self.groups
        d = g.member @ np.sqrt(variances[:-1] / noise)
        zx, zy = d[:, :, None] * g.zx, d * g.zy
        m = d[:, :, None] * g.zz * d[:, None, :] + np.eye(d.shape[1])
        inverse = np.linalg.inv(m)
        w, u = inverse @ zx, np.einsum("gqr,gr->gq", inverse, zy)
        s: FloatArray = np.asarray(self.xx - np.einsum("gqa,gqb->ab", zx, w), dtype=np.float64)
        s_inv = np.linalg.inv(s)
        xy: FloatArray = np.asarray(self.xy - np.einsum("gqa,gq->a", zx, u), dtype=np.float64)
        beta = s_inv @ xy
        rest = (self.yy - float(np.sum(zy * u)) - float(xy @ beta)) / noise
        log_det = float(np.sum(np.linalg.slogdet(m)[1]) + np.linalg.slogdet(s)[1])
        score, information = self._derivatives(inverse, w, u - w @ beta, s_inv, rest, noise)
        deviance = (self.n - s.shape[0]) * float(np.log(noise)) + log_det + rest
        return Evaluation(deviance=deviance, score=score, information=information)

    def _derivatives(
        self,
        inverse: FloatArray,
        w: FloatArray,
        effect: FloatArray,
        s_inv: FloatArray,
        rest: float,
        noise: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return score and information from what solving left.

        With standardised effects, I − C (C their block of the inverse of Henderson's equations)
        is Zᵀ·P·Z: its traces and squares are all that is wanted. The noise's share follows from
        Σ_k v_k·∂V/∂v_k = V.
        """
        member, k = self.groups.member, len(self.dof) - 1
        b = np.eye(inverse.shape[1]) - inverse
        across = w @ s_inv @ np.swapaxes(w, 1, 2)
        trace = np.einsum("gqq,gqk->k", b - across, member)
        square = np.einsum("gq,gqk->k", effect**2, member) / noise
        gram = np.einsum("gqk,gqa,gqb->kab", member, w, w)
        within = np.swapaxes(member, 1, 2) @ (b * b - 2.0 * across * b) @ member
        products = within.sum(axis=0) + np.einsum("ab,kbc,cd,lda->kl", s_inv, gram, s_inv, gram)
        free = self.n - s_inv.shape[0]
        score = np.append(trace - square, free - trace.sum() - (rest - square.sum()))
        information = np.zeros((k + 1, k + 1))
        information[:k, :k] = products
        information[:k, k] = information[k, :k] = trace - products.sum(axis=1)
        information[k, k] = free - trace.sum() - information[:k, k].sum()
        return score, information


def make_design(
    y: FloatArray, factors: Sequence[RandomFactor], fixed: FloatArray
) -> VarianceDesign:
    """Reduce observations to cross products.

    Raises
    ------
    ValueError
        If shapes differ, a name is listed twice, or nothing is left to tell the noise by.
    """
    names = [f.name for f in factors]
    if len(set(names)) != len(names):
        raise ValueError("a factor is listed twice")
    wrong = [f.name for f in factors if f.codes.shape != y.shape]
    if wrong or fixed.shape[0] != y.size:
        raise ValueError(f"{', '.join(wrong) or 'fixed'}: expected {y.size} rows")
    levels = [int(f.codes.max(initial=-1)) + 1 for f in factors]
    z = np.hstack([np.zeros((y.size, 0)), *(_indicators(f.codes) for f in factors)])
    dof = stratum_degrees_of_freedom(factors, y.size, fixed)
    for name, count in zip([*names, "noise"], dof, strict=True):
        if count < 1:
            raise ValueError(
                f"{name} cannot be separated from the rest: no degree of freedom is left"
            )
    centred = y - fixed @ np.linalg.lstsq(fixed, y, rcond=None)[0]
    scale = float(np.sqrt(np.mean(centred**2))) or 1.0
    centred = centred / scale
    owner = np.repeat(np.arange(len(factors)), levels)
    groups = _groups(z, owner, fixed, centred, len(factors))
    yy = float(centred @ centred)
    inverse = np.linalg.pinv(groups.zz, hermitian=True)
    explained = float(np.einsum("gq,gqr,gr->", groups.zy, inverse, groups.zy))
    return VarianceDesign(
        groups=groups,
        xx=fixed.T @ fixed,
        xy=fixed.T @ centred,
        yy=yy,
        n=y.size,
        scale=scale,
        levels=(*levels, y.size),
        dof=dof,
        within=max(yy - explained, 0.0) / dof[-1],
    )


def stratum_degrees_of_freedom(
    factors: Sequence[RandomFactor], n: int, fixed: FloatArray | None = None
) -> tuple[int, ...]:
    """Return the degrees of freedom of each factor's stratum and of the noise of n observations."""
    columns = np.ones((n, 1)) if fixed is None else fixed
    everything = np.hstack([np.zeros((n, 0)), *(_indicators(f.codes) for f in factors)])
    strata = (_dof(factors, k, columns) for k in range(len(factors)))
    return (*strata, n - _rank(everything, columns))


def _indicators(codes: IntArray) -> FloatArray:
    return np.eye(int(codes.max(initial=-1)) + 1)[codes]


def _groups(
    z: FloatArray, owner: IntArray, fixed: FloatArray, y: FloatArray, count: int
) -> _Groups:
    zz = z.T @ z
    _, label = csgraph.connected_components(sparse.csr_array(zz), directed=False)
    members = [np.flatnonzero(label == number) for number in np.unique(label)]
    most = max((m.size for m in members), default=0)
    # one more level than there are, with nothing in it, fills the smaller groups up
    padded = np.pad(z, ((0, 0), (0, 1)))
    index = np.array([np.pad(m, (0, most - m.size), constant_values=z.shape[1]) for m in members])
    index = index.reshape(len(members), most).astype(np.intp)
    whole = padded.T @ padded
    kinds = np.vstack([np.eye(count)[owner], np.zeros((1, count))])
    return _Groups(
        zz=whole[index[:, :, None], index[:, None, :]],
        zx=(padded.T @ fixed)[index],
        zy=(padded.T @ y)[index],
        member=kinds[index],
    )


def _dof(factors: Sequence[RandomFactor], k: int, fixed: FloatArray) -> int:
    """Return the degrees of freedom of a factor's stratum, beside the factors that hold it."""
    mine = factors[k].codes
    coarser = [
        f.codes
        for j, f in enumerate(factors)
        if j != k and _holds(f.codes, mine) and not _holds(mine, f.codes)
    ]
    outer = np.hstack([np.zeros((mine.size, 0)), *(_indicators(c) for c in coarser)])
    return _rank(np.hstack([outer, _indicators(mine)]), fixed) - _rank(outer, fixed)


def _holds(outer: IntArray, inner: IntArray) -> bool:
    """Tell whether each level of `inner` lies within one level of `outer`."""
    pairs = len(np.unique(np.stack([outer, inner]), axis=1).T)
    return pairs == len(np.unique(inner))


def _rank(z: FloatArray, fixed: FloatArray) -> int:
    joint = np.hstack([z, fixed])
    return int(np.linalg.matrix_rank(joint.T @ joint, hermitian=True))
