"""Fit of one model to a thousand channels that shared their inputs, as a peer of single fits."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import NotSeparableError
from errormodel.fit import ModelFit
from errormodel.linear import compress, solve_compressed
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from errormodel.separability import separability


def fit_many(
    model: ErrorModel, record: Record, *, noise: NoiseModel | None = None
) -> tuple[ModelFit, ...]:
    """Fit one model to many channels that shared their inputs, in one pass.

    Parameters
    ----------
    model : ErrorModel
        Without nonlinear parameters.
    record : Record
        With `output` of shape (n, m).
    noise : NoiseModel, optional
        The shape of the noise, common to all channels; its size is estimated for each. Default:
        white.

    Returns
    -------
    tuple of ModelFit, length m

    Raises
    ------
    NotSeparableError
        If the data cannot separate some coefficients.
    ValueError
        If the model has nonlinear parameters or the record no outputs.
    """
    if model.parameters:
        raise ValueError("fit_many takes models without nonlinear parameters")
    if record.output is None or record.output.ndim != 2:
        raise ValueError("the record must have outputs of shape (n, m)")
    shape = noise or NoiseModel()
    start = model.start_values()
    products = model.design(record, start)[0].products()
    p = products.shape[1]
    whitened = shape.whiten(record, np.column_stack([products, record.output]))
    data = compress(whitened[:, :p], whitened[:, p:])
    weights = np.array([[start[c.name] for c in model.coefficients]])
    columns = data.triangle @ model.product_weights(weights)[1][0]
    examined = separability(columns, model.names, [c.min_share for c in model.coefficients])
    if examined.confounded:
        raise NotSeparableError(examined.confounded)
    values, information, cost = solve_compressed(model, data, start)
    factors = np.sqrt(cost / (len(record) - len(model.names)))
    residual = record.output - products @ model.product_weights(values)[0].T
    rms = np.sqrt(np.mean(residual**2, axis=0))
    scales = np.sqrt(np.einsum("mcc->mc", information))
    lengths = scales[:, :, None] * scales[:, None, :]
    correlation = np.asarray(information / lengths, dtype=np.float64)
    cov: FloatArray = np.linalg.inv(correlation) / lengths
    conditions = np.sqrt(np.linalg.cond(correlation))
    return tuple(
        ModelFit(
            model=model,
            names=model.names,
            values=values[k],
            cov=cov[k] * factors[k] ** 2,
            noise=shape.scaled(float(factors[k])),
            rms=float(rms[k]),
            n=len(record),
            condition=float(conditions[k]),
        )
        for k in range(values.shape[0])
    )
