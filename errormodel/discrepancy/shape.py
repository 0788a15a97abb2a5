"""A smooth function of one quantity, for what follows it and has no name.

A broken line through knots whose second differences are penalised (a P-spline of first degree); the
penalty's weight is found by restricted maximum likelihood, as the variance of a random effect.
The line's smoothest directions, those of which the data tell more than the penalty does, are
its curves: they are what a model's term is made of.

References
----------
Eilers, P. H. C. and Marx, B. D. (1996), Flexible smoothing with B-splines and penalties,
Statistical Science 11.
Demmler, A. and Reinsch, C. (1975), Oscillation matrices with spline smoothing, Numer. Math. 24.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Signature
from errormodel.discrepancy.scan import View

MOST_KNOTS = 40
# A straight line is free, within what a bias and a slope may be: a share of the penalty's weight.
LINE_SHARE = 1e-4
VARIANCES = np.geomspace(1e-4, 1e10, 85)
# A curve of which the data tell less than this share is left to the penalty.
TOLD = 0.5
PER_CURVE = 4.0  # chi-square that a curve must explain, as one more parameter
# Share of a curve's length that must be left beside the model's own columns: what the model does
# already, but for the corners of a broken line, is no effect.
LEFT = 3e-3
INDEPENDENT = 1e-6  # share of the longest column below which a direction is rounding


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shape:
    """A smooth function of a quantity, as curves with free coefficients.

    Attributes
    ----------
    knots : ndarray, shape (m,)
        Values of the quantity.
    curves : ndarray, shape (k, m)
        Values of each curve at the knots, of rms one over the data; between knots a straight line,
        beyond them the value at the end.
    size : ndarray, shape (k,)
        Their coefficients, in the residual's unit.
    gain : float
        Chi-square explained.
    evidence : float
        By how much the log restricted likelihood rises.
    """

    knots: FloatArray
    curves: FloatArray
    size: FloatArray
    gain: float
    evidence: float

    @property
    def score(self) -> float:
        """Chi-square explained after the price of its curves."""
        return self.gain - PER_CURVE * self.size.size

    @property
    def values(self) -> FloatArray:
        """The function at the knots, shape (m,), in the residual's unit."""
        return self.size @ self.curves


def knots_of(x: FloatArray) -> FloatArray:
    """Return knots for a quantity: its levels where they are few, else its quantiles."""
    levels = np.unique(np.round(x, 6))
    if levels.size <= MOST_KNOTS:
        return levels
    even = np.linspace(float(x.min()), float(x.max()), MOST_KNOTS)
    # as many as there are data between them, and none far apart
    return np.unique(np.round(0.5 * (np.quantile(x, np.linspace(0, 1, MOST_KNOTS)) + even), 6))


def hats(x: FloatArray, knots: FloatArray) -> FloatArray:
    """Return broken lines that are one at one knot each, shape (n, m)."""
    return np.column_stack([np.interp(x, knots, row) for row in np.eye(knots.size)])


def fit_shape(view: View, x: FloatArray, times: FloatArray, knots: FloatArray) -> Shape | None:
    """Fit a smooth function of a quantity to what a model leaves.

    Parameters
    ----------
    view : View
        The problem of the model, under its noise.
    x : ndarray, shape (n,)
        The quantity.
    times : ndarray, shape (n,)
        What the function is multiplied by.
    knots : ndarray, shape (m,)

    Returns
    -------
    Shape or None
        None where the data tell nothing of any curve.
    """
    if knots.size < 2:
        return None
    columns = hats(x, knots) * times[:, None]
    white = view.white(columns)
    own = _own_directions(view, white)
    if own.shape[1] == 0:
        return None
    white = view.beside_base(white @ own)
    data = view.beside_base(view.data[:, None])[:, 0]
    root = np.linalg.cholesky(own.T @ _penalty(knots) @ own)
    to = np.linalg.inv(root).T  # of coefficients with a unit penalty
    strengths, axes = np.linalg.eigh(to.T @ (white.T @ white) @ to)
    strengths = np.maximum(strengths, 0.0)
    scores = axes.T @ (to.T @ (white.T @ data))
    evidence, variance = _likeliest(strengths, scores)
    told = variance * strengths / (1.0 + variance * strengths)
    kept = np.flatnonzero(told > TOLD)[::-1]
    if kept.size == 0 or evidence <= 0.0:
        return None
    worth = np.cumsum(scores[kept] ** 2 / strengths[kept] - PER_CURVE)
    kept = kept[: int(np.argmax(worth)) + 1]
    curves = (own @ to @ axes[:, kept]).T
    rms = np.sqrt(np.mean((columns @ curves.T) ** 2, axis=0))
    shown = rms > 0.0
    kept, curves, rms = kept[shown], curves[shown], rms[shown]
    curves = curves / rms[:, None]
    point = view.points([Signature(columns=columns @ curves.T)])
    gain = float(view.gains(point, view.data[:, None])[0, 0])
    size = scores[kept] / strengths[kept] * rms
    return Shape(knots=knots, curves=curves, size=size, gain=gain, evidence=evidence)


