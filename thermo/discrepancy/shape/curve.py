"""A shape's function as fitted, with its sigma; and what readings say of it."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.shape.pattern import factor_by_block
from thermo.discrepancy.words import fitted_covariance
from thermo.library.effects import MICRO

# Readings where a shape's factor is a smaller share of its largest say little of the function.
LEAST_FACTOR = 0.3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeCurve:
    """A function of a quantity.

    Attributes
    ----------
    x : ndarray, shape (m,)
        Its knots.
    values, sigmas : ndarray, shape (m,)
        The function there, as fitted beside the whole model, 1 sigma.
    unit : str
        "µg", or "ppm" of what is in proportion to the input.
    """

    x: FloatArray
    values: FloatArray
    sigmas: FloatArray
    unit: str


def shape_curve(d: Discrepancy) -> ShapeCurve:
    """Return the function of a verdict's shape, as it stands in the larger model."""
    assert d.shape is not None
    pattern = d.shape.pattern
    curves = pattern.shape.curves
    names = [f"{d.shape.name}_{k + 1}" for k in range(len(curves))]
    rows = [d.after.free.index(name) for name in names]
    size = MICRO * np.array([d.after.values[name] for name in names])
    covariance = MICRO**2 * fitted_covariance(d.after, d.source, d.floor)[np.ix_(rows, rows)]
    variances = np.einsum("km,kl,lm->m", curves, covariance, curves)
    return ShapeCurve(
        x=pattern.shape.knots,
        values=size @ curves,
        sigmas=np.sqrt(np.maximum(variances, 0.0)),
        unit="ppm" if pattern.times == "input" else "µg",
    )


def readings_of_shape(d: Discrepancy) -> tuple[FloatArray, FloatArray]:
    """Return the quantity by block, and the function plus what the larger model leaves.

    Divided by what the function is multiplied by; blocks where that is small are left out.
    """
    assert d.shape is not None
    pattern, curve = d.shape.pattern, shape_curve(d)
    x, times = factor_by_block(d.source.seen, pattern.quantity, pattern.times)
    kept = np.abs(times) > LEAST_FACTOR * float(np.max(np.abs(times)))
    function = np.interp(x[kept], curve.x, curve.values)
    return x[kept], function + d.after.residual[kept] / times[kept]
