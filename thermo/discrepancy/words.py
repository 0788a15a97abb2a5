"""The verdict in words: effects with their sizes, and where the disagreement is."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.gate import FactorFinding, Judgement
from errormodel.discrepancy.search.state import SearchState
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseFit
from thermo.discrepancy.factors import factor_kind
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.discrepancy.shape.found import ShapeFound
from thermo.discrepancy.shape.pattern import TIMES_WORDS
from thermo.library import thermal_library


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """A size as reported; sigma is NaN for an instant, which is found among the readings."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectFound:
    """One effect of the verdict.

    `strength_d` is its whitened size beside everything else in the model; `p_value` is that of
    the whole library.
    """

    name: str
    parameters: Mapping[str, ParameterValue]
    strength_d: float
    p_value: float
    sentence: str


def parameter_values(
    fitted: Fitted, source: ThermalSource, floor: NoiseFit
) -> dict[str, ParameterValue]:
    """Return every parameter of a fitted model with its sigma under the noise, as reported."""
    covariance = fitted_covariance(fitted, source, floor)
    # what two columns share beyond rounding has no sigma
    variances = np.where(np.diag(covariance) > 0.0, np.diag(covariance), np.nan)
    sigmas = dict(zip(fitted.free, np.sqrt(variances).tolist(), strict=True))
    units = _units(fitted.model, source.channel.nominal_scale, source.channel.output_unit)
    return {
        name: ParameterValue(
            value=value * units[name][0],
            sigma=sigmas.get(name, float("nan")) * abs(units[name][0]),
            unit=units[name][1],
        )
        for name, value in fitted.values.items()
    }


def _units(model: ErrorModel, scale: float, unit: str) -> dict[str, tuple[float, str]]:
    known = {u.name: (u.per_unit, u.unit) for u in (*model.coefficients, *model.parameters)}
    return {**known, **({"k1": (scale, f"{unit}/g")} if "k1" in known else {})}


def fitted_covariance(fitted: Fitted, source: ThermalSource, floor: NoiseFit) -> FloatArray:
    """Return the covariance of the free parameters under the noise, in the model's unit."""
    whitener = floor.noise.whitener(source.blocks.times)
    white = whitener.whiten(fitted.jacobian) / floor.noise.white
    norms = np.linalg.norm(white, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    scaled = white / norms
    return np.linalg.pinv(scaled.T @ scaled, rcond=1e-12) / np.outer(norms, norms)


def effects_found(
    source: ThermalSource, fitted: Fitted, result: SearchState, floor: NoiseFit
) -> tuple[EffectFound, ...]:
    """Return the effects of the verdict with their sizes and sentences."""
    values = parameter_values(fitted, source, floor)
    known = {e.name: e for e in source.effects}
    idle = fitted.idle
    made: list[EffectFound] = []
    for slot in result.slots:
        terms = source.form_of(slot.choice).terms
        names = [
            u.name
            for t in fitted.model.terms
            if t.name in terms
            for u in (*t.coefficients, *t.parameters)
            if u.name not in idle
        ]
        parameters = {n: values[n] for n in names}
        made.append(
            EffectFound(
                name=slot.choice.name,
                parameters=parameters,
                strength_d=float(np.sqrt(max(slot.gain, 0.0))),
                p_value=slot.p_value,
                sentence=known[slot.choice.name].sentence.format(size=_size(parameters)),
            )
        )
    return tuple(made)


def _size(parameters: Mapping[str, ParameterValue]) -> str:
    """Return the sizes in words, the first three; those after the first with what they are."""
    known = thermal_library().parameters
    (_, size), *more = list(parameters.items())[:3]
    named = [f"{known[name].label} {_digits(p)} {p.unit}" for name, p in more]
    return ", ".join([f"{_digits(size)} {size.unit}", *named])


def _digits(value: ParameterValue) -> str:
    if not np.isfinite(value.sigma) or value.sigma <= 0.0:
        return f"{value.value:.4g}".replace("-", "−")
    digits = max(0, 1 - int(np.floor(np.log10(value.sigma))))
    return f"{value.value:.{digits}f} ± {value.sigma:.{digits}f}".replace("-", "−")


def where_text(
    source: ThermalSource,
    where: FactorFinding | None,
    judgement: Judgement,
    shape: ShapeFound | None = None,
) -> str:
    """Say where the measurement and the model disagree, the names where some stand."""
    if where is None:
        return "Nowhere more than the noise: what is left does not repeat and is no larger than it."
    what = "What the names leave" if shape and judgement.names_stand else "What the model leaves"
    text = f"{what} {factor_kind(source.seen, where.name).quantity.words}"
    if shape is not None:
        text += TIMES_WORDS[shape.pattern.times]
    if judgement.bursts > 6.0 and judgement.verdict == "unexplained_noise":
        text += ", in bursts"
    if where.excess < 1.0:
        return f"{text}, but not more than noise alone."
    return f"{text} (chi-square {where.excess:.0f} above the noise)."
