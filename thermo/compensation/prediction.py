"""Sigma of a compensated reading: the model, the run, and the reading's own noise."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.record import Record
from thermo.compensation.model_file import AccelerometerModel
from thermo.library import thermal_library
from thermo.recording.channel import Channel

STEP_G = 1e-4


def prediction_sigma_g(
    channel: Channel, model: AccelerometerModel, record: Record, found_g: FloatArray
) -> FloatArray:
    """Return the standard deviation of compensated readings, local g, shape (n,).

    J·cov·Jᵀ of the model, with what unseen orders may do at the reading's temperature; how one run
    may differ from those fitted, where that is known; white noise and drift. Where the temperature
    was clipped, the whole change that its slope there would make is counted.

    Parameters
    ----------
    channel : Channel
        As recorded.
    model : AccelerometerModel
    record : Record
        Its record with temperature and rate clipped to the model's range.
    found_g : ndarray, shape (n,)
        The compensated values.
    """
    errors, values = model.error_model(), model.values()
    site = channel.gravity_m_s2 / model.gravity_m_s2
    a_i = found_g * site if model.has_input else np.zeros(found_g.size)
    at = record.with_signals(a_i_g=a_i)
    above, below = (
        errors.simulate(record.with_signals(a_i_g=a_i + s * STEP_G), values) for s in (1.0, -1.0)
    )
    gain = (above - below) / (2.0 * STEP_G)
    columns = derivative(errors, at, values) / gain[:, None]
    variance = np.einsum("np,pq,nq->n", columns, model.own_covariance(), columns)
    variance += _unseen(model, columns, at["x_c"])
    slope = _by_temperature(model, at, gain)
    variance += (slope * (channel.record["x_c"] - record["x_c"])) ** 2
    noise = model.noise
    variance += 1e-12 * (noise["white_ug"] ** 2 + noise["drift_ug"] ** 2)
    runs = model.run_to_run or {}
    variance += (1e-6 * runs.get("k0_ug", 0.0)) ** 2 + (1e-6 * runs.get("k1_ppm", 0.0) * a_i) ** 2
    variance += (runs.get("temp_c", 0.0) * slope) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)) / site)


def _by_temperature(model: AccelerometerModel, at: Record, gain: FloatArray) -> FloatArray:
    """Return the derivative of the input by the temperature, g/°C."""
    errors, values, x = model.error_model(), model.values(), at["x_c"]
    if "x_c" not in errors.needs:
        return np.zeros(x.size)
    up, down = (errors.simulate(at.with_signals(x_c=x + s), values) for s in (0.5, -0.5))
    return np.asarray((up - down) / gain)


def _unseen(model: AccelerometerModel, columns: FloatArray, x: FloatArray) -> FloatArray:
    """Return the variance by unseen orders, less the part that the covariance has already."""
    total = np.zeros(x.size)
    for (family, _), moves in model.own_moves().items():
        inside, beyond = np.zeros(x.size), np.zeros(x.size)
        base = columns[:, model.names.index(family)]
        if family == "k1":  # the polynomial of the scale factor is relative
            base = base * model.values()["k1"]
        for name, own in moves.items():
            if name in model.names:
                inside += own * columns[:, model.names.index(name)]
            else:
                beyond += own * base * x ** thermal_library().parameters[name].order
        total += (inside + beyond) ** 2 - inside**2
    return total
