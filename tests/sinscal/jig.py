"""A triad turned about one axis through known angles: a = b + C cos θ + S sin θ on each channel.

The fixture's angle is taken as true. Amplitude √(C² + S²) is the channel's sensitivity times the
share of gravity it sees: a sensing channel's is its scale times g, a channel along the axis has
what its misalignment lets through.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError, NotSeparableError

FEWEST = 4
CONDITION = 1e-3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JigFit:
    """Bias and first harmonic of each of c channels.

    Attributes
    ----------
    values : ndarray, shape (c, 3)
        b, C, S in the readings' unit.
    cov : ndarray, shape (c, 3, 3)
        From the scatter of the residuals about the fit.
    residual : ndarray, shape (k, c)
    """

    values: FloatArray
    cov: FloatArray
    residual: FloatArray

    def __post_init__(self) -> None:
        freeze(self, **{name: readonly(getattr(self, name)) for name in ("values", "cov")})
        freeze(self, residual=readonly(self.residual))

    @property
    def bias(self) -> FloatArray:
        """Readings without gravity, shape (c,)."""
        return self.values[:, 0]

    @property
    def amplitude(self) -> FloatArray:
        """Of the harmonic, shape (c,)."""
        return np.hypot(self.values[:, 1], self.values[:, 2])

    @property
    def amplitude_sigma(self) -> FloatArray:
        """Standard deviation of `amplitude`, shape (c,)."""
        along = self.values[:, 1:] / self.amplitude[:, None]
        return np.sqrt(np.einsum("ci,cij,cj->c", along, self.cov[:, 1:, 1:], along))

    @property
    def phase_rad(self) -> FloatArray:
        """Angle at which each channel reads most, shape (c,)."""
        return np.arctan2(self.values[:, 2], self.values[:, 1])

    @property
    def rms(self) -> FloatArray:
        """Of the residuals, shape (c,)."""
        return np.sqrt(np.mean(self.residual**2, axis=0))


def fit_jig(angle_rad: FloatArray, means: FloatArray, *, source: str = "the jig") -> JigFit:
    """Fit bias and harmonic to mean readings at known angles, equal weights.

    Parameters
    ----------
    angle_rad : ndarray, shape (k,)
    means : ndarray, shape (k, c)

    Raises
    ------
    InputError
        If there are fewer than four angles.
    NotSeparableError
        If the angles lie too close together.
    """
    k = angle_rad.size
    if k < FEWEST:
        raise InputError(source, "", f"{k} angles, expected {FEWEST} at least")
    design = np.column_stack([np.ones(k), np.cos(angle_rad), np.sin(angle_rad)])
    singular = np.linalg.svd(design, compute_uv=False)
    if singular[-1] < CONDITION * singular[0]:
        raise NotSeparableError([["bias", "cos", "sin"]], source)
    values = np.linalg.lstsq(design, means)[0]
    residual = means - design @ values
    variance = np.sum(residual**2, axis=0) / (k - 3)
    cov = variance[:, None, None] * np.linalg.inv(design.T @ design)
    return JigFit(values=values.T, cov=cov, residual=residual)
