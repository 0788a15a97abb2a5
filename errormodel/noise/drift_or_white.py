"""Drift or white noise: the noise of a fit, estimated by restricted maximum likelihood.

Slow drift that is treated as white would make every sigma of a bias several times too small. How
roughly it is known from a few runs is part of the estimate.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy import optimize

from errormodel.arrays import FloatArray
from errormodel.blocks import Blocked, Kept
from errormodel.noise.likelihood import BlockLikelihood
from errormodel.noise.model import NoiseFit, NoiseModel, given_noise
from errormodel.record import Record


def estimate_noise(
    record: Record,
    residual: FloatArray,
    columns: FloatArray,
    *,
    own: bool = False,
    wary: bool = False,
) -> NoiseFit:
    """Estimate white noise and drift by restricted maximum likelihood (REML).

    The likelihood is that of the error contrasts, so what the fit of `columns` absorbed of the
    drift is accounted for. Drift correlation times between three sampling intervals and three
    times the longest run are searched.

    Parameters
    ----------
    record : Record
        Times and runs.
    residual : ndarray, shape (n,)
        Residual at some value of the coefficients (any: they are profiled out).
    columns : ndarray, shape (n, p)
        Derivative of the model by its parameters.
    own : bool
        Whether each run has parameters of its own; the noise is common to all runs either way. What
        differs from run to run is then not taken for drift.
    wary : bool
        Whether `support` holds the drift that the data do not exclude even where they show none;
        otherwise it is white noise alone there.

    Returns
    -------
    NoiseFit

    References
    ----------
    Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
    related problems, JASA 72, eq. for the restricted likelihood.
    """
    return estimate_noise_of(record, residual, Kept(columns), own=own, wary=wary)


def estimate_noise_of(
    record: Record,
    residual: FloatArray,
    columns: Blocked,
    *,
    own: bool = False,
    wary: bool = False,
    own_columns: Sequence[int] = (),
) -> NoiseFit:
    """Estimate the noise as `estimate_noise` does, with columns that need not stand whole.

    Parameters
    ----------
    record : Record
    residual : ndarray, shape (n,)
    columns : Blocked, shape (n, p)
    own : bool
    wary : bool
    own_columns : sequence of int
        Columns of which each run has a parameter of its own, where not all are.
    """
    data = BlockLikelihood(record, residual, columns, own=own, own_columns=own_columns)
    scale = data.scale
    step_s, count = _usual_step_s(record)
    spans = [float(np.ptp(record.time_s[r])) for r in record.run_slices]
    if scale == 0.0 or count < 10:
        return _white_only(data)

    def evaluate(log_ratio: float, log_tau: float) -> tuple[float, float]:
        """Return the restricted log-likelihood and the white sigma that goes with it."""
        shape = NoiseModel(drift=np.exp(log_ratio), drift_tau_s=np.exp(log_tau))
        return data.evaluate(shape)

    bounds = (
        (np.log(0.02), np.log(50.0)),
        (np.log(3.0 * step_s), np.log(3.0 * max(max(spans), 30.0))),
    )
    none, _ = data.evaluate(NoiseModel())
    best = _maximise(evaluate, bounds)
    if best[0] <= none + 1e-3 and not wary:
        return _white_only(data)
    drifting, evidence = _support(evaluate, best[1], bounds)
    # Drift or none: equal odds beforehand, moved by how much better drift of any size and
    # correlation time within the bounds explains the data on average.
    odds = float(np.exp(min(evidence - none, 50.0)))
    share = odds / (1.0 + odds)
    white_alone = _white_only(data).noise
    support = [(share * w, _model(at, s * scale)) for w, at, s in drifting]
    if share < 0.99:
        support.append((1.0 - share, white_alone))
    _, white = evaluate(*best[1])
    noise = _model(best[1], white * scale) if share > 0.5 else white_alone
    return NoiseFit(noise=noise, support=tuple(support))


def _model(at: tuple[float, float], white: float) -> NoiseModel:
    return NoiseModel(
        white=white, drift=white * float(np.exp(at[0])), drift_tau_s=float(np.exp(at[1]))
    )


def _white_only(data: BlockLikelihood) -> NoiseFit:
    _, sigma = data.evaluate(NoiseModel())
    return given_noise(NoiseModel(white=max(sigma * data.scale, np.finfo(float).tiny)))


def _usual_step_s(record: Record) -> tuple[float, int]:
    """Return the median of the times between readings, and how many there are."""
    steps = np.concatenate([np.diff(record.time_s[r]) for r in record.run_slices])
    return (float(np.median(steps)) if steps.size else 0.0), steps.size


Evaluate = Callable[[float, float], tuple[float, float]]
Bounds = tuple[tuple[float, float], tuple[float, float]]


def _maximise(evaluate: Evaluate, bounds: Bounds) -> tuple[float, tuple[float, float]]:
    """Return the best likelihood and where: a coarse grid, then a simplex from its best point."""
    ratios, taus = (np.linspace(*b, 6)[1:-1] for b in bounds)
    start = max(((r, t) for r in ratios for t in taus), key=lambda at: evaluate(*at)[0])
    found = optimize.minimize(
        lambda at: -evaluate(float(at[0]), float(at[1]))[0],
        start,
        method="Nelder-Mead",
        bounds=bounds,
        options={"xatol": 0.02, "fatol": 0.01, "maxfev": 120},
    )
    return -float(found.fun), (float(found.x[0]), float(found.x[1]))


def _support(
    evaluate: Evaluate, best: tuple[float, float], bounds: Bounds
) -> tuple[list[tuple[float, tuple[float, float], float]], float]:
    """Return the noise shapes the data allow on a grid around the best, with their shares.

    Along each axis the grid reaches out to where the log-likelihood has dropped by about 4.5
    (three sigma), or to the bound. The second result is the logarithm of the likelihood averaged
    over all shapes within the bounds.
    """
    top = evaluate(*best)[0]

    def reach(axis: int, sign: int) -> float:
        """Return how far the likelihood stays within 4.5 of its top along an axis."""
        edge = bounds[axis][sign > 0]
        step = 0.25
        at = best[axis]
        while abs(at - edge) > 1e-9 and step < 16:
            tried = max(min(best[axis] + sign * step, bounds[axis][1]), bounds[axis][0])
            point = (tried, best[1]) if axis == 0 else (best[0], tried)
            at = tried
            if top - evaluate(*point)[0] > 4.5:
                break
            step *= 1.6
        return at

    axes = [np.linspace(reach(a, -1), reach(a, +1), 7) for a in (0, 1)]
    points = [(float(r), float(t)) for r in axes[0] for t in axes[1]]
    values = [evaluate(*p) for p in points]
    highest = max(v[0] for v in values)
    shares = np.exp(np.array([v[0] for v in values]) - highest)
    cell = float(np.prod([np.ptp(a) / a.size for a in axes]))
    whole = float(np.prod([hi - lo for lo, hi in bounds]))
    evidence = highest + float(np.log(max(shares.sum() * cell / whole, 1e-300)))
    shares /= shares.sum()
    kept = [(float(w), p, v[1]) for w, p, v in zip(shares, points, values, strict=True) if w > 1e-3]
    return kept, evidence