def _own_directions(view: View, white: FloatArray) -> FloatArray:
    """Return the coefficients of functions that the model does not have, shape (m, r).

    Under the noise they are at right angles to those that it has.
    """
    left, sizes, right = np.linalg.svd(white, full_matrices=False)
    seen = sizes > INDEPENDENT * sizes[0]
    beside = view.beside_base(left[:, seen])
    shares, axes = np.linalg.eigh(beside.T @ beside)
    return (right[seen].T / sizes[seen]) @ axes[:, shares > LEFT]


def _penalty(knots: FloatArray) -> FloatArray:
    """Return the penalty of a broken line: its squared second differences per knot spacing.

    In units of the range, so that its weight does not depend on the quantity's unit.
    """
    at = (knots - knots[0]) / (knots[-1] - knots[0])
    m = knots.size
    second = np.zeros((max(m - 2, 0), m))
    for k in range(m - 2):
        left, right = at[k + 1] - at[k], at[k + 2] - at[k + 1]
        second[k, k : k + 3] = 1.0 / left, -1.0 / left - 1.0 / right, 1.0 / right
        second[k] /= np.sqrt(0.5 * (left + right))
    bend = second.T @ second
    return bend + LINE_SHARE * (1.0 + np.trace(bend) / m**3) * np.eye(m)


def _likeliest(strengths: FloatArray, scores: FloatArray) -> tuple[float, float]:
    """Return the log restricted likelihood's rise at the best variance, and that variance."""
    v = VARIANCES[:, None]
    rise = 0.5 * np.sum(v * scores**2 / (1.0 + v * strengths) - np.log1p(v * strengths), axis=1)
    k = int(np.argmax(rise))
    return float(rise[k]), float(VARIANCES[k])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Formula:
    """A short formula in place of a smooth function.

    Attributes
    ----------
    family : str
        power, exponential, sine, kink or step.
    at : float
        Its nonlinear parameter, in the quantity's unit: a period, a constant, a place; of a power,
        its exponent.
    over : tuple of float
        The least value of the quantity, and its range.
    size : ndarray
        Its coefficients, in the residual's unit.
    gain : float
        Chi-square explained.
    parameters : int
        Coefficients and nonlinear parameters.
    """

    family: str
    at: float
    over: tuple[float, float]
    size: FloatArray
    gain: float
    parameters: int

    def values(self, x: FloatArray) -> FloatArray:
        """Return the formula at values of the quantity, in the residual's unit."""
        return _formula_columns(self.family, self.at, x, *self.over) @ self.size

    @property
    def amplitude(self) -> float:
        """The size as one number."""
        return float(np.sqrt(np.sum(self.size**2)))


def best_formula(view: View, x: FloatArray, times: FloatArray) -> Formula | None:
    """Return the short formula of a quantity that explains most, after a price for parameters."""
    if float(np.ptp(x)) <= 0.0:
        return None
    trials = list(_formulas(x))
    signatures = [Signature(columns=columns * times[:, None]) for _, _, columns in trials]
    points = view.points(signatures)
    gains = view.gains(points, view.data[:, None])[:, 0]
    free = np.array([c.shape[1] + (family != "power") for family, _, c in trials])
    k = int(np.argmax(gains - 2.0 * free))
    family, at, columns = trials[k]
    white = view.beside_base(view.white(columns * times[:, None]))
    size = np.linalg.lstsq(white, view.beside_base(view.data[:, None])[:, 0], rcond=1e-9)[0]
    return Formula(
        family=family,
        at=at,
        over=(float(x.min()), float(np.ptp(x))),
        size=size,
        gain=float(gains[k]),
        parameters=int(free[k]),
    )


def _formulas(x: FloatArray) -> Iterator[tuple[str, float, FloatArray]]:
    """Yield formulas: family, nonlinear parameter, columns."""
    lo, span = float(x.min()), float(np.ptp(x))
    for family, at in _families(lo, span):
        yield family, at, _formula_columns(family, at, x, lo, span)


def _families(lo: float, span: float) -> Iterator[tuple[str, float]]:
    for order in (1.0, 2.0, 3.0):
        yield "power", order
    for share in np.geomspace(0.02, 1.0, 18).tolist():
        yield "exponential", share * span
        yield "exponential", -share * span
    for cycles in np.arange(0.75, 13.0, 0.125).tolist():
        yield "sine", span / cycles
    for share in np.linspace(0.05, 0.95, 37).tolist():
        yield "kink", lo + share * span
        yield "step", lo + share * span


def _formula_columns(family: str, at: float, x: FloatArray, lo: float, span: float) -> FloatArray:
    """Return a formula's columns, shape (n, 1) or (n, 2)."""
    if family == "power":
        return ((x - lo - 0.5 * span)[:, None] / (0.5 * span)) ** at
    if family == "exponential":
        begin = lo if at > 0.0 else lo + span
        return np.exp(-(x - begin) / at)[:, None]
    if family == "sine":
        angle = 2.0 * np.pi * (x - lo) / at
        return np.column_stack([np.sin(angle), np.cos(angle)])
    if family == "kink":
        return np.maximum(x - at, 0.0)[:, None] / span
    return (x > at).astype(float)[:, None]
