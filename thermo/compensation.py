"""Applying a model: from an output and a temperature to a specific force."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from thermo.inputs import Channel, channel_of, rows_of
from thermo.modelfile import AccelerometerModel, ModelFile
from thermo.recording import RecordedRuns
from thermo.recording_model import BoolArray

# Each pass takes the gain at the reference temperature for the gain: what is left shrinks by the
# relative change of K1 over temperature, 1 % at the most, so six passes reach rounding.
PASSES = 6


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Compensated:
    """The rows of a recording, compensated.

    Attributes
    ----------
    accel_g : ndarray, shape (n,)
        Output over the nominal scale factor; NaN where the output is missing.
    accel_compensated_g : ndarray, shape (n,)
        Specific force along IA, with the model applied.
    outside_range : ndarray of bool, shape (n,)
        The temperature lay outside the model's range and was clipped to it.
    """

    accel_g: FloatArray
    accel_compensated_g: FloatArray
    outside_range: BoolArray

    def __post_init__(self) -> None:
        freeze(
            self,
            accel_g=readonly(self.accel_g),
            accel_compensated_g=readonly(self.accel_compensated_g),
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
    lo, hi = model.valid_c
    clipped = {
        name: np.clip(channel.record[name], lo - model.t_ref_c, hi - model.t_ref_c)
        for name in ("x_c", "x_slow_c")
    }
    rates = model.valid_rate_c_per_min
    record = channel.record.with_signals(
        **clipped, rate_c_per_min=np.clip(channel.record["rate_c_per_min"], *rates)
    )
    if not model.has_input:
        constant = values.get("k0", 0.0)
        predicted = error_model.simulate(record.with_signals(a_i_g=np.zeros(len(record))), values)
        return np.asarray(record.output) - (predicted - constant)
    # the model's own nominal scale, in case the recording was made with another
    raw = np.asarray(record.output) * (channel.nominal_scale / model.nominal_scale)
    estimate = raw / values.get("k1", 1.0)
    for _ in range(PASSES):
        predicted = error_model.simulate(record.with_signals(a_i_g=estimate), values)
        # the output is the gain times the input plus small terms: a Newton step by the gain
        estimate = estimate + (raw - predicted) / values.get("k1", 1.0)
    return estimate


def _predictable(model: AccelerometerModel) -> dict[str, float]:
    """Return the coefficients; what belonged to the fitted runs or moments alone is zero."""
    own = {c.name for t in model.error_model().terms if not t.predictive for c in t.coefficients}
    return {name: 0.0 if name in own else value for name, value in model.values().items()}


def compensate(runs: RecordedRuns, models: ModelFile) -> Compensated:
    """Compensate every reading of recorded runs, flagged ones included where they have numbers.

    Raises
    ------
    InputError
        If an accelerometer has no model, or its output unit is not the model's.
    """
    n = len(runs)
    accel, done = np.full(n, np.nan), np.full(n, np.nan)
    outside = np.zeros(n, dtype=np.bool_)
    measured = np.isfinite(runs.output) & np.isfinite(runs.temp_c)
    for serial in runs.serials:
        model = models.of(serial)
        rows = rows_of(runs, serial, measured)
        if rows.size == 0:
            continue
        channel = channel_of(runs, serial, t_ref_c=model.t_ref_c, rows=rows)
        if channel.output_unit != model.output_unit:
            problem = f"output in {channel.output_unit}, the model is for {model.output_unit}"
            raise InputError(runs.source, f"serial {serial}", problem)
        accel[rows] = np.asarray(channel.record.output)
        done[rows] = compensate_channel(channel, model)
        lo, hi = model.valid_c
        outside[rows] = (channel.temp_c < lo) | (channel.temp_c > hi)
    return Compensated(accel_g=accel, accel_compensated_g=done, outside_range=outside)
