"""A smooth wander: the rival of every event with a smooth shape.

A relaxation, a drift, offsets of runs in a row: each resembles other slow changes to some extent,
and the noise shapes of the floor are all rough. The names of events are therefore compared with an
integrated random walk over the whole measurement, which continues through the rests or is constant
in them. Its Karhunen-Loève functions are close to cosines with sigmas that fall with the square of
their number. With random sizes, their likelihood together with a rough noise follows in closed form
from one small eigenvalue problem.
"""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Problem
from errormodel.linear import independent
from errormodel.noise.floor import PENALTY
from errormodel.noise.likelihood import RestrictedLikelihood
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import TimeBase

# Cosines over the measurement: the shortest has a period of a twentieth of it, and a sigma 1600
# times less than the first.
WAVES = 40
# Variance of the first over the white one: from nothing to a thousand white sigmas.
SIZES2 = np.geomspace(1e-6, 1e6, 49)


def waves(at_s: FloatArray) -> FloatArray:
    """Return the series of an integrated random walk, shape (n, WAVES), of sigma one at first."""
    share = (at_s - at_s[0]) / max(float(np.ptp(at_s)), 1e-9)
    number = np.arange(1, WAVES + 1)
    return np.cos(np.pi * share[:, None] * number) / number**2


def _without_rests(times: TimeBase) -> FloatArray:
    """Return the time since the measurement began, s, the runs laid end to end."""
    steps = np.diff(times.elapsed_s)
    steps = np.where(np.diff(times.run) == 0, steps, times.step_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def over_wander(
    problem: Problem, shapes: Sequence[NoiseModel], columns: FloatArray, parameters: int
) -> float:
    """Return twice the log-likelihood of events less that of a wander in their place.

    Each is evaluated with its likeliest noise and a penalty for its parameters (Akaike).

    Parameters
    ----------
    problem : Problem
        Problem of the model without the events.
    shapes : sequence of NoiseModel
    columns : ndarray, shape (n, k)
        Columns that the events add.
    parameters : int
        Number of the events' parameters, nonlinear ones too.
    """
    judge = RestrictedLikelihood(problem.times, problem.base)
    series = [waves(at_s) for at_s in (problem.times.elapsed_s, _without_rests(problem.times))]
    pairs = np.array([_pair(judge, s, problem.residual, columns, series) for s in shapes])
    named, wandering = pairs.max(axis=0).tolist()
    return 2.0 * (named - parameters - wandering + 1.0)


def _pair(
    judge: RestrictedLikelihood,
    shape: NoiseModel,
    residual: FloatArray,
    columns: FloatArray,
    series: Sequence[FloatArray],
) -> tuple[float, float]:
    """Return the log-likelihoods with the columns in the mean, and with a wander of any size."""
    projection = judge.projection(shape)
    rest, log_det = projection.beside(residual), projection.log_det
    own = independent(projection.beside(columns))
    left = float(rest @ rest) - float(np.sum((own.T @ rest) ** 2))
    named = log_det + judge.dof * np.log(left / judge.dof)
    wandering = [_wandering(projection.beside(one), rest, judge.dof) for one in series]
    penalty = PENALTY[shape.family]
    return -0.5 * named - penalty, -0.5 * (log_det + min(wandering)) - penalty


def _wandering(series: FloatArray, rest: FloatArray, dof: int) -> float:
    """Return −2 log-likelihood of a whitened residual with a wander of the likeliest size."""
    values, vectors = np.linalg.eigh(series.T @ series)
    values = np.maximum(values, 0.0)
    seen2 = (vectors.T @ (series.T @ rest)) ** 2
    sizes2 = SIZES2[:, None]
    explained = np.sum(sizes2 * seen2 / (1.0 + sizes2 * values), axis=1)
    spread = np.sum(np.log1p(sizes2 * values), axis=1)
    return float(np.min(spread + dof * np.log((float(rest @ rest) - explained) / dof)))
