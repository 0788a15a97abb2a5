"""Applying a model: from an output and a temperature to a specific force."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.record import Record
from thermo.compensation.model_file import AccelerometerModel, ModelFile
from thermo.compensation.prediction import prediction_sigma_g
from thermo.recording.channel import (
    Channel,
    channel_of,
    refuse_without_signals,
    refuse_without_temperature,
    rows_of,
)
from thermo.recording.files import RecordedRuns
from thermo.recording.runs import BoolArray
from thermo.recording.signals import RATE_WINDOW_S
from thermo.selection.support import FORCE_MARGIN_G, within

# Each pass takes the gain at the reference temperature for the gain: what is left shrinks by the
# relative change of K1 over temperature, 1 % at the most, so six passes reach rounding.
PASSES = 6
# Of the fastest rate fitted: the thermistor's noise takes the same ramp beyond it.
RATE_MARGIN = 0.1
LEAST_READINGS = 3  # of a run, for a rate


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Compensated:
    """The rows of a recording, compensated.

    Attributes
    ----------
    accel_g : ndarray, shape (n,)
        Output over the nominal scale factor; NaN where the output is missing.
    accel_compensated_g : ndarray, shape (n,)
        Specific force along IA, with the model applied.
    accel_sigma_g : ndarray, shape (n,)
        Its standard deviation: of the model, of how runs differ, and of a reading's noise.
    outside_range : ndarray of bool, shape (n,)
        The temperature lay outside the model's range and was clipped to it, or in a gap of it.
    outside_rate : ndarray of bool, shape (n,)
        The rate of temperature, which the model uses, lay outside and was clipped.
    outside_input : ndarray of bool, shape (n,)
        The specific force lay beyond the forces that were fitted.
    """

    accel_g: FloatArray
    accel_compensated_g: FloatArray
    accel_sigma_g: FloatArray
    outside_range: BoolArray
    outside_rate: BoolArray
    outside_input: BoolArray

    def __post_init__(self) -> None:
        freeze(
            self,
            accel_g=readonly(self.accel_g),
            accel_compensated_g=readonly(self.accel_compensated_g),
            accel_sigma_g=readonly(self.accel_sigma_g),
        )


def compensate_channel(channel: Channel, model: AccelerometerModel) -> FloatArray:
    """Compute the specific force along IA from the outputs of one accelerometer.

    Solves the model equation for a_i, its own nonlinear terms by iteration from the compensated
    value itself; a_p and a_o are the recorded ones (zero when unknown: then misalignment is left
    in). Where the input was unknown in the fit, K0 holds the constant input too, and only the
    change with temperature is taken off.

    Returns
    -------
    ndarray, shape (n,)
        In local g.
    """
    error_model, values = model.error_model(), _predictable(model)
    # forces in the fit's g: at another site a unit of it is another force
    site = channel.gravity_m_s2 / model.gravity_m_s2
    record = clipped(channel, model)
    forces = {n: site * record[n] for n in ("a_p_g", "a_o_g")}
    record = record.with_signals(**forces)
    # the model's own nominal scale, in case the recording was made with another
    raw = np.asarray(record.output) * (channel.nominal_scale / model.nominal_scale)
    if not model.has_input:
        constant = values.get("k0", 0.0)
        predicted = error_model.simulate(record.with_signals(a_i_g=np.zeros(len(record))), values)
        return (raw - (predicted - constant)) / site
    estimate = raw / values.get("k1", 1.0)
    for _ in range(PASSES):
        predicted = error_model.simulate(record.with_signals(a_i_g=estimate), values)
        # the output is the gain times the input plus small terms: a Newton step by the gain
        estimate = estimate + (raw - predicted) / values.get("k1", 1.0)
    return estimate / site


def clipped(channel: Channel, model: AccelerometerModel) -> Record:
    """Return a channel's record with temperature and rate clipped to what the model covers."""
    lo, hi = model.valid_c
    record, rates = channel.record, model.valid_rate_c_per_min
    within = {
        name: np.clip(record[name], lo - model.t_ref_c, hi - model.t_ref_c)
        for name in ("x_c", "x_slow_c")
    }
    return record.with_signals(**within, rate_c_per_min=np.clip(record["rate_c_per_min"], *rates))


def _predictable(model: AccelerometerModel) -> dict[str, float]:
    """Return the coefficients; what belonged to the fitted runs or moments alone is zero."""
    own = {c.name for t in model.error_model().terms if not t.predictive for c in t.coefficients}
    return {name: 0.0 if name in own else value for name, value in model.values().items()}


