"""Batch least squares of an error model, with sigmas that are valid under slow drift.

The output is linear in the products of scale and input columns whatever the coefficients, so the
whitened products are compressed once by QR; Gauss-Newton on the physical coefficients then runs on
a matrix as small as the model. Nonlinear parameters are fitted continuously outside of that
(variable projection).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.blocks import block_slices
from errormodel.columns import Columns, derivative
from errormodel.covariance import equal_weight_covariance, noise_weight_covariance
from errormodel.errors import NotSeparableError
from errormodel.linear import Compressed, compressed, solve_compressed, triangle_of
from errormodel.model import ErrorModel
from errormodel.noise.drift_or_white import estimate_noise_of
from errormodel.noise.model import NoiseFit, NoiseModel, given_noise
from errormodel.noise.whitening import BlockWhitener
from errormodel.record import Record
from errormodel.separability import Separability, separability

Weighting = Literal["equal", "noise"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelFit:
    """Estimates with their covariance; `names` labels every axis.

    Attributes
    ----------
    model : ErrorModel
    names : tuple of str
    values : ndarray, shape (p,)
        In the model's unit.
    cov : ndarray, shape (p, p)
        Covariance, including the uncertainty of the noise.
    noise : NoiseModel
        The estimated or given noise.
    rms : float
        Root mean square of the residual over readings, unit of the input.
    n : int
        Readings used.
    condition : float
        Condition number of the whitened derivative, columns scaled to unit length.
    """

    model: ErrorModel
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    noise: NoiseModel
    rms: float
    n: int
    condition: float

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, shape (p,)."""
        return np.sqrt(np.diag(self.cov))

    def as_dict(self) -> dict[str, float]:
        """Return name → value, as `ErrorModel.simulate` takes it."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def value(self, name: str) -> float:
        """Return one estimate."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return one standard deviation."""
        return float(self.sigmas[self.names.index(name)])


def fit(
    model: ErrorModel,
    record: Record,
    *,
    noise: NoiseModel | NoiseFit | None = None,
    weighting: Weighting = "equal",
    start: Mapping[str, float] | None = None,
    by_run: Sequence[str] = (),
) -> ModelFit:
    """Fit a model to one channel's measured output.

    Parameters
    ----------
    model : ErrorModel
    record : Record
        With `output` of shape (n,), in the unit of the model's input.
    noise : NoiseModel or NoiseFit, optional
        The noise, if it is known or was estimated from more data; by default white noise and drift
        are estimated.
    weighting : {"equal", "noise"}
        Equal weights, or weights from the noise (generalised least squares). The sigmas are
        computed from the noise in both cases. Equal weights give the smallest rms if the model
        lacks an effect, because a missing effect resembles drift.
    start : mapping, optional
        Start values by name; default: an ideal channel.
    by_run : sequence of str
        Coefficients that may differ from run to run. One common value is estimated, but the noise
        is that within the runs, so differences between runs are not taken for drift.

    Returns
    -------
    ModelFit

    Raises
    ------
    NotSeparableError
        If the data cannot separate some coefficients; it names them.
    ValueError
        If the record has no output or fewer readings than parameters.
    """
    output = _single_output(model, record)
    values = {**model.start_values(), **(start or {})}
    known = given_noise(noise) if isinstance(noise, NoiseModel) else noise
    weights = known.noise if known and weighting == "noise" else NoiseModel()
    values = _solve(model, record, output, weights, values, check=True)
    columns, residual = _linearised(model, record, output, values)
    own = [model.names.index(name) for name in by_run if name in model.names]
    found = known or estimate_noise_of(record, residual, columns, own_columns=own)
    if known is None and weighting == "noise":
        for _ in range(2):
            values = _solve(model, record, output, found.noise, values)
            columns, residual = _linearised(model, record, output, values)
            found = estimate_noise_of(record, residual, columns, own_columns=own)
    if model.parameters:  # they had no effect to test while their coefficients were zero
        _refuse(separability(columns.triangle(), model.names, _min_shares(model)))
    return _result(model, values, record, columns, residual, found, weighting)


