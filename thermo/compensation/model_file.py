"""The model file: everything needed to apply a fitted model, and to trace where it came from.

JSON. Coefficients stand in the units of the report (µg, ppm, …) with their sigmas; `covariance` is
in the same units and in the order of `names`. `model_id` is a digest of the content.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.fit import ModelFit
from errormodel.io.python_file import check_source, sources_of
from errormodel.io.signed import (
    check_digest,
    content_digest,
    json_file_text,
    read_json,
    software_name,
)
from errormodel.io.toml import check
from errormodel.model import ErrorModel
from thermo.compensation.model_parts import (
    CoefficientValue,
    Finite,
    InsidePart,
    LibraryPart,
    Part,
    SupportPart,
    UnseenPart,
)
from thermo.fitting.fit import AccelerometerFit
from thermo.fitting.terms_wanted import check_terms
from thermo.library import term, thermal_library

FORMAT = "accelbench-model"
EQUATION = (
    "E = K1(x)·[K0(x) + a_i + K2·a_i² + K3·a_i³ + δo·a_p − δp·a_o + Kip·a_i·a_p + Kio·a_i·a_o], "
    "x = T − t_ref_c, K0(x) = Σ b_k·x^k + history, K1(x) = K1₀·(1 + Σ s_k·x^k); "
    "a in local g, E in output_unit; µg, ppm and µrad are millionths"
)
CLIP_RULE = (
    "outside valid_c the temperature is taken as the nearest end of the range, outside "
    "valid_rate_c_per_min the rate; readings outside valid_c or in a gap of support.temp_c are "
    "flagged outside_range, those outside the rates of a model that uses them outside_rate, those "
    "beyond support.force_g by more than 0.1 g outside_input"
)


class AccelerometerModel(Part):
    """One accelerometer's model, ready to apply."""

    serial: str
    output_unit: str
    nominal_scale: Finite
    gravity_m_s2: Finite
    has_input: bool
    t_ref_c: Finite
    valid_c: tuple[Finite, Finite]
    valid_rate_c_per_min: tuple[Finite, Finite]
    terms: tuple[str, ...]
    coefficients: dict[str, CoefficientValue]
    names: tuple[str, ...]
    covariance: tuple[tuple[Finite, ...], ...]
    noise: dict[str, Finite]
    residual_ug: Finite
    heldout_residual_ug: Finite | None
    source_runs: dict[str, str]
    n_samples: int
    support: SupportPart | None = None
    run_to_run: dict[str, Finite] | None = None
    inside: InsidePart | None = None
    unseen: tuple[UnseenPart, ...] = ()
    library: tuple[LibraryPart, ...] = ()

    @model_serializer(mode="wrap")
    def _without_empty_library(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = handler(self)
        if not self.library:
            content.pop("library", None)
        return content

    @model_validator(mode="after")
    def _check(self) -> "AccelerometerModel":
        for part in self.library:
            check_source(part.name, part.sha256, thermal_library().sources)
        check_terms(self.terms)
        expected = self.error_model().names
        if set(self.coefficients) != set(expected) or tuple(self.names) != expected:
            raise ValueError(f"coefficients and names must be those of the terms: {expected}")
        if np.shape(self.covariance) != (len(expected), len(expected)):
            raise ValueError("covariance must be square, one row per name")
        if not self.nominal_scale or not self.valid_c[0] <= self.valid_c[1]:
            raise ValueError("nominal_scale must not be 0, valid_c must be [low, high]")
        return self

    def error_model(self) -> ErrorModel:
        """Return the model object."""
        return ErrorModel(tuple(term(name) for name in self.terms))

    def own_covariance(self) -> FloatArray:
        """Return the covariance in the model's own unit, in the order of `names`."""
        factors = reporting_factors(self.error_model(), self.nominal_scale)
        scale = np.array([factors[name] for name in self.names])
        return np.asarray(np.array(self.covariance) / np.outer(scale, scale))

    def own_moves(self) -> dict[tuple[str, int], dict[str, float]]:
        """Return what orders not in the model may do, in the model's own unit: family, order."""
        return {
            (one.family, one.order): {
                name: move / (self.nominal_scale if name == "k1" else 1e6)
                for name, move in one.moves.items()
            }
            for one in self.unseen
        }

    def values(self) -> dict[str, float]:
        """Return the coefficients in the model's own unit, as `ErrorModel.simulate` takes them."""
        factors = reporting_factors(self.error_model(), self.nominal_scale)
        return {name: self.coefficients[name].value / factors[name] for name in self.names}


class ModelFile(Part):
    """A model file, with the models of one or more accelerometers."""

    format: Literal["accelbench-model"]
    format_version: Literal[1] = 1
    model_id: str
    created_utc: str
    software: str
    equation: str = EQUATION
    clip_rule: str = CLIP_RULE
    accelerometers: Annotated[tuple[AccelerometerModel, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> "ModelFile":
        serials = [a.serial for a in self.accelerometers]
        if len(set(serials)) != len(serials):
            raise ValueError("a serial number is listed twice")
        return self

    def of(self, serial: str) -> AccelerometerModel:
        """Return one accelerometer's model.

        Raises
        ------
        InputError
            If the file has none of that serial number.
        """
        for one in self.accelerometers:
            if one.serial == serial:
                return one
        known = ", ".join(a.serial for a in self.accelerometers)
        raise InputError("the model file", "", f"no model for serial {serial!r}; it has {known}")


def reporting_factors(model: ErrorModel, nominal_scale: float) -> dict[str, float]:
    """Return what each unknown is multiplied by to be reported; K1 is in output units per g."""
    factors = {u.name: u.per_unit for u in (*model.coefficients, *model.parameters)}
    return {**factors, **({"k1": nominal_scale} if "k1" in factors else {})}


def reported_units(model: ErrorModel, output_unit: str) -> dict[str, str]:
    """Return the unit each unknown is reported in."""
    units = {u.name: u.unit for u in (*model.coefficients, *model.parameters)}
    return {**units, **({"k1": f"{output_unit}/g"} if "k1" in units else {})}


def reported(
    fit: ModelFit, nominal_scale: float, output_unit: str
) -> dict[str, dict[str, float | str]]:
    """Return a fit's coefficients as `fit --json` gives them: value, sigma and unit by name."""
    factors = reporting_factors(fit.model, nominal_scale)
    units = reported_units(fit.model, output_unit)
    return {
        name: {
            "value": fit.value(name) * factors[name],
            "sigma": fit.sigma(name) * abs(factors[name]),
            "unit": units[name],
        }
        for name in fit.names
    }


def inside_of(one: AccelerometerFit) -> dict[str, Any] | None:
    """Return the coefficients at a temperature within the readings, as a model file has them.

    None where the reference temperature lies within.
    """
    inside = one.doubts.inside
    if inside is None:
        return None
    factors = reporting_factors(one.fit.model, one.own_scale)
    units = reported_units(one.fit.model, one.channel.output_unit)
    return {
        "t_ref_c": inside.t_ref_c,
        "coefficients": {
            name: {
                "value": value * factors[name],
                "sigma": inside.sigmas[name] * abs(factors[name]),
                "unit": units[name],
            }
            for name, value in inside.values.items()
        },
    }


def run_to_run_of(one: AccelerometerFit) -> dict[str, float] | None:
    """Return the sigmas by which one run more may differ; None where one run was fitted."""
    if len(one.channel.run_ids) < 2:
        return None
    keys = {"k0": ("k0_ug", 1e6), "k1": ("k1_ppm", 1e6), "temp_c": ("temp_c", 1.0)}
    return {keys[e.name][0]: e.next_sigma * keys[e.name][1] for e in one.run_effects}


def _unseen_of(one: AccelerometerFit) -> list[dict[str, Any]]:
    known = thermal_library().parameters
    return [
        {
            "family": u.family,
            "order": u.order,
            "moves": {
                name: move * (one.own_scale if name == "k1" else 1e6)
                for name, move in u.moves.items()
                if known[name].family in ("k0", "k1") or name in one.fit.names
            },
        }
        for u in one.doubts.unseen
    ]


def model_of(one: AccelerometerFit) -> AccelerometerModel:
    """Return the model-file entry of a fitted accelerometer."""
    channel, fitted = one.channel, one.fit
    factors = reporting_factors(fitted.model, channel.nominal_scale)
    scale = np.array([factors[name] for name in fitted.names])
    noise = one.noise
    return AccelerometerModel.model_validate(
        {
            "serial": one.serial,
            "output_unit": channel.output_unit,
            "nominal_scale": channel.nominal_scale,
            "gravity_m_s2": channel.gravity_m_s2,
            "has_input": channel.has_input,
            "t_ref_c": one.t_ref_c,
            "valid_c": one.valid_c,
            "valid_rate_c_per_min": one.valid_rate_c_per_min,
            "terms": tuple(t.name for t in fitted.model.terms),
            "coefficients": reported(fitted, channel.nominal_scale, channel.output_unit),
            "names": fitted.names,
            "covariance": (fitted.cov * np.outer(scale, scale)).tolist(),
            "noise": {
                "white_ug": 1e6 * noise.white,
                "drift_ug": 1e6 * noise.drift,
                "drift_tau_s": noise.drift_tau_s,
            },
            "residual_ug": one.summary.rms_ug,
            "heldout_residual_ug": one.heldout.rms_ug if one.heldout else None,
            "source_runs": dict(one.digests),
            "n_samples": fitted.n,
            "support": {"temp_c": one.support.temp_c, "force_g": dict(one.support.force_g)},
            "run_to_run": run_to_run_of(one),
            "inside": inside_of(one),
            "unseen": _unseen_of(one),
            "library": [
                {"name": s.name, "sha256": s.sha256}
                for s in sources_of(thermal_library().sources, [t.name for t in fitted.model.terms])
            ],
        }
    )


def make_model_file(fits: Sequence[AccelerometerFit]) -> ModelFile:
    """Put fitted accelerometers together into a model file."""
    accelerometers = [model_of(one).model_dump(mode="json") for one in fits]
    return ModelFile.model_validate(
        {
            "format": FORMAT,
            "model_id": model_digest(accelerometers),
            "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
            "software": software_name(),
            "accelerometers": accelerometers,
        }
    )


def model_digest(accelerometers: Sequence[Mapping[str, Any]]) -> str:
    """Return the digest of a model file's accelerometers, as JSON holds them: its `model_id`."""
    return content_digest(accelerometers, compact=True)


def dump_model(model: ModelFile) -> str:
    """Return a model file's text."""
    return json_file_text(model, indent=2)


def read_model(path: Path | str) -> ModelFile:
    """Read a model file.

    Raises
    ------
    InputError
        If it is not one, or was changed after it was written (its `model_id` no longer fits).
    """
    data = read_json(path)
    model = check(data, ModelFile, path)
    # as written: a key that a later version added is not in an older file's digest
    accelerometers = [
        one.model_dump(mode="json", exclude_unset=True) for one in model.accelerometers
    ]
    check_digest(model_digest(accelerometers), model.model_id, path, "model_id")
    return model
