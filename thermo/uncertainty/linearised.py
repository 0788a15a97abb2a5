"""A fit seen linearly: how far anything added to the output moves the estimates, and its sigma.

All that a fit says beyond its estimates hangs on this: what runs that differ, a thermistor that is
off or an order left out do to the coefficients, and whether the residual still follows something.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.blocks import block_slices, parts_of_runs
from errormodel.columns import Columns
from errormodel.fit import ModelFit
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import DriftProduct
from errormodel.record import Record
from errormodel.run_effects import RunEffect
from thermo.library import MAX_ORDER

# Effects (n, m) on the output, given for the readings of a block: they need not stand whole.
Effects: TypeAlias = Callable[[slice], FloatArray]


def whole_effect(whole: FloatArray) -> Effects:
    """Return one effect that stands whole, shape (n,)."""
    return lambda rows: whole[rows, None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sums:
    """Sums of readings with weights (n, m): products of the weights, and what the noise does.

    Attributes
    ----------
    gram : ndarray, shape (m, m)
        Of the weights.
    along : ndarray, shape (m,)
        The weights times the residual.
    by_drift, by_the_rest : ndarray, shape (m, m)
        Covariance of the sums by the drift; by the white noise and the runs' differences.
    """

    gram: FloatArray
    along: FloatArray
    by_drift: FloatArray
    by_the_rest: FloatArray

    @property
    def cov(self) -> FloatArray:
        """Covariance of the sums, shape (m, m)."""
        return self.by_drift + self.by_the_rest


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearisedFit:
    """The derivative of a model at its fit, with equal weights.

    Attributes
    ----------
    fit : ModelFit
    record : Record
        That was fitted, with its output.
    columns : Columns, shape (n, p)
    residual : ndarray, shape (n,)
    run_directions : ndarray, shape (p, q)
        What may differ from run to run, each as a change of the coefficients.
    run_effects : tuple of RunEffect, length q or 0
    """

    fit: ModelFit
    record: Record
    columns: Columns
    residual: FloatArray
    run_directions: FloatArray
    run_effects: tuple[RunEffect, ...] = ()
    _inverse: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        triangle = self.columns.triangle()
        norms = np.linalg.norm(triangle, axis=0)
        norms = np.where(norms > 0, norms, 1.0)
        root = linalg.pinv(triangle / norms) / norms[:, None]
        object.__setattr__(self, "_inverse", root @ root.T)

    @property
    def noise(self) -> NoiseModel:
        """Noise of the readings, runs apart."""
        return self.fit.noise

    @property
    def drift_freedom(self) -> float:
        """Degrees of freedom of the drift's variance: it is new in each run and after each τ."""
        spans = [float(np.ptp(self.record.time_s[r])) for r in self.record.run_slices]
        return sum(1.0 + span / self.noise.drift_tau_s for span in spans)

    def moved(self, added: FloatArray) -> FloatArray:
        """Return how far something added to the output (n, m) moves the estimates (p, m)."""
        return self._inverse @ self.columns.transposed_times(added)

    def by_normal(self, pull: FloatArray) -> FloatArray:
        """Return how far changes of the normal equations' right side move the estimates."""
        return np.asarray(self._inverse @ pull)

    def pull(self, effects: Effects) -> FloatArray:
        """Return effects on the right side of the normal equations, shape (p, m)."""
        pull = np.zeros((self.columns.shape[1], 1))
        for rows, block in self.columns.blocks():
            pull = pull + block.T @ effects(rows)
        return pull

    def left(self, effects: Effects) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with what the estimates do not take up of effects."""
        moved = self._inverse @ self.pull(effects)
        for rows, block in self.columns.blocks():
            yield rows, effects(rows) - block @ moved

    def sums(self, weights: Iterable[tuple[slice, FloatArray]], width: int = 1) -> Sums:
        """Return sums of readings with weights (n, width), given block by block.

        The sums are of what the estimates leave: only what the runs differ by is in them.
        """
        noise, runs = self.noise, self.record.run_slices
        gram, along = np.zeros((width, width)), np.zeros(width)
        drift = DriftProduct(self.record, noise.drift_tau_s, width)
        seen = np.zeros((len(runs), len(self.run_effects), width))
        for (rows, own), directed in zip(weights, self._directed(), strict=True):
            gram += own.T @ own
            along += own.T @ self.residual[rows]
            if noise.drift > 0:
                drift.add(rows, own)
            for number, part in parts_of_runs(runs, rows) if self.run_effects else ():
                mine = slice(part.start - rows.start, part.stop - rows.start)
                seen[number] += directed[mine].T @ own[mine]
        sigmas = np.array([effect.seen_sigma for effect in self.run_effects])
        by_runs = (sigmas[:, None] * seen).reshape(-1, width)
        return Sums(
            gram=gram,
            along=along,
            by_drift=noise.drift**2 * drift.total,
            by_the_rest=noise.white**2 * gram + by_runs.T @ by_runs,
        )

    def _directed(self) -> Iterator[FloatArray]:
        """Return what the runs' effects do to the readings of each block; nothing without any."""
        if not self.run_effects:
            return (np.zeros((0, 0)) for _ in block_slices(len(self.record)))
        return (block @ self.run_directions for _, block in self.columns.blocks())

    def run_moves(self, k: int) -> FloatArray:
        """Return how far effect k in each run moves the estimates, shape (p, runs)."""
        return np.asarray(self._inverse @ self._run_pulls(k)[0])

    def run_shown(self, k: int) -> FloatArray:
        """Return which part of effect k in the runs the residual shows, shape (runs, runs).

        A projection, nearly: 1 for what runs differ by, 0 for what the estimates take up.
        """
        pulls, lengths2 = self._run_pulls(k)
        kept = np.diag(lengths2) - pulls.T @ (self._inverse @ pulls)
        lengths = np.sqrt(np.where(lengths2 > 0, lengths2, 1.0))
        return np.asarray(kept / np.outer(lengths, lengths))

    def _run_pulls(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Return effect k in each run on the normal equations (p, runs), and its square."""
        along = self.columns @ self.run_directions[:, k]
        lengths2 = [float(along[r] @ along[r]) for r in self.record.run_slices]
        return np.asarray(self.columns.by_run(along).T), np.array(lengths2)

    def share(self, k: int) -> FloatArray:
        """Return the weights of the coefficients that give the mean of effect k, shape (p,)."""
        metric = self.columns.transposed_times(self.columns @ self.run_directions[:, k])
        return np.asarray(metric / (self.run_directions[:, k] @ metric))

    def by_temperature(self) -> FloatArray:
        """Return the output's derivative by the temperature, per °C, shape (n,)."""
        return np.asarray(self.columns @ temperature_direction(self.fit))


def linearised(fit: ModelFit, record: Record) -> LinearisedFit:
    """Return a fit with its derivative, and the directions in which its runs may differ."""
    values = fit.as_dict()
    residual = np.asarray(record.output) - fit.model.simulate(record, values)
    return LinearisedFit(
        fit=fit,
        record=record,
        columns=Columns(fit.model, record, values),
        residual=residual,
        run_directions=_run_directions(fit),
    )


def run_names(fit: ModelFit) -> tuple[str, ...]:
    """Return what may differ from run to run: bias, scale factor, the thermistor's temperature."""
    names = [n for n in ("k0", "k1") if n in fit.names]
    return (*names, *(["temp_c"] if np.any(temperature_direction(fit)) else []))


def _run_directions(fit: ModelFit) -> FloatArray:
    single = [np.eye(len(fit.names))[fit.names.index(n)] for n in run_names(fit) if n != "temp_c"]
    thermal = temperature_direction(fit)
    directions = [*single, *([thermal] if np.any(thermal) else [])]
    return np.array(directions).reshape(len(directions), len(fit.names)).T


def temperature_direction(fit: ModelFit) -> FloatArray:
    """Return what a degree does to the coefficients, to first order, shape (p,).

    With T for T + ε the polynomials keep their form: b_k gains (k + 1)·b_{k+1}·ε.
    """
    change = np.zeros(len(fit.names))
    for family in ("k0", "k1"):
        relative = family == "k1"
        if family not in fit.names or f"{family}_t1" not in fit.names:
            continue
        first = fit.value(f"{family}_t1")
        change[fit.names.index(family)] = first * (fit.value("k1") if relative else 1.0)
        for k in range(1, MAX_ORDER + 1):
            name, above = f"{family}_t{k}", f"{family}_t{k + 1}"
            if name in fit.names:
                more = (k + 1) * fit.value(above) if above in fit.names else 0.0
                less = first * fit.value(name) if relative else 0.0  # relative to the new K1
                change[fit.names.index(name)] = more - less
    return change


def shifted(fit: ModelFit, by_c: float) -> tuple[FloatArray, FloatArray]:
    """Return a fit's values and covariance at a reference temperature `by_c` higher."""

    def at(values: FloatArray) -> FloatArray:
        moved = values.copy()
        for family in ("k0", "k1"):
            orders = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in fit.names]
            if family not in fit.names or orders != list(range(1, len(orders) + 1)):
                continue
            where = [fit.names.index(f"{family}_t{k}" if k else family) for k in (0, *orders)]
            powers = values[where].copy()
            head = powers[0]
            powers[0] = 1.0 if family == "k1" else head
            new = np.polynomial.Polynomial(powers)(np.polynomial.Polynomial([by_c, 1.0])).coef
            new = np.pad(new, (0, len(where) - new.size))
            if family == "k1":
                new[1:] /= new[0]
                new[0] *= head
            moved[where] = new
        return moved

    values = np.asarray(fit.values, dtype=float)
    steps = 1e-3 * np.sqrt(np.diag(fit.cov))
    slopes = np.column_stack(
        [
            (at(values + step * unit) - at(values - step * unit)) / (2 * step)
            if step > 0
            else np.zeros(values.size)
            for step, unit in zip(steps.tolist(), np.eye(values.size), strict=True)
        ]
    )
    return at(values), slopes @ fit.cov @ slopes.T
