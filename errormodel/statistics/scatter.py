"""Scatter between runs of a value that is itself estimated in each run with a known sigma.

Value of run i: ``c_i = μ + b_i + e_i`` with ``b_i ~ N(0, τ²)`` between runs and
``e_i ~ N(0, s_i²)`` from the estimation. What repeats badly is τ, not the scatter of the c_i: that
has the e_i in it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special, stats

from errormodel.arrays import FloatArray

Limits = tuple[float, float]
TAIL = 0.025  # beyond each 95 % limit
MANY = 1e7  # degrees of freedom, as good as infinite


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Scatter of a value from run to run; everything in the value's unit.

    Attributes
    ----------
    n : int
        Runs.
    mean, mean_sigma : float
        Weighted by 1/(τ² + s²).
    sigma_run : float
        Standard deviation between runs (τ), the estimation's share taken out.
    ci95 : pair of float
        Its 95 % limits; exact when the estimation's sigmas are.
    sigma_runs_observed : float
        Plain standard deviation of the estimates.
    sigma_estimation : float
        Root mean square of the s_i.
    max_minus_min : float
        Of the estimates.
    max_minus_min_ci95 : pair of float
        Hold the range of the true values of these runs in 95 % of cases or more.
    trend_per_run, trend_p : float or None
        Slope per unit of `order`, and how often chance alone gives as steep a one (t, n − 2
        degrees of freedom); None with two runs.
    trend_share : float
        Share of the sum of squares that the straight line explains.
    """

    n: int
    mean: float
    mean_sigma: float
    sigma_run: float
    ci95: Limits
    sigma_runs_observed: float
    sigma_estimation: float
    max_minus_min: float
    max_minus_min_ci95: Limits
    trend_per_run: float | None
    trend_p: float | None
    trend_share: float = 0.0


def scatter_between(
    values: ArrayLike,
    sigmas: ArrayLike,
    *,
    order: ArrayLike | None = None,
    sigma_dof: float = np.inf,
) -> Scatter:
    """Tell the scatter between runs from the scatter of their estimates.

    Parameters
    ----------
    values : array_like, shape (n,)
        Estimates c_i, n ≥ 2.
    sigmas : array_like, shape (n,)
        Their standard deviations s_i ≥ 0.
    order : array_like, shape (n,), optional
        What a trend is sought along; default 0, 1, ….
    sigma_dof : float
        Degrees of freedom that the sigmas are known to, by one factor common to them.

    Returns
    -------
    Scatter

    Raises
    ------
    ValueError
        If there are fewer than two values, or sigmas that are negative or not as many.

    References
    ----------
    Paule and Mandel (1982), J. Res. NBS 87, 377 (the estimate: Q(τ²) = n − 1, which for equal
    sigmas is the restricted maximum likelihood); Viechtbauer (2007), Stat. Med. 26, 37 (limits by
    the χ² law of Q; with all s_i = 0 the χ² limits of a sample's sigma).
    """
    c, s = np.asarray(values, dtype=float), np.asarray(sigmas, dtype=float)
    if c.ndim != 1 or c.size < 2 or s.shape != c.shape or not np.all(s >= 0):
        raise ValueError("expected two values or more, with a sigma ≥ 0 each")
    n = c.size
    observed = float(np.std(c, ddof=1))
    tau2 = _solve(c, s, lambda _: float(n - 1))
    weights = _weights(tau2, s, observed)
    along = np.arange(n, dtype=float) if order is None else np.asarray(order, dtype=float)
    slope, p = trend(c, along)
    return Scatter(
        n=n,
        mean=float(weights @ c / weights.sum()),
        mean_sigma=float(1.0 / np.sqrt(weights.sum())),
        sigma_run=float(np.sqrt(tau2)),
        ci95=_limits(c, s, TAIL, sigma_dof),
        sigma_runs_observed=observed,
        sigma_estimation=float(np.sqrt(np.mean(s**2))),
        max_minus_min=float(np.ptp(c)),
        max_minus_min_ci95=range_bounds(c, s, 2 * TAIL, sigma_dof),
        trend_per_run=slope,
        trend_p=p,
        trend_share=float(np.corrcoef(along, c)[0, 1] ** 2) if p is not None and np.ptp(c) else 0.0,
    )


def sigma_bounds(
    values: ArrayLike, sigmas: ArrayLike, alpha: float, sigma_dof: float = np.inf
) -> Limits:
    """Return a lower and an upper bound of τ, each wrong in a share `alpha` of cases."""
    c, s = np.asarray(values, dtype=float), np.asarray(sigmas, dtype=float)
    return _limits(c, s, alpha, sigma_dof)


def _limits(c: FloatArray, s: FloatArray, tail: float, sigma_dof: float) -> Limits:
    """Return where Q(τ²) equals the quantiles that leave `tail` outside on either side.

    With sigmas known to ν degrees of freedom Q/(n − 1) is a ratio of mean squares: F, whose
    denominator τ² + s² has ν·((τ² + s²)/s²)² degrees of freedom (Satterthwaite 1946). Estimates
    that agree better than their sigmas allow would give an upper limit of 0; then it is that of
    the whole scatter, which τ cannot exceed.
    """
    dof = c.size - 1
    s2 = float(np.mean(s**2))

    def quantile(tau2: float, probability: float) -> float:
        if not np.isfinite(sigma_dof) or s2 == 0.0:
            return float(stats.chi2.ppf(probability, dof))
        known_to = sigma_dof * ((tau2 + s2) / s2) ** 2
        return dof * float(special.fdtri(dof, min(known_to, MANY), probability))

    lo = _solve(c, s, lambda tau2: quantile(tau2, 1.0 - tail))
    hi = _solve(c, s, lambda tau2: quantile(tau2, tail))
    if hi == 0.0:
        hi = float(np.var(c, ddof=1)) * dof / float(stats.chi2.ppf(tail, dof))
    return float(np.sqrt(lo)), float(np.sqrt(hi))