def fit_values(
    model: ErrorModel, record: Record, *, start: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Fit a model with equal weights and return the values alone, as `fit` finds them.

    Parameters
    ----------
    model, record, start
        As `fit` takes them.

    Raises
    ------
    NotSeparableError, ValueError
        As `fit` does.
    """
    output = _single_output(model, record)
    given = {**model.start_values(), **(start or {})}
    values = _solve(model, record, output, NoiseModel(), given, check=True)
    if model.parameters:
        _refuse(examine(model, record, values))
    return values


def _linearised(
    model: ErrorModel, record: Record, output: FloatArray, values: Mapping[str, float]
) -> tuple[Columns, FloatArray]:
    """Return the Jacobian and the residual."""
    residual = model.simulate(record, values)
    np.subtract(output, residual, out=residual)
    return Columns(model, record, values), residual


def _single_output(model: ErrorModel, record: Record) -> FloatArray:
    if record.output is None or record.output.ndim != 1:
        raise ValueError("the record must have one measured output")
    if len(record) <= len(model.names):
        raise ValueError(f"{len(record)} readings cannot determine {len(model.names)} unknowns")
    return record.output


def _solve(
    model: ErrorModel,
    record: Record,
    output: FloatArray,
    noise: NoiseModel,
    values: dict[str, float],
    *,
    check: bool = False,
) -> dict[str, float]:
    """Return the least-squares values under a known noise; refuse inseparable coefficients."""
    names = [c.name for c in model.coefficients]

    def squeeze(parameters: Mapping[str, float]) -> Compressed:
        """Return the compressed problem with the nonlinear parameters fixed."""
        triangle: FloatArray | None = None
        for _, joint in whitened_products(model, record, output, noise, parameters):
            triangle = triangle_of(joint, triangle)
        assert triangle is not None  # there are more readings than unknowns
        return compressed(triangle)

    def inner(data: Compressed) -> tuple[dict[str, float], float]:
        """Return the coefficients and their cost."""
        found, _, cost = solve_compressed(model, data, values)
        return dict(zip(names, found[0].tolist(), strict=True)), float(cost[0])

    held = {p.name: values[p.name] for p in model.parameters}
    data = squeeze(held)
    if check:
        _refuse(_examined(model, data, values))
    if held:
        held = _best_parameters(model, held, lambda at: inner(squeeze(at))[1])
        data = squeeze(held)
    return {**held, **inner(data)[0]}


def whitened_products(
    model: ErrorModel,
    record: Record,
    output: FloatArray,
    noise: NoiseModel,
    parameters: Mapping[str, float],
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield readings with their whitened products, the output beside them, block by block."""
    whitener: BlockWhitener | None = None
    for rows, design in model.designs(record, parameters):
        joint = np.column_stack([design.products(), output[rows]])
        whitener = whitener or noise.block_whitener(joint.shape[1])
        yield rows, whitener.whiten(record.view(rows), joint) / noise.white


def _examined(model: ErrorModel, data: Compressed, values: Mapping[str, float]) -> Separability:
    """Test separability on the compressed problem: rotations keep every length and angle."""
    at = np.array([[values[c.name] for c in model.coefficients]])
    columns = data.triangle @ model.product_weights(at)[1][0]
    return separability(columns, [c.name for c in model.coefficients], _min_shares(model))


def _min_shares(model: ErrorModel) -> list[float]:
    return [c.min_share for c in model.coefficients] + [1e-6] * len(model.parameters)


def _refuse(found: Separability) -> None:
    if found.confounded:
        raise NotSeparableError(found.confounded)


def _best_parameters(
    model: ErrorModel, held: Mapping[str, float], cost: Callable[[Mapping[str, float]], float]
) -> dict[str, float]:
    """Search the nonlinear parameters within their bounds: a scan, then a bounded simplex."""
    names = list(held)
    bounds = [(p.lo, p.hi) for p in model.parameters]
    best = dict(held)
    lowest = cost(best)
    for p in model.parameters:  # one at a time: enough to find the right minimum
        grid = np.geomspace(p.lo, p.hi, 12) if p.lo > 0 else np.linspace(p.lo, p.hi, 13)
        for value in grid:
            tried = {**best, p.name: float(value)}
            if (c := cost(tried)) < lowest:
                best, lowest = tried, c
    found = optimize.minimize(
        lambda at: cost(dict(zip(names, at.tolist(), strict=True))),
        [best[n] for n in names],
        method="Nelder-Mead",
        bounds=bounds,
        options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 400 * len(names)},
    )
    return dict(zip(names, found.x.tolist(), strict=True))


def examine(model: ErrorModel, record: Record, values: Mapping[str, float]) -> Separability:
    """Return which coefficients a record can separate; the record needs no output."""
    return separability(derivative(model, record, values), model.names, _min_shares(model))


def _result(
    model: ErrorModel,
    values: Mapping[str, float],
    record: Record,
    columns: Columns,
    residual: FloatArray,
    found: NoiseFit,
    weighting: Weighting,
) -> ModelFit:
    """Build the result; the covariance is averaged over the noise models that the data allow."""
    if weighting == "equal":
        cov, condition = equal_weight_covariance(record, columns, found.support)
    else:
        cov, condition = noise_weight_covariance(record, columns, residual, found.support)
    squares = [float(np.sum(residual[rows] ** 2)) for rows in block_slices(len(record))]
    return ModelFit(
        model=model,
        names=model.names,
        values=np.array([values[name] for name in model.names]),
        cov=cov,
        noise=found.noise,
        rms=float(np.sqrt(sum(squares) / len(record))),
        n=len(record),
        condition=condition,
    )
