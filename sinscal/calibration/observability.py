"""Observability of the parameters of a calibration, by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray

NOT_OBSERVED = 0.9  # of the prior's sigma left
CORRELATED = 0.9
NAMED = 0.25  # weight from which an unknown is named in a combination
GAUGE = (
    "A rotation about one point determines the sensing masses only relative to that point: "
    "lever_arm_* are measured from the centre of rotation. The position of the centre in the "
    "case is not determined; differences between the arms of two accelerometers are independent "
    "of it. Rotations about one axis do not determine arms along it."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two unknowns whose estimates go together."""

    names: tuple[str, str]
    correlation: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Observability:
    """Parameters that the data show, and those they do not.

    Attributes
    ----------
    singular_values : ndarray, shape (p,)
        Of the data's information against the prior's, largest first: s means that along one
        combination the prior's sigma shrinks by √(1 + s²).
    sigma_ratio : mapping of str to float
        Sigma left of the prior's, by name.
    not_observed : tuple of str
        Unknowns whose sigma the data did not reduce.
    combinations : tuple of mappings
        Combinations of observed unknowns that the data do not show: weights by name, in the
        prior's sigmas.
    correlated : tuple of Pair
    """

    singular_values: FloatArray
    sigma_ratio: Mapping[str, float]
    not_observed: tuple[str, ...]
    combinations: tuple[Mapping[str, float], ...]
    correlated: tuple[Pair, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The same in words; empty when everything is observed."""
        out: list[str] = []
        if self.not_observed:
            out.append(f"not observed: {', '.join(self.not_observed)}")
        for one in self.combinations:
            parts = " ".join(f"{w:+.2f}·{name}" for name, w in one.items())
            out.append(f"cannot be separated: {parts} (in sigmas of the prior) is not determined")
        for pair in self.correlated:
            out.append(f"{pair.names[0]} and {pair.names[1]} correlate by {pair.correlation:+.3f}")
        return tuple(out)


def observability(names: Sequence[str], cov: FloatArray, prior_sigmas: FloatArray) -> Observability:
    """Compare a covariance with the prior.

    Parameters
    ----------
    names : sequence of str, length p
    cov : ndarray, shape (p, p)
    prior_sigmas : ndarray, shape (p,)
        Unknowns of prior sigma 0 were not estimated and are left out.
    """
    free: list[int] = np.flatnonzero(prior_sigmas > 0.0).tolist()
    kept = [names[i] for i in free]
    relative = cov[np.ix_(free, free)] / np.outer(prior_sigmas[free], prior_sigmas[free])
    left = np.linalg.eigvalsh(relative)
    ratio = np.sqrt(np.diag(relative))
    seen: list[int] = np.flatnonzero(ratio <= NOT_OBSERVED).tolist()
    return Observability(
        singular_values=np.sqrt(np.maximum(1.0 / np.maximum(left, 1e-300) - 1.0, 0.0)),
        sigma_ratio=dict(zip(kept, ratio.tolist(), strict=True)),
        not_observed=tuple(n for n, r in zip(kept, ratio, strict=True) if r > NOT_OBSERVED),
        combinations=_combinations([kept[i] for i in seen], relative[np.ix_(seen, seen)]),
        correlated=_correlated(kept, relative),
    )


def _combinations(names: Sequence[str], relative: FloatArray) -> tuple[Mapping[str, float], ...]:
    left, axes = np.linalg.eigh(relative)
    out: list[Mapping[str, float]] = []
    for k in np.flatnonzero(left > NOT_OBSERVED**2).tolist():
        axis = axes[:, k] * np.sign(axes[np.argmax(np.abs(axes[:, k])), k])
        order: list[int] = np.argsort(-np.abs(axis)).tolist()
        out.append({names[i]: float(axis[i]) for i in order if abs(axis[i]) >= NAMED})
    return tuple(out)


def _correlated(names: Sequence[str], relative: FloatArray) -> tuple[Pair, ...]:
    sigma = np.sqrt(np.diag(relative))
    correlation = relative / np.outer(sigma, sigma)
    pairs = [
        Pair(names=(names[i], names[j]), correlation=float(correlation[i, j]))
        for i, j in np.argwhere(np.triu(np.ones_like(relative), 1) > 0).tolist()
        if abs(correlation[i, j]) > CORRELATED
    ]
    return tuple(sorted(pairs, key=lambda p: -abs(p.correlation)))
