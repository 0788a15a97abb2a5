"""The noise floor: what does not repeat, estimated beside a mean that holds all that does.

Restricted maximum likelihood with a saturated mean: an effect that is missing from the model but
repeats cannot leak into the noise, and slow noise cannot pose as an effect. The families are white
noise alone and with one slow process (bias instability), a random walk, or flicker noise.
"""

from collections.abc import Callable

import numpy as np
from scipy import optimize

from errormodel.arrays import FloatArray
from errormodel.noise.likelihood import RestrictedLikelihood
from errormodel.noise.model import NoiseFit, NoiseModel, drifting, flicker, walking
from errormodel.noise.whitening import TimeBase

# A process slower than this share of the longest run is hardly told from offsets and relaxations
# of the runs, which are effects with names.
SLOWEST_SPANS = 0.5
# Shapes whose log-likelihood is this far below the best are not drawn from: 3 sigma.
REACH = 4.5
MOST_SHAPES = 24  # of these, that a search keeps: more would only lie between them
# Log-likelihood that each family must gain over white noise: its number of parameters (Akaike).
PENALTY = {"white": 0.0, "flicker": 1.0, "walk": 1.0, "drift": 2.0}


def estimate_floor(times: TimeBase, residual: FloatArray, saturated: FloatArray) -> NoiseFit:
    """Estimate the noise of a residual beside everything that repeats.

    Parameters
    ----------
    times : TimeBase
    residual : ndarray, shape (n,)
    saturated : ndarray, shape (n, m)

    Returns
    -------
    NoiseFit

    References
    ----------
    Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
    related problems, JASA 72.
    """
    judge = RestrictedLikelihood(times, saturated)
    data = residual[:, None]
    seen: dict[NoiseModel, tuple[float, float]] = {}

    def like(shape: NoiseModel) -> float:
        if shape not in seen:
            value, sigma = judge.evaluate(shape, data)
            seen[shape] = float(value[0]) - PENALTY[shape.family], float(sigma[0])
        return seen[shape][0]

    like(NoiseModel())
    _search_drift(like, times)
    _search_one(like, lambda r: flicker(r, times))
    _search_one(like, lambda r: walking(r, times, continued=False))
    _search_one(like, lambda r: walking(r, times, continued=True))
    best = max(seen, key=lambda s: seen[s][0])
    top = seen[best][0]
    likely = sorted(seen, key=lambda s: -seen[s][0])[:MOST_SHAPES]
    kept = {s: seen[s][0] for s in likely if top - seen[s][0] < REACH}
    weights = {s: float(np.exp(v - top)) for s, v in kept.items()}
    total = sum(weights.values())
    return NoiseFit(
        noise=best.scaled(seen[best][1]),
        support=tuple((w / total, s.scaled(seen[s][1])) for s, w in weights.items()),
    )


def _search_drift(like: Callable[[NoiseModel], float], times: TimeBase) -> None:
    """Try slow processes: a coarse grid, then finer ones about the best."""
    lo = np.array([np.log(0.03), np.log(1.5 * times.step_s)])
    hi = np.array([np.log(1e4), np.log(SLOWEST_SPANS * times.span_s)])

    def at(point: FloatArray) -> float:
        return like(drifting(float(np.exp(point[0])), float(np.exp(point[1]))))

    ratios = np.linspace(float(lo[0]), float(hi[0]), 7).tolist()
    taus = np.linspace(float(lo[1]), float(hi[1]), 6).tolist()
    points: list[FloatArray] = [np.array([r, t]) for r in ratios for t in taus]
    best = max(points, key=at)
    for step in (0.8, 0.4):
        around = [
            np.clip(best + step * np.array([i, j]), lo, hi) for i in (-1, 0, 1) for j in (-1, 0, 1)
        ]
        best = max(around, key=at)
    # size and correlation time trade against each other along a ridge: the shapes that the data
    # allow lie on it
    for along in np.arange(-4, 5) * 0.35:
        for across in (-0.25, 0.0, 0.25):
            at(np.clip(best + np.array([along + across, along - across]), lo, hi))


def _search_one(
    like: Callable[[NoiseModel], float], shape_of: Callable[[float], NoiseModel]
) -> None:
    """Try a family of one parameter, its ratio to the white variance."""
    found = optimize.minimize_scalar(
        lambda r: -like(shape_of(float(np.exp(r)))),
        bounds=(np.log(1e-3), np.log(1e3)),
        method="bounded",
        options={"xatol": 0.15, "maxiter": 12},
    )
    for step in (-0.35, 0.35):
        like(shape_of(float(np.exp(float(found.x) + step))))
