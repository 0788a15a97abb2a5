"""Individuals and moving-range charts, with the chance that they speak without reason."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from errormodel.arrays import FloatArray, freeze, readonly

# With fewer values the limits are hardly known, and there is no verdict.
MIN_VALUES = 8
# Textbook constants of moving ranges of two: E|x₁ − x₂| = 1.128 σ, and D4.
INDIVIDUALS = 3.0 / (2.0 / np.sqrt(np.pi))
RANGES = 3.267
DRAWS = 20_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Chart:
    """An individuals and moving-range chart.

    Attributes
    ----------
    values : ndarray, shape (n,)
    ranges : ndarray, shape (n − 1,)
        |difference| of neighbours.
    centre : float
    limits : pair of float or None
        Of the values: centre ± 2.66 mean ranges; None with fewer than 8 values.
    range_limit : float or None
        Of the ranges: 3.267 mean ranges.
    outside : tuple of int
        Values outside, or ending a range that is; empty without limits.
    false_alarm : float or None
        How often a chart of as many values from a steady process has a point outside.
    """

    values: FloatArray
    ranges: FloatArray
    centre: float
    limits: tuple[float, float] | None
    range_limit: float | None
    outside: tuple[int, ...]
    false_alarm: float | None

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), ranges=readonly(self.ranges))


def individuals_chart(values: ArrayLike) -> Chart:
    """Make a chart of values in their order.

    Parameters
    ----------
    values : array_like, shape (n,)

    Returns
    -------
    Chart
        Without limits when there are fewer than 8 values.

    References
    ----------
    Textbook constants (Montgomery, Introduction to Statistical Quality Control): σ = mean
    range/1.128, limits ± 3 σ, 3.267 mean ranges.
    """
    x = np.asarray(values, dtype=float)
    ranges = np.abs(np.diff(x))
    centre = float(x.mean())
    if x.size < MIN_VALUES:
        return Chart(
            values=x, ranges=ranges, centre=centre, limits=None, range_limit=None, outside=(),
            false_alarm=None,
        )  # fmt: skip
    mean_range = float(ranges.mean())
    half = INDIVIDUALS * mean_range
    return Chart(
        values=x,
        ranges=ranges,
        centre=centre,
        limits=(centre - half, centre + half),
        range_limit=RANGES * mean_range,
        outside=tuple(np.flatnonzero(_outside(x[None])[0]).tolist()),
        false_alarm=false_alarm(x.size),
    )


def _outside(x: FloatArray) -> FloatArray:
    """Return which values of charts (m, n) are outside, themselves or by the range before them."""
    ranges = np.abs(np.diff(x, axis=1))
    mean_range = ranges.mean(axis=1, keepdims=True)
    out = np.abs(x - x.mean(axis=1, keepdims=True)) > INDIVIDUALS * mean_range
    out[:, 1:] |= ranges > RANGES * mean_range
    return out


@cache
def false_alarm(n: int) -> float:
    """Return the share of charts of n steady normal values that have a point outside.

    By simulation of 20,000 charts: within 0.4 %.
    """
    draws = np.random.default_rng(n).standard_normal((DRAWS, n))
    return float(np.mean(_outside(draws).any(axis=1)))