def compensate(runs: RecordedRuns, models: ModelFile) -> Compensated:
    """Compensate every reading of recorded runs, flagged ones included where they have numbers.

    Raises
    ------
    InputError
        If an accelerometer has no model, its output unit is not the model's, its temperature is
        not recorded, a signal it needs is not, or the model remembers and the readings are not
        whole runs.
    """
    n = len(runs)
    accel, done, sigma = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    outside, rated, forced = (np.zeros(n, dtype=np.bool_) for _ in range(3))
    measured = np.isfinite(runs.output) & np.isfinite(runs.temp_c)
    for serial in runs.serials:
        model = models.of(serial)
        refuse_without_temperature(runs, serial)
        needs = model.error_model().needs
        known = [np.isfinite(values) for name, values in runs.more.items() if name in needs]
        rows = rows_of(runs, serial, np.logical_and.reduce([measured, *known]))
        if rows.size == 0:
            continue
        channel = channel_of(runs, serial, t_ref_c=model.t_ref_c, rows=rows)
        if channel.output_unit != model.output_unit:
            problem = f"output in {channel.output_unit}, the model is for {model.output_unit}"
            raise InputError(runs.source, f"serial {serial}", problem)
        refuse_without_signals(model.error_model(), channel, runs.source)
        _refuse_pieces(channel, model, runs.source)
        accel[rows] = np.asarray(channel.record.output)
        done[rows] = compensate_channel(channel, model)
        sigma[rows] = prediction_sigma_g(channel, model, clipped(channel, model), done[rows])
        outside[rows] = ~_covered(channel, model)
        rated[rows] = _rate_outside(channel, model)
        forced[rows] = _force_outside(channel, model, done[rows])
    return Compensated(
        accel_g=accel,
        accel_compensated_g=done,
        accel_sigma_g=sigma,
        outside_range=outside,
        outside_rate=rated,
        outside_input=forced,
    )


def remembering(model: AccelerometerModel) -> tuple[str, ...]:
    """Return the terms that need a run's earlier readings."""
    one = Record(
        time_s=np.zeros(1),
        signals={name: np.zeros(1) for name in model.error_model().needs | {"x_c", "x_slow_c"}},
    )
    after = model.error_model().design(one, model.values())[1]
    return tuple(name for name, memory in after.items() if memory is not None)


def _refuse_pieces(channel: Channel, model: AccelerometerModel, source: str) -> None:
    """Refuse parts of a run where a term needs what went before or comes after."""
    memory = remembering(model)
    rated = [t.name for t in model.error_model().terms if "rate_c_per_min" in t.needs]
    if not memory and not rated:
        return
    record = channel.record
    for name, rows in zip(channel.run_ids, record.run_slices, strict=True):
        time_s = record.time_s[rows]
        who = f"serial {channel.serial} run {name}"
        if time_s.size < LEAST_READINGS:
            what = ", ".join((*memory, *rated))
            problem = f"{time_s.size} reading(s); {what} need the whole run's"
            raise InputError(source, who, problem)
        late = float(time_s[0])
        if memory and late > max(RATE_WINDOW_S, 3.0 * float(np.median(np.diff(time_s)))):
            problem = (
                f"the first reading is at time_s {late:g}; {', '.join(memory)} need the run from "
                "its start, time_s 0"
            )
            raise InputError(source, who, problem)


def _covered(channel: Channel, model: AccelerometerModel) -> BoolArray:
    return within(channel.temp_c, model.support.temp_c if model.support else (model.valid_c,))


def _rate_outside(channel: Channel, model: AccelerometerModel) -> BoolArray:
    rate = channel.record["rate_c_per_min"]
    if not any("rate_c_per_min" in t.needs for t in model.error_model().terms):
        return np.zeros(rate.size, dtype=np.bool_)
    lo, hi = model.valid_rate_c_per_min
    margin = RATE_MARGIN * max(abs(lo), abs(hi))
    return np.asarray((rate < lo - margin) | (rate > hi + margin))


def _force_outside(channel: Channel, model: AccelerometerModel, found_g: FloatArray) -> BoolArray:
    beyond = np.zeros(found_g.size, dtype=np.bool_)
    if model.support is None or not model.has_input:
        return beyond
    for name, (lo, hi) in model.support.force_g.items():
        known = found_g if name == "a_i_g" else channel.record[name]
        beyond |= (known < lo - FORCE_MARGIN_G) | (known > hi + FORCE_MARGIN_G)
    return beyond
