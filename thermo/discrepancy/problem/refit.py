"""Refit of a model to block means under a noise, every nonlinear parameter with it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from thermo.discrepancy.blocks import Blocks
from thermo.recording.channel import Channel

MICRO = 1e6
REFITS = 8


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """A model fitted to block means under a noise: values in the model's unit.

    `jacobian` (b, p) and `residual` (b,) are block means in µg; `free` names the columns.
    """

    model: ErrorModel
    values: dict[str, float]
    jacobian: FloatArray
    residual: FloatArray
    free: tuple[str, ...]

    @property
    def idle(self) -> frozenset[str]:
        """Parameters that have no effect in these runs: nothing was learnt of them."""
        columns = zip(self.free, self.jacobian.T, strict=True)
        return frozenset(name for name, column in columns if not column.any())


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """A model on a channel's block means, with the parameters that are free."""

    channel: Channel
    blocks: Blocks
    model: ErrorModel
    free: tuple[str, ...]

    def at(self, values: Mapping[str, float]) -> Fitted:
        """Return the residual and the Jacobian at some values."""
        record, model = self.channel.record, self.model
        columns = derivative(model, record, values)
        keep = [model.names.index(n) for n in self.free]
        residual = np.asarray(record.output) - model.simulate(record, values)
        return Fitted(
            model=model,
            values=dict(values),
            jacobian=MICRO * self.blocks.mean(columns[:, keep]),
            residual=MICRO * self.blocks.mean(residual),
            free=self.free,
        )


def refit(line: Linearisation, values: Mapping[str, float], noise: NoiseModel) -> Fitted:
    """Return a model refitted from start values, by damped Gauss-Newton steps."""
    whitener = noise.whitener(line.blocks.times)
    best = line.at(values)
    cost = float(np.sum(whitener.whiten(best.residual) ** 2))
    for _ in range(REFITS):
        white = whitener.whiten(np.column_stack([best.jacobian, best.residual]))
        step = _solved(white[:, :-1], white[:, -1])
        better = None
        for share in (1.0, 0.5, 0.1):
            tried = line.at(_moved(best, step * share))
            trial = float(np.sum(whitener.whiten(tried.residual) ** 2))
            if trial < cost:
                better = (tried, trial)
                break
        if better is None:
            break
        gained = cost - better[1]
        best, cost = better
        if gained < 1e-6 * cost:
            break
    return best


def _moved(fitted: Fitted, step: FloatArray) -> dict[str, float]:
    """Return the values after a step, nonlinear parameters within their bounds."""
    bounds = {p.name: (p.lo, p.hi) for p in fitted.model.parameters}
    moved = dict(fitted.values)
    for name, change in zip(fitted.free, step.tolist(), strict=True):
        value = moved[name] + change
        if name in bounds:
            lo, hi = bounds[name]
            if lo > 0.0:  # a scale: no more than twice or half at once
                lo, hi = max(lo, moved[name] / 2.0), min(hi, max(moved[name] * 2.0, lo))
            value = min(max(value, lo), hi)
        moved[name] = value
    return moved


def _solved(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the least-squares step; directions without effect are left where they are."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return np.linalg.lstsq(columns / norms, target, rcond=1e-9)[0] / norms
