"""One accelerometer, run by run: the model chosen on all runs, re-fitted to each of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.columns import derivative
from errormodel.errors import InputError
from errormodel.fit import ModelFit, examine, fit
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseFit, NoiseModel
from errormodel.record import Record
from errormodel.terms import Term
from thermo.fitting.fit import AccelerometerFit
from thermo.library import thermal_library
from thermo.library.effects import MICRO
from thermo.recording.channel import HOLD, Channel
from thermo.stability.noise import degrees_of_freedom, runs_noise
from thermo.uncertainty.left_out import LeftOut, left_out
from thermo.uncertainty.linearised import linearised

EXAMINED = 4000  # readings enough to judge what a run can give
# A run or one direction of it is fitted when it has this many readings.
MIN_READINGS = 30
# Within a smaller span of temperature nothing heats or cools: the slopes are the thermistor's.
STILL_C = 1.0
KNOT_C = 5.0  # a loop's corner bends within some 8 °C
THERMAL = frozenset({"x_c", "x_slow_c", "rate_c_per_min"})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunFit:
    """The coefficients of one run, or of one direction in it.

    Attributes
    ----------
    run_id : str
    fit : ModelFit
        Of the coefficients that these readings give.
    values : mapping
        All unknowns of the model: those fitted, and the others as of all runs together.
    held : tuple of str
        The others.
    temp_c : pair of float
        Lowest and highest temperature of the readings.
    sigma_dof : ndarray, shape (p,)
        Degrees of freedom that the sigmas of `fit` are known to.
    """

    run_id: str
    fit: ModelFit
    values: Mapping[str, float]
    held: tuple[str, ...]
    temp_c: tuple[float, float]
    sigma_dof: FloatArray

    def dof(self, name: str) -> float:
        """Return the degrees of freedom that a coefficient's sigma is known to."""
        return float(self.sigma_dof[self.fit.names.index(name)])

    def coefficient(self, name: str) -> tuple[float, float]:
        """Return a fitted coefficient and its sigma as reported; K1 in ppm from nominal."""
        factor, shift = reported_as(self.fit.model, name)
        return factor * (self.fit.value(name) - shift), abs(factor) * self.fit.sigma(name)

    def curve(self, family: str, x_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return K0 ("k0", µg) or K1 ("k1", ppm from nominal) over temperature, and gradients.

        Parameters
        ----------
        family : str
        x_c : ndarray, shape (m,)
            Temperature less the reference temperature, °C.

        Returns
        -------
        ndarray, shape (m,); ndarray, shape (m, p)
            The second by the coefficients of `fit`.
        """
        gradient = np.zeros((x_c.size, len(self.fit.names)))
        known = thermal_library().parameters
        powers = {n: x_c ** known[n].order for n in self.values if known[n].family == family}
        gain = self.values.get("k1", 1.0) if family == "k1" else 1.0
        rest = {n: p for n, p in powers.items() if n != "k1"}
        total = sum((self.values[n] * p for n, p in rest.items()), np.zeros_like(x_c))
        for name, power in rest.items():
            if name in self.fit.names:
                gradient[:, self.fit.names.index(name)] = gain * power
        if family == "k1":
            if "k1" in self.fit.names:
                gradient[:, self.fit.names.index("k1")] = 1.0 + total
            total = gain * (1.0 + total) - 1.0
        return MICRO * total, MICRO * gradient


def reported_as(model: ErrorModel, name: str) -> tuple[float, float]:
    """Return factor and shift: reported = factor · (value − shift)."""
    if name == "k1":
        return MICRO, 1.0
    return next(c.per_unit for c in model.coefficients if c.name == name), 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunByRun:
    """All runs of one accelerometer.

    Attributes
    ----------
    joint : AccelerometerFit
    runs : tuple of RunFit
        In the order asked for.
    curves : mapping of int to tuple of RunFit
        Direction (1 heating, −1 cooling, 0 hold) → its fits, of the runs that have it.
    noise : NoiseModel
        Common to the runs; what repeats in all of them, and what differs between their
        coefficients, is not in it. It and `residual_ug` are referred to the input as by `fit`, by
        the K1 of all runs (`joint.own_scale`).
    noise_ratios : mapping of str to float
        Run → its noise over the common one; 1 for all where chance explains the differences.
    loops_p : float
        How often chance alone makes heating less cooling differ so between the runs.
    residual_ug : ndarray, shape (n,)
        What the runs' own coefficients leave of the joint channel's readings.
    direction : ndarray of int, shape (n,)
    """

    joint: AccelerometerFit
    runs: tuple[RunFit, ...]
    curves: Mapping[int, tuple[RunFit, ...]]
    noise: NoiseModel
    noise_ratios: Mapping[str, float]
    loops_p: float
    residual_ug: FloatArray
    direction: IntArray

    @property
    def scale_fitted(self) -> bool:
        """True when µg are over the K1 of these runs; else over the nominal scale factor."""
        return "k1" in self.joint.fit.names


def fit_run_by_run(joint: AccelerometerFit, order: Sequence[str]) -> RunByRun:
    """Re-fit to each run the coefficients that it can give; the rest is held as of all runs.

    Nonlinear parameters, and terms that have them, are held.

    Parameters
    ----------
    joint : AccelerometerFit
        The model fitted to all runs.
    order : sequence of str
        The runs in their order.

    Raises
    ------
    InputError
        If a run has too few readings or cannot give K0.
    """
    channel, values = joint.channel, joint.fit.as_dict()
    parts = {r: channel.take(channel.runs_mask((r,))) for r in channel.run_ids}
    free = {r: _free_model(joint.fit.model, part, joint.serial) for r, part in parts.items()}
    for r, part in parts.items():
        parts[r] = _without_held(part, joint.fit.model, free[r], values)
    lines = [_linearised(free[r], parts[r].record, values) for r in channel.run_ids]
    alike = _repeating(channel)
    repeated = _repeated(alike, np.concatenate([_left(*line) for line in lines]))
    noise = runs_noise(
        channel.record,
        [columns for columns, _ in lines],
        np.concatenate([rest for _, rest in lines]),
        alike,
        directions(channel),
    )
    for r in channel.run_ids:
        parts[r] = _less(parts[r], repeated[channel.runs_mask((r,))])
    of_run = {r: noise.of_run(k) for k, r in enumerate(channel.run_ids)}
    fits = {r: _refit(free[r], parts[r], values, of_run[r]) for r in order}
    left = [_left_ug(free[r], parts[r], fits[r].values) for r in channel.run_ids]
    at_input = abs(channel.nominal_scale / joint.own_scale)
    return RunByRun(
        joint=joint,
        runs=tuple(fits[r] for r in order),
        curves=_by_direction(joint, fits, order, of_run),
        noise=noise.common.noise.scaled(at_input),
        noise_ratios={r: float(noise.ratios[k]) for k, r in enumerate(channel.run_ids)},
        loops_p=noise.loops_p,
        residual_ug=at_input * np.concatenate(left),
        direction=directions(channel),
    )


def residual_factors(one: RunByRun, run: RunFit) -> tuple[LeftOut, ...]:
    """Return what a run's residual still follows, beyond the model chosen on all runs alike."""
    channel, model = one.joint.channel, one.joint.fit.model
    part = channel.take(channel.runs_mask((run.run_id,)))
    part = _without_held(part, model, run.fit.model, run.values)
    return left_out(linearised(run.fit, part.record), part)


def directions(channel: Channel) -> IntArray:
    """Return heating, cooling or hold for each reading; all hold where nothing moves."""
    still = float(np.ptp(channel.temp_c)) < STILL_C
    return (np.zeros_like(channel.direction) if still else channel.direction).astype(np.intp)


def _free_model(model: ErrorModel, part: Channel, serial: str) -> ErrorModel:
    """Return the terms of a model that a part of the readings can give, the simplest first."""
    if len(part.record) < MIN_READINGS:
        place = f"serial {serial} run {part.run_ids[0]}"
        problem = f"{len(part.record)} readings; a run needs {MIN_READINGS} at least"
        raise InputError("recorded runs", place, problem)
    found = _separable(model, part.record)
    if "k0" not in found.names:
        place = f"serial {serial} run {part.run_ids[0]}"
        raise InputError("recorded runs", place, "cannot determine K0; the model needs the term k0")
    return found


def _separable(model: ErrorModel, record: Record) -> ErrorModel:
    thin = record.take(np.arange(0, len(record), max(1, len(record) // EXAMINED)))
    kept: list[Term] = []
    linear = [t for t in model.terms if isinstance(t, Term) and not t.parameters]
    if float(np.ptp(record["x_c"])) < STILL_C:  # a thermistor's noise gives no slope
        linear = [t for t in linear if not t.needs & THERMAL]
    for candidate in sorted(linear, key=lambda t: _rank(t.name)):
        tried = ErrorModel((*kept, candidate), model.base)
        if not examine(tried, thin, tried.start_values()).confounded:
            kept.append(candidate)
    return ErrorModel(tuple(kept), model.base)


def _rank(name: str) -> tuple[bool, int]:
    """Order terms by importance: K0 and K1 before all others, then as in the library."""
    return name not in ("k0", "k1"), list(thermal_library().terms).index(name)


def _without_held(
    part: Channel, model: ErrorModel, free: ErrorModel, values: Mapping[str, float]
) -> Channel:
    """Take out of the output what the held terms add to it."""
    record = part.record
    return _less(part, model.simulate(record, values) - free.simulate(record, values))


def _less(part: Channel, share: FloatArray) -> Channel:
    """Return readings with a share of their output taken away."""
    record = part.record
    cleaned = Record(
        time_s=record.time_s,
        run=record.run,
        signals=dict(record.signals),
        output=np.asarray(record.output) - share,
    )
    return replace(part, record=cleaned)


def _linearised(
    free: ErrorModel, record: Record, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the derivative (n, p) and the residual (n,) at the values of all runs."""
    rest = np.asarray(record.output) - free.simulate(record, values)
    return derivative(free, record, values), rest


def _left(columns: FloatArray, rest: FloatArray) -> FloatArray:
    """Return what the run's own coefficients leave: to first order, runs differ by little."""
    norms = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(np.asarray(columns / norms, dtype=np.float64), rest, rcond=1e-12)[0]
    return np.asarray(rest - columns @ (found / norms))


def _repeating(channel: Channel) -> FloatArray:
    """Return the functions of temperature that hold what all runs leave alike, shape (n, q).

    They are piecewise linear over `KNOT_C` in each direction, where every run has passed. A loop
    that a polynomial cannot hold is no noise of the runs: it would pass for drift and hide what
    does not repeat, and with positions in another order each time it would move the coefficients.
    """
    heading, run = directions(channel), channel.record.run
    place = channel.temp_c / KNOT_C
    knots = np.arange(int(np.floor(place.min())), int(np.ceil(place.max())) + 1)
    hats = np.maximum(1.0 - np.abs(place[:, None] - knots), 0.0)
    columns = np.hstack([hats * (heading == way)[:, None] for way in np.unique(heading)])
    passed = [(columns[run == k] > 0.0).any(axis=0) for k in range(len(channel.run_ids))]
    return columns[:, np.all(passed, axis=0)]


def _repeated(columns: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the part of a residual that lies in columns, shape (n,)."""
    return np.asarray(columns @ np.linalg.lstsq(columns, residual, rcond=1e-9)[0])


def _refit(free: ErrorModel, part: Channel, values: Mapping[str, float], noise: NoiseFit) -> RunFit:
    found = fit(free, part.record, noise=noise, start={n: values[n] for n in free.names})
    return RunFit(
        run_id=part.run_ids[0],
        fit=found,
        values={**values, **found.as_dict()},
        held=tuple(n for n in values if n not in free.names),
        temp_c=(float(part.temp_c.min()), float(part.temp_c.max())),
        sigma_dof=degrees_of_freedom(free, part.record, found.as_dict(), noise),
    )


def _left_ug(free: ErrorModel, part: Channel, values: Mapping[str, float]) -> FloatArray:
    return MICRO * (np.asarray(part.record.output) - free.simulate(part.record, values))


def _by_direction(
    joint: AccelerometerFit,
    fits: Mapping[str, RunFit],
    order: Sequence[str],
    noise: Mapping[str, NoiseFit],
) -> dict[int, tuple[RunFit, ...]]:
    """Fit K0 and K1 over temperature to each direction of each run alone."""
    channel, model = joint.channel, joint.fit.model
    polynomial = ErrorModel(
        tuple(t for t in model.terms if any(c.family in ("k0", "k1") for c in t.coefficients)),
        model.base,
    )
    heading = directions(channel)
    wanted = [d for d in (1, -1) if np.any(heading == d)] or [HOLD]
    found: dict[int, tuple[RunFit, ...]] = {}
    for direction in wanted:
        mine: list[RunFit] = []
        for r in order:
            rows = channel.runs_mask((r,))
            whole = _without_held(channel.take(rows), model, polynomial, fits[r].values)
            inside = np.flatnonzero(heading[rows] == direction)
            if inside.size < MIN_READINGS:
                continue
            part = whole.take(np.asarray(inside, dtype=np.intp))
            free = _separable(polynomial, part.record)
            if "k0" in free.names:
                part = _without_held(part, polynomial, free, fits[r].values)
                mine.append(_refit(free, part, fits[r].values, noise[r]))
        if len(mine) >= 2:
            found[direction] = tuple(mine)
    return found