def _weights(tau2: float, s: FloatArray, observed: float) -> FloatArray:
    if tau2 == 0.0 and not np.any(s > 0.0):  # all equal and exact: any weight does
        return np.ones_like(s)
    return 1.0 / np.maximum(tau2 + s**2, (1e-9 * max(observed, float(s.max()))) ** 2)


def _solve(c: FloatArray, s: FloatArray, target: Callable[[float], float]) -> float:
    """Return the τ² at which Q, the weighted sum of squares about the weighted mean, is `target`.

    Q falls with τ²; 0 where it is below `target` from the start.
    """
    total = float(np.sum((c - c.mean()) ** 2))
    if total == 0.0:
        return 0.0
    floor = (1e-6 * s.max()) ** 2 + 1e-18 * total

    def excess(tau2: float) -> float:
        w = 1.0 / (tau2 + s**2 + floor)
        mean = w @ c / w.sum()
        return float(w @ (c - mean) ** 2) - target(tau2)

    if excess(0.0) <= 0.0:
        return 0.0
    top = total  # with any s Q is at most total/τ²
    while excess(top) > 0.0:
        top *= 4.0
    return float(optimize.brentq(excess, 0.0, top, xtol=1e-12 * top, rtol=1e-10))


def trend(c: FloatArray, order: FloatArray) -> tuple[float | None, float | None]:
    """Return the slope along `order` and its two-sided p-value (t law, n − 2 degrees of freedom).

    Exact for values with normal errors of one size. None with fewer than three values.
    """
    if c.size < 3 or np.ptp(order) == 0.0:
        return None, None
    x = order - order.mean()
    slope = float(x @ c / (x @ x))
    rest = float(np.sum((c - c.mean() - slope * x) ** 2))
    if rest <= 1e-24 * float(np.sum((c - c.mean()) ** 2)):
        return slope, (1.0 if slope == 0.0 else 0.0)
    t = slope / np.sqrt(rest / (c.size - 2) / (x @ x))
    return slope, float(2.0 * stats.t.sf(abs(t), c.size - 2))


def range_bounds(
    values: ArrayLike, sigmas: ArrayLike, alpha: float, sigma_dof: float = np.inf
) -> Limits:
    """Return bounds of the range of the true values, together wrong in a share `alpha` or less.

    A range is a seminorm: the range of the estimates and that of the true values differ by the
    range of the errors at most, which the largest of the sigmas bounds.
    """
    c, s = np.asarray(values, dtype=float), np.asarray(sigmas, dtype=float)
    width = float(np.ptp(c))
    slack = float(s.max()) * range_quantile(c.size, 1.0 - alpha, sigma_dof)
    return max(0.0, width - slack), width + slack


def range_quantile(n: int, probability: float, sigma_dof: float = np.inf) -> float:
    """Return the quantile of the range of n normal values over their sigma.

    The sigma is known to `sigma_dof` degrees of freedom (the studentised range); with infinitely
    many it is that of standard normal values.
    """
    if sigma_dof < MANY:  # to 3 %, so that the values can be kept
        sigma_dof = float(np.exp(0.03 * np.floor(np.log(sigma_dof) / 0.03)))
    return _range_quantile(n, probability, sigma_dof)


@cache
def _range_quantile(n: int, probability: float, sigma_dof: float) -> float:
    widths, below = _range_law(n)
    sizes = np.ones(1)
    if sigma_dof < MANY:  # the sigma's true size over the stated one, 200 equally likely values
        levels = (np.arange(200) + 0.5) / 200
        sizes = np.sqrt(special.chdtri(sigma_dof, 1.0 - levels) / sigma_dof)
    found = optimize.brentq(
        lambda w: float(np.mean(np.interp(w * sizes, widths, below))) - probability, 0.0, 1e4
    )
    return float(found)


@cache
def _range_law(n: int) -> tuple[FloatArray, FloatArray]:
    """Return widths and P(range ≤ width) = n·∫ φ(z)·(Φ(z + width) − Φ(z))^(n−1) dz."""
    widths = np.linspace(0.0, 14.0, 1401)
    z = np.linspace(-8.0, 8.0, 801)
    inside = special.ndtr(z + widths[:, None]) - special.ndtr(z)
    below = n * np.trapezoid(stats.norm.pdf(z) * inside ** (n - 1), z, axis=1)
    return widths, np.minimum(below, 1.0)


def holm(p_values: Mapping[str, float], alpha: float) -> tuple[str, ...]:
    """Return the names whose p-values stand out, with `alpha` for one false name or more.

    References
    ----------
    Holm, S. (1979), A simple sequentially rejective multiple test procedure, Scand. J. Stat. 6.
    """
    named: list[str] = []
    for k, name in enumerate(sorted(p_values, key=lambda n: p_values[n])):
        if p_values[name] > alpha / (len(p_values) - k):
            break
        named.append(name)
    return tuple(named)
